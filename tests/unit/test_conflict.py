"""Another sender of our ids: what each mode does, and when it is over."""

from __future__ import annotations

from dsz_daemon.runs.conflict import OutputConflict

S = 1_000_000_000


def test_refuse_leaves_the_id_to_the_other_until_he_has_been_quiet_for_two_seconds() -> None:
    conflict = OutputConflict("refuse")
    conflict.follow({}, 0)
    assert conflict.refused == frozenset()
    conflict.follow({0x6D1: 3}, S)
    assert conflict.refused == {0x6D1}
    conflict.follow({0x6D1: 4, 0x6D5: 1}, 2 * S)
    conflict.follow({0x6D1: 5, 0x6D5: 1}, 3 * S)
    conflict.follow({0x6D1: 5, 0x6D5: 1}, 4 * S + 1)
    assert conflict.refused == {0x6D1}
    conflict.follow({0x6D1: 5, 0x6D5: 1}, 5 * S + 1)
    assert conflict.refused == frozenset()


def test_report_goes_on() -> None:
    conflict = OutputConflict("report")
    conflict.follow({0x6D0: 3}, S)
    assert (conflict.refused, conflict.wants_to_move) == (frozenset(), False)


def test_move_moves_once_and_then_refuses() -> None:
    conflict = OutputConflict("move")
    conflict.follow({0x6D0: 1}, S)
    assert (conflict.refused, conflict.wants_to_move) == (frozenset(), True)
    conflict.moved_over()
    conflict.follow({0x6D0: 1}, S + 1)
    assert (conflict.refused, conflict.wants_to_move) == (frozenset(), False)
    conflict.follow({0x6D0: 1, 0x700: 1}, 2 * S)
    assert (conflict.refused, conflict.wants_to_move) == ({0x700}, False)
