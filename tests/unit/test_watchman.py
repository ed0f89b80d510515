"""runs/watchman: what of two looks at a daemon is worth saying. Both looks are made up."""

from __future__ import annotations

from dataclasses import replace

import pytest
from status_cases import last_moment

from dsz_daemon.core.outputs import Reason
from dsz_daemon.edge.health import Link
from dsz_daemon.edge.journal import Priority
from dsz_daemon.pipeline.decode import DecodeCounters, MessageCounts, RoleCounts
from dsz_daemon.runs.facts import LiveFacts
from dsz_daemon.runs.watchman import News, news, seen


def said(before: LiveFacts, now: LiveFacts) -> list[tuple[str, str]]:
    return [(item.kind, item.message) for item in news(seen(before), now)]


def quiet(**changes: object) -> LiveFacts:
    """A daemon that runs well, but for the changes."""
    return replace(last_moment(), decoder=DecodeCounters(), **changes)  # type: ignore[arg-type]


def with_reason(reason: Reason) -> LiveFacts:
    row = last_moment().row
    assert row is not None
    channel = row.output.gyro_y._replace(reason=reason)
    return quiet(row=row._replace(output=row.output._replace(gyro_y=channel)))


def test_nothing_new_is_not_told() -> None:
    assert news(seen(quiet()), quiet()) == []
    assert news(None, quiet()) == []


def test_a_doubted_gyro_is_told_once() -> None:
    calm, doubted = with_reason(Reason.NONE), with_reason(Reason.DOUBTED)
    ((kind, message),) = said(calm, doubted)
    assert kind == "doubted"
    assert message.startswith("gyro_y: ")
    assert said(doubted, doubted) == []
    assert said(doubted, calm) == []


@pytest.mark.parametrize("link", [link for link in Link if link is not Link.UP])
def test_a_link_that_changes_is_told_with_its_bus(link: Link) -> None:
    up = quiet()
    other = replace(up, buses=(replace(up.buses[0], link=link),))
    assert [(n.kind, n.bus, n.priority) for n in news(seen(up), other)] == [
        (f"link_{link.value}", "can0", Priority.WARNING)
    ]
    assert [n.kind for n in news(None, other)] == [f"link_{link.value}"]
    assert [(n.kind, n.priority) for n in news(seen(other), up)] == [("link_up", Priority.NOTICE)]


def test_counts_that_rise_are_told_with_by_how_much() -> None:
    decoder = DecodeCounters(
        messages={"IMU": MessageCounts(babbling=7, wrong_checksum=5)}, roles={"gyro_z": RoleCounts(out_of_range=4)}
    )
    before = quiet()
    first = replace(before, decoder=decoder, missed_ticks=3)
    told = dict(said(before, first))
    assert set(told) == {"babbling", "wrong_checksum", "out_of_range", "missed_ticks"}
    assert "IMU: 7 frames" in told["babbling"]
    assert told["out_of_range"].startswith("gyro_z: 4 values")
    assert told["missed_ticks"].startswith("3 ticks")
    later = replace(first, missed_ticks=5)
    assert said(first, later) == [("missed_ticks", "2 ticks were late and not published")]


def test_held_back_output_is_told_and_so_is_its_end() -> None:
    free, held = quiet(), quiet(output_refused=True)
    assert [item[0] for item in said(free, held)] == ["output_refused"]
    assert said(held, held) == []
    assert [item[0] for item in said(held, free)] == ["output_again"]


@pytest.mark.parametrize(("phase", "priority"), [("silent", Priority.WARNING), ("waiting", Priority.NOTICE)])
def test_a_change_of_phase_is_told(phase: str, priority: Priority) -> None:
    (item,) = news(seen(quiet()), quiet(phase=phase))
    assert isinstance(item, News)
    assert (item.kind, item.priority) == (phase, priority)
