"""Work side by side, also inside work."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from dsz_daemon.diagnose.residuals.comparison import all_hands
from dsz_daemon.runs.hands import Hands

LONG_S = 20.0


def test_answers_come_in_the_order_of_what_was_asked() -> None:
    with Hands(3) as hands:
        assert hands.map(lambda one: one * one, range(50)) == [one * one for one in range(50)]
        assert hands.map(str, []) == []


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_is_asked_inside_is_answered_however_deep(count: int) -> None:
    with Hands(count) as hands:

        def summed(depth: int) -> int:
            return 1 if depth == 0 else sum(hands.map(summed, [depth - 1] * 3))

        assert summed(5) == 3**5


def test_two_are_done_at_once() -> None:
    both = threading.Barrier(2)
    with Hands(2) as hands:
        assert len(set(hands.map(lambda _: both.wait(LONG_S), range(2)))) == 2


def test_who_waits_helps_with_what_is_asked_inside() -> None:
    """One outer work is done; the other asks two things that can only be answered at the same time."""
    both = threading.Barrier(2)

    def asked(outer: int) -> list[int]:
        return hands.map(lambda _: both.wait(LONG_S), range(2)) if outer else []

    with Hands(2) as hands:
        for order in ((0, 1), (1, 0)):
            assert sorted(map(len, hands.map(asked, order))) == [0, 2]


@pytest.mark.parametrize("bad", [0, 4])
def test_a_fault_is_raised_where_it_was_asked_and_the_hands_go_on(bad: int) -> None:
    def done(one: int) -> int:
        if one == bad:
            raise ValueError(one)
        return one

    with Hands(2) as hands:
        with pytest.raises(ValueError, match=str(bad)):
            hands.map(done, range(5))
        with pytest.raises(ValueError, match=str(bad)):
            hands.map(lambda _: hands.map(done, range(5)), range(3))
        assert hands.map(done, [1, 2]) == [1, 2]


def test_after_a_fault_nothing_else_is_begun() -> None:
    begun, both, is_raised = list[int](), threading.Barrier(2), threading.Event()

    def done(one: int) -> None:
        begun.append(one)
        if one < 2:
            both.wait(LONG_S)
        if one == 0:
            raise ValueError(one)
        is_raised.wait(0.3)

    with Hands(2) as hands, pytest.raises(ValueError, match="0"):
        hands.map(done, range(6))
    assert sorted(begun) == [0, 1]


def test_no_thread_is_left() -> None:
    before = threading.active_count()
    with Hands(4) as hands:
        hands.map(str, range(8))
    assert threading.active_count() == before


def test_only_what_may_is_asked_inside() -> None:
    """An executor's map inside its own works waits for itself."""
    found = list[bool]()
    with Hands(2) as hands, ThreadPoolExecutor(2) as pool:
        for each in (map, pool.map, hands.map):
            insides = all_hands(lambda _, inside: inside, [0, 1], each)
            found += [inside == each for inside in insides]
    assert found == [True, True, False, False, True, True]
