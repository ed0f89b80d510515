"""A minute on a kernel's vcan0: no frame lost, and what was sent is what `dsz replay` makes of the same bus.

How late ticks were is printed, for dsz, dsz being watched and a peer, and judged by nobody here: a guest's CPU is a
program of this machine, which has other things to do at times. That none is missed is judged by the first of three
minutes in which it holds, and not at all where a witness outside of the guest was itself held up, in each of them as
often as ticks were missed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import throughput
import yaml
from live_equals_replay import Compared, output_messages

pytestmark = [pytest.mark.vcan, pytest.mark.quiet, pytest.mark.xdist_group("guest")]

SECONDS = {"nobody": 15.0, "dsz": 60.0, "watched": 30.0, "peer": 20.0}
MINUTES = 3

Ways = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def ways(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ways]:
    """What each way cost. Skips, with the reason, where there is no vcan."""
    found: Ways = {}
    for who, seconds in SECONDS.items():
        what = throughput.drive(tmp_path_factory.mktemp("drive"), seconds)
        for _ in range(MINUTES if who == "dsz" else 1):
            out = tmp_path_factory.mktemp(who)
            try:
                result = throughput.played(what, out, who, seconds)
            except SystemExit as ended:
                if ended.code == throughput.NO_WAY:
                    pytest.skip("no vcan in this kernel and no way to a guest that has it (see standard error)")
                raise
            row = {**throughput.figures(result, what.frames), "result": result, "out": out, "of": what}
            found[who] = {**row, "earlier": [*found[who]["earlier"], found[who]] if who in found else []}
            if not row["missed"]:
                break
            print("\n" + throughput.table([found[who]]) + throughput.hitched([found[who]]))
    yield found
    # At the end, when pytest shows what a module's fixtures say.
    print("\n" + throughput.report(list(found.values())))


@pytest.fixture(scope="module")
def compared(ways: Ways) -> Compared:
    """The minute's record against a replay of it."""
    return Compared(ways["dsz"]["out"], ways["dsz"]["of"].config, output_messages())


@pytest.mark.parametrize("who", ["dsz", "watched"])
def test_every_frame_is_read_and_every_tick_accounted_for(ways: Ways, who: str) -> None:
    row = ways[who]
    assert (row["lost"], row["dropped"], row["result"]["exit"]) == (0, 0, 0), throughput.table([row])
    # 100 a second, and some more until it is told to stop.
    assert row["rows"] >= SECONDS[who] * 100 - 20


def test_no_tick_is_missed(ways: Ways) -> None:
    """In one of three minutes at most."""
    row = ways["dsz"]
    minutes = [*row["earlier"], row]
    # A hitch costs one tick at most here and there; a daemon that misses more than that misses them by itself.
    if row["missed"] and all(minute["missed"] <= len(minute["result"]["hitches_here"]) for minute in minutes):
        pytest.skip(f"this machine does not hold still: {throughput.hitched(minutes)}")
    assert row["missed"] == 0, throughput.table(minutes)


def test_stamps_are_the_kernels(ways: Ways) -> None:
    buses = ways["dsz"]["result"]["summary"]["live"]["buses"]
    assert {bus["stamps"] for bus in buses.values()} == {"kernel"}


def test_all_watchers_were_answered(ways: Ways) -> None:
    answers = ways["watched"]["result"]["answers"]
    assert answers["status"] > SECONDS["watched"]
    assert answers["metrics"] > 0.3 * SECONDS["watched"]


def test_what_was_sent_is_what_replay_makes_of_the_same_bus(ways: Ways, compared: Compared) -> None:
    """By candump's record: CRC right by another implementation, values to one LSB, every frame of every message."""
    assert compared.frames > 2 * 90 * SECONDS["dsz"]
    assert (compared.different, compared.missing) == (0, 0)


def test_only_what_is_said_to_be_missed_was_not_sent(ways: Ways, compared: Compared) -> None:
    """The alive counters leap for just those ticks that the daemon itself says it missed."""
    missed = ways["dsz"]["missed"]
    assert len(compared.silences) <= missed
    assert 2 * missed <= compared.not_sent <= len(output_messages()) * missed


def test_a_wrong_sign_would_be_seen(ways: Ways, tmp_path: Path) -> None:
    """The same comparison against a replay of the same bus with the yaw rate reversed."""
    last = ways["dsz"]
    config = yaml.safe_load(last["of"].config.read_text())
    gyro = config["signals"]["gyro_z"]
    gyro["sign"] = -gyro.get("sign", 1)
    dbc = config["signals"]["dbc"]
    files = [dbc] if isinstance(dbc, str) else dbc
    config["signals"]["dbc"] = [
        name if name.startswith("pkg:") else str((last["of"].config.parent / name).resolve()) for name in files
    ]
    (tmp_path / "reversed.yaml").write_text(yaml.safe_dump(config))
    out = tmp_path / "out"
    out.mkdir()
    (out / "bus.log").write_bytes((last["out"] / "bus.log").read_bytes())
    wrong = Compared(out, tmp_path / "reversed.yaml", output_messages())
    assert wrong.different > 1000
