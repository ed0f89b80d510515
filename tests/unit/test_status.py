"""The snapshot of a running daemon: nothing is left out, nothing is no JSON, and people can read it."""

from __future__ import annotations

import dataclasses
import gc
import io
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from status_cases import FakeDaemon, golden_setup, last_moment, moments

from dsz_daemon import cli
from dsz_daemon.core.outputs import ChannelState, Reason
from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.health import BusHealth, Link
from dsz_daemon.edge.journal import Event, Priority
from dsz_daemon.errors import MachineError
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.pipeline.rows import Refusal
from dsz_daemon.runs.asking import answer, socket_path
from dsz_daemon.runs.facts import LiveFacts, StateFacts
from dsz_daemon.runs.screen_status import status_screen
from dsz_daemon.runs.status import snapshot, snapshot_text, status_line
from dsz_daemon.runs.watchman import seen as seen_by_the_watchman
from dsz_daemon.signals import IMU_CHANNELS

DEG = math.pi / 180.0
# Left out on purpose: a decoder's memory between two frames, and a count that a row gets when it is published.
NOT_SHOWN = ("senders.", "row.counters.missed_ticks.")


def rich_facts() -> LiveFacts:
    """The end of the golden drive, with something in every list and dictionary."""
    facts = last_moment()
    assert facts.row is not None
    return replace(
        facts,
        row=facts.row._replace(refused=(Refusal("gyro_z", "spike"),), event="gap"),
        encoder=replace(facts.encoder, saturated={"DSZ_RATES.P": 1}),
        buses=(BusHealth("can0", "socketcan:can0", last_error="ENOBUFS"), BusHealth("can1", "udp_multicast:x")),
        state_file=StateFacts("offsets.json", 60.0, facts.started_ns, "disk full"),
        events=(Event(facts.started_ns, Priority.ERROR, "bus_off", "can1 is bus-off"),),
        reloads=1,
    )


def seen(facts: LiveFacts) -> dict[str, Any]:
    """The snapshot as whoever asks sees it, by a strict parser."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    found = json.loads(snapshot_text(golden_setup(), facts), parse_constant=refuse)
    assert isinstance(found, dict)
    return found


def changed(value: Any) -> Iterator[tuple[str, Any]]:
    """(where, the same with one leaf changed) for every leaf, however deep; fields found by reflection."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            for where, other in changed(getattr(value, field.name)):
                yield f"{field.name}.{where}", replace(value, **{field.name: other})
    elif hasattr(value, "_fields"):
        for name in value._fields:
            for where, other in changed(getattr(value, name)):
                yield f"{name}.{where}", value._replace(**{name: other})
    elif isinstance(value, dict):
        for key, item in value.items():
            for where, other in changed(item):
                yield f"{key}.{where}", {**value, key: other}
    elif isinstance(value, list | tuple):
        for n, item in enumerate(value):
            for where, other in changed(item):
                yield f"{n}.{where}", type(value)([*value[:n], other, *value[n + 1 :]])
    else:
        yield "", another(value)


def another(value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, Enum):
        return next(member for member in type(value) if member is not value)
    if isinstance(value, str):
        return value + "!"
    return 12345 if value is None else value + 1_000_000


def test_whatever_changes_in_the_facts_shows_in_the_snapshot() -> None:
    """A field that is added to LiveFacts or to anything in it must arrive: none is named here."""
    facts = rich_facts()
    before = seen(facts)
    leaves = 0
    for where, other in changed(facts):
        if not any(part in where for part in NOT_SHOWN):
            leaves += 1
            assert seen(other) != before, where
    # The reflection does go deep: six channels of seven, motion, counts by role and message, bins.
    assert leaves > 300


def test_every_kind_of_facts_is_in_the_rich_ones() -> None:
    """So that the test above looks at all of them."""
    facts = rich_facts()
    for field in dataclasses.fields(facts):
        assert getattr(facts, field.name) not in (None, (), {}, []), field.name
    for field in dataclasses.fields(facts.decoder):
        assert getattr(facts.decoder, field.name) not in (None, {}, ()), field.name


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_are_null(bad: float) -> None:
    facts = rich_facts()
    assert facts.row is not None
    spoilt = facts.row.output._replace(
        **{
            name: channel._replace(raw=bad, compensated=bad, offset=bad, offset_std=bad)
            for name, channel in zip(IMU_CHANNELS, facts.row.output.channels, strict=True)
        },
        **{name: bad for name in facts.row.output._fields[6:] if name != "standstill"},
    )
    inputs, ages_s = dict.fromkeys(facts.row.inputs, bad), dict.fromkeys(facts.row.ages_s, bad)
    late = Lateness()
    late.add(1e12)
    found = seen(replace(facts, row=facts.row._replace(output=spoilt, inputs=inputs, ages_s=ages_s), lateness=late))
    for name in IMU_CHANNELS:
        assert [found["channels"][name][key] for key in ("raw", "compensated", "offset", "offset_std")] == [None] * 4
    assert {value for key, value in found["motion"].items() if key != "standstill"} == {None}
    assert {(given["value"], given["age_s"]) for given in found["inputs"].values()} == {(None, None)}
    assert found["lateness"]["bins"] == [[None, 1]]
    shown_at(80, found)


def test_before_the_first_row() -> None:
    """Nothing is known yet: that can be said as well."""
    facts = next(moments())
    empty = replace(
        facts, phase="waiting", row=None, rows=0, now_ns=facts.started_ns, lateness=Lateness(), buses=(), events=()
    )
    found = seen(empty)
    assert found["row"] is None
    assert found["motion"] == {}
    assert {(c["offset"], c["state"], c["reason"]) for c in found["channels"].values()} == {
        (None, "invalid", "no_rows")
    }
    assert found["summary"] == "waiting for frames on can0"
    assert found["lateness"]["mean_us"] is None
    assert "waiting for frames on can0" in shown_at(80, found)


def test_hand_values() -> None:
    facts = last_moment()
    assert facts.row is not None
    yaw = facts.row.output.gyro_z._replace(
        raw=2.0 * DEG, compensated=1.5 * DEG, offset=0.5 * DEG, offset_std=0.01, gate=True, reason=Reason.NONE
    )
    late = Lateness()
    for late_us in (100.0, 200.0, 300.0):
        late.add(late_us)
    row = facts.row._replace(t_ns=5_000_000_000, output=facts.row.output._replace(gyro_z=yaw))
    bus = BusHealth("can0", "socketcan:can0", Link.UP, "kernel", received=1000, sent=500)
    found = seen(
        replace(
            facts,
            started_ns=1_000_000_000,
            now_ns=6_000_000_000,
            row=row,
            buses=(bus,),
            lateness=late,
            state_file=StateFacts("offsets.json", None, 4_000_000_000),
            events=(Event(3_000_000_000, Priority.WARNING, "gap", "silence"), Event(0, Priority.INFO, "start", "hi")),
        )
    )
    assert found["uptime_s"] == pytest.approx(5.0)
    assert found["row"]["age_s"] == pytest.approx(1.0)
    channel = found["channels"]["gyro_z"]
    # 2, 1.5 and 0.5 degrees a second.
    assert [channel[key] for key in ("raw", "compensated", "offset")] == pytest.approx(
        [0.0349066, 0.0261799, 0.0087266], rel=1e-5
    )
    assert (channel["unit"], channel["gate"], channel["reason"]) == ("rad/s", True, "none")
    assert (found["buses"][0]["mean_received_per_s"], found["buses"][0]["mean_sent_per_s"]) == (200.0, 100.0)
    assert found["lateness"]["mean_us"] == pytest.approx(200.0)
    assert found["lateness"]["max_us"] == 300.0
    # Bins are a tenth of a decade wide: a percentile is at most 26 % too high, never above the largest.
    assert 200.0 <= found["lateness"]["p50_us"] <= 252.0
    assert found["lateness"]["p99_us"] == 300.0
    assert sum(count for _, count in found["lateness"]["bins"]) == 3
    assert found["state_file"]["saved_age_s"] == pytest.approx(2.0)
    assert [event["age_s"] for event in found["events"]] == [pytest.approx(3.0), None]
    assert [event["priority"] for event in found["events"]] == ["warning", "info"]


def test_the_line_for_the_supervisor() -> None:
    facts = last_moment()
    assert facts.row is not None

    def output(state: ChannelState, offset_radps: float) -> LiveFacts:
        assert facts.row is not None
        channels = {
            name: channel._replace(state=state)
            for name, channel in zip(IMU_CHANNELS, facts.row.output.channels, strict=True)
        }
        channels["gyro_z"] = channels["gyro_z"]._replace(offset=offset_radps, state=ChannelState.LEARNING)
        return replace(facts, row=facts.row._replace(output=facts.row.output._replace(**channels)))

    known = output(ChannelState.CONVERGED, -0.43 * DEG)
    line = "running on can0: yaw rate -0.43 deg/s offset, 5 of 6 channels converged"
    assert status_line(golden_setup(), known) == line
    assert status_line(golden_setup(), output(ChannelState.INVALID, math.nan)).endswith("0 of 6 channels converged")
    down = replace(known, buses=(BusHealth("can0", "x", Link.BUS_OFF),), output_refused=True)
    words = status_line(golden_setup(), down)
    assert words.startswith("can0 bus off; output refused: another sender on our ids; running on can0")
    assert status_line(golden_setup(), replace(known, row=None)) == "running on can0: no row yet"


def test_the_line_says_how_long_the_bus_has_been_silent() -> None:
    facts = last_moment()
    last_ns = max(counts.last_t_ns or 0 for counts in facts.decoder.messages.values())
    silent = replace(facts, phase="silent", now_ns=last_ns + 12_000_000_000)
    assert status_line(golden_setup(), silent) == "silent on can0: no frames for 12 s, offsets kept"


def test_while_the_bus_is_silent_only_offsets_are_known() -> None:
    """As on the bus: no reading, no motion; ages grow."""
    facts = last_moment()
    assert facts.row is not None
    found = seen(replace(facts, phase="silent", now_ns=facts.row.t_ns + 60_000_000_000))
    for name, channel in found["channels"].items():
        assert (channel["raw"], channel["compensated"], channel["gate"]) == (None, None, False)
        assert (channel["state"], channel["reason"]) == ("invalid", "stale")
        assert channel["offset"] == getattr(facts.row.output, name).offset
    assert found["motion"] == {}
    assert all(given["age_s"] >= 60.0 for given in found["inputs"].values())
    assert "silent on can0" in shown_at(80, found)


def test_the_line_is_one_short_line_whatever_the_names_are() -> None:
    buses = tuple(BusHealth(f"bus\n{n}" * 9, "x", Link.ABSENT) for n in range(9))
    line = status_line(golden_setup(), replace(last_moment(), buses=buses))
    assert len(line) == 120
    assert line.endswith("...")
    assert "\n" not in line


def test_only_what_is_mapped_is_in_it(tmp_path: Path) -> None:
    """A car with yaw rate alone: no word of five gyros and accelerometers that it does not have."""
    setup = golden_setup()
    sources = tuple(s for s in setup.checked.resolved.sources if s.role in ("gyro_z", "wheel_speed_fl"))
    resolved = setup.checked.resolved._replace(sources=sources)
    small = replace(setup, checked=setup.checked._replace(resolved=resolved))
    found = snapshot(small, last_moment())
    assert list(found["channels"]) == ["gyro_z"]
    assert list(found["inputs"]) == ["gyro_z", "wheel_speed_fl"]
    assert found["summary"].endswith("1 of 1 channels converged")


def shown_at(width: int, found: dict[str, Any]) -> str:
    """The tables of `dsz status` on a terminal so many columns wide."""
    console = Console(file=io.StringIO(), width=width, highlight=False, force_terminal=True, color_system=None)
    console.print(status_screen(found))
    file = console.file
    assert isinstance(file, io.StringIO)
    text = file.getvalue()
    assert max(len(line) for line in text.splitlines()) <= width
    return text


def test_the_tables_hold_what_matters_at_80_columns() -> None:
    text = shown_at(80, seen(rich_facts()))
    for words in (
        "roll rate",
        "longitudinal",
        "converged",
        "ENOBUFS",
        "disk full",
        "can1 is bus-off",
        "spike",
        "WHEEL_SPEEDS",
    ):
        assert words in text
    # Each channel keeps its line to itself.
    heads = [line.split()[:2] for line in text.splitlines()]
    assert ["lateral", "m/s^2"] in heads
    assert ["longitudinal", "m/s^2"] in heads


def test_the_command_asks_the_daemon(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s"
    with FakeDaemon(path, every=1000):
        assert cli.main(["status", "--socket", str(path), "--json"]) == 0
        first = json.loads(capsys.readouterr().out)
        assert cli.main(["status", "--socket", str(path)]) == 0
    assert first["rows"] == 1000
    out = capsys.readouterr().out
    assert "2000 rows at 100 Hz" in out
    assert "yaw rate" in out


def test_without_a_daemon_the_command_says_so_and_ends_with_4(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["status", "--socket", str(tmp_path / "s")]) == 4
    assert (
        capsys.readouterr().err
        == f"dsz: no daemon at {tmp_path / 's'}; is `dsz run` running with this status socket?\n"
    )
    assert cli.main(["status", "--socket", "x" * 200]) == 2
    assert "at most 107" in capsys.readouterr().err


def test_the_reader_of_our_output_may_go_away(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "s"):
        command = f"{sys.executable} -m dsz_daemon status --socket {tmp_path / 's'} | true"
        run = subprocess.run(["bash", "-o", "pipefail", "-c", command], check=False, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")


def test_where_the_socket_is() -> None:
    assert socket_path(Path("mine"), {"DSZ_STATUS": "other"}) == Path("mine")
    assert socket_path(None, {"DSZ_STATUS": "other"}) == Path("other")
    assert socket_path(None, {"DSZ_STATUS": ""}) == Path("/run/dsz/status.sock")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b'{"format": 2}', "format 2, expected 1: daemon and command are of different versions"),
        (b"{}", "format None"),
        (b'{"format": 1, "channels": {}}', "lacks versions, motion"),
    ],
)
def test_a_daemon_of_another_version_is_told_apart(tmp_path: Path, text: bytes, words: str) -> None:
    with FakeDaemon(tmp_path / "s", texts=iter([text])), pytest.raises(MachineError, match=words):
        answer(tmp_path / "s")


def test_words_from_the_bus_can_not_steer_the_terminal(tmp_path: Path) -> None:
    facts = last_moment()
    evil = "\x1b]0;owned\x07\x1b[2J\r\n\x9b31m[bold]"
    spoilt = replace(
        facts,
        events=(Event(0, Priority.INFO, "x", evil),),
        buses=(BusHealth("can0", evil, last_error=evil),),
        encoder=replace(facts.encoder, saturated={evil: 1}),
    )
    with FakeDaemon(tmp_path / "s", texts=iter([snapshot_text(golden_setup(), spoilt)])):
        text = shown_at(200, answer(tmp_path / "s"))
    assert all(character.isprintable() or character == "\n" for character in text)
    # Neither lost nor taken for rich's markup.
    assert "?]0;owned??[2J???31m[bold]" in text


def test_being_asked_for_an_hour_leaves_nothing_behind() -> None:
    """Not even in the interpreter's free lists, which keep 2000 tuples of each length: blocks that stay allocated."""
    facts = rich_facts()
    doubted = tuple(channel._replace(reason=Reason.DOUBTED) for channel in facts.row.output.channels[:3])
    output = facts.row.output._replace(**dict(zip(IMU_CHANNELS[:3], doubted, strict=True)))
    facts = replace(facts, row=facts.row._replace(output=output))

    def asked() -> None:
        snapshot_text(golden_setup(), facts)
        seen_by_the_watchman(facts)

    with Buses({"one": {"interface": "virtual", "channel": "asked"}}) as buses:
        # A whole collection empties those lists: what set-up left in them would hide that they grow.
        gc.collect()
        gc.disable()
        try:
            allocated = []
            for times in (100, 1000):
                for _ in range(times):
                    asked()
                    assert len(buses.health) == 1
                allocated.append(sys.getallocatedblocks())
        finally:
            gc.enable()
    assert allocated[1] - allocated[0] < 100
