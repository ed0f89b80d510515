"""One signal at a time cut, spiked, frozen, late or out of order: what is published and said, what offsets do.

The stated bound: no fault moves an offset by more than 0.05 deg/s or 0.05 m/s^2 from what the same
drive gives without it (a channel that merely stops to learn has not moved).
"""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import short_drive as sd
from scenario_results import Called, Replayed, moved, read_results
from short_drive import ACCELS, CONFIG, PEDALS, RATES, STEER, WHEELS, Sent

Dsz = Callable[..., Called]
Frames = Sequence[Sent]
Fault = Callable[[Frames], Frames]
pytestmark = pytest.mark.usefixtures("without_report")

BOUND = {channel: 0.05 * sd.DEG if channel.startswith("gyro") else 0.05 for channel in sd.OFFSETS}
GYROS, ACCELEROMETERS = tuple(sd.OFFSETS)[:3], tuple(sd.OFFSETS)[3:]
# Message, layout and place of each role's raw value, and the largest that it can hold.
WORDS = {channel: (RATES if n < 3 else ACCELS, "<3h", n % 3, 32767) for n, channel in enumerate(sd.OFFSETS)}
WORDS |= {f"wheel_speed_{wheel}": (WHEELS, ">4H", n, 65535) for n, wheel in enumerate(("fl", "fr", "rl", "rr"))}
WORDS |= {"steering_wheel_angle": (STEER, ">h", 0, 32767), "brake": (PEDALS, "<B", 0, 255)}


# Faults


def raw(role: str, change: Callable[[float, int], int]) -> Fault:
    """The role's raw value changed: change(t_s, raw)."""
    can_id, layout, place, _ = WORDS[role]

    def one(t_s: float, *values: int) -> Sequence[int]:
        return [change(t_s, x) if n == place else x for n, x in enumerate(values)]

    return lambda sent: sd.words_changed(sent, can_id, layout, one)


def constant(role: str, value: int, start_s: float) -> Fault:
    return raw(role, lambda t_s, x: value if t_s >= start_s else x)


def frozen(role: str, start_s: float, end_s: float = math.inf) -> Fault:
    last = 0

    def change(t_s: float, x: int) -> int:
        nonlocal last
        last = x if not start_s <= t_s < end_s else last
        return last

    return raw(role, change)


def spiked(role: str, value: int | None = None, start_s: float = 12.0) -> Fault:
    """One sample every second at `value`, by default the end of its range."""
    spike, can_id = WORDS[role][3] if value is None else value, WORDS[role][0]

    def change(sent: Frames) -> Frames:
        stamps = [frame.t_s for frame in sent if frame.can_id == can_id and frame.t_s >= start_s]
        firsts = {next(t_s for t_s in stamps if t_s >= second) for second in range(math.ceil(start_s), 26)}
        return raw(role, lambda t_s, x: spike if t_s in firsts else x)(sent)

    return change


def cut(can_ids: Sequence[int], start_s: float, end_s: float = math.inf) -> Fault:
    return lambda sent: [f for f in sent if not (f.can_id in can_ids and start_s <= f.t_s < end_s)]


def delayed(can_ids: Sequence[int], delay_s: float) -> Fault:
    return lambda sent: sorted(f._replace(t_s=f.t_s + delay_s) if f.can_id in can_ids else f for f in sent)


def all_zero(can_ids: Sequence[int], start_s: float) -> Fault:
    return lambda sent: [
        f._replace(data=bytes(len(f.data))) if f.can_id in can_ids and f.t_s >= start_s else f for f in sent
    ]


def all_bits_set(can_ids: Sequence[int], start_s: float) -> Fault:
    return lambda sent: [
        f._replace(data=b"\xff" * len(f.data)) if f.can_id in can_ids and f.t_s >= start_s else f for f in sent
    ]


def half_rate(sent: Frames) -> Frames:
    """Every other frame of the IMU, as of an IMU that sends at 50 Hz."""
    kept, seen = [], {RATES: 0, ACCELS: 0}
    for frame in sent:
        if frame.can_id in seen:
            seen[frame.can_id] += 1
            if seen[frame.can_id] % 2:
                continue
        kept.append(frame)
    return kept


def reordered(sent: Frames) -> Frames:
    """Each frame up to 20 ms later in the file than its stamp says."""
    chance = random.Random(3)
    return [frame for _, frame in sorted((frame.t_s + chance.uniform(0.0, 0.02), frame) for frame in sent)]


def clock_stepped(step_s: float) -> Fault:
    return lambda sent: [f._replace(t_s=f.t_s + step_s) if f.t_s >= 21.0 else f for f in sent]


def one_far_ahead(sent: Frames) -> Frames:
    at = next(n for n, frame in enumerate(sent) if frame.can_id == RATES and frame.t_s > 21.0)
    return [*sent[:at], sent[at]._replace(t_s=sent[at].t_s + 1e6), *sent[at:]]


# Replays


def run(dsz: Dsz, folder: Path, sent: Frames, config: str = CONFIG) -> Replayed:
    log, path = sd.write(folder, sent, config)
    called = dsz("replay", log, "-c", path, "-o", folder / "out", "--json")
    assert called.code == 0, called.err
    json.loads(called.out)
    return read_results(folder / "out")


class Case(NamedTuple):
    """A fault, when it begins, and what is true of the run.

    `said`: patterns that each a warning must match; other warnings are allowed only where there
    are any. `states`: (channels, start, end) -> the only state in that time. `exact`: channels whose
    offset must not move at all after that many seconds of the fault.
    """

    fault: Fault
    start_s: float
    said: tuple[str, ...] = ()
    states: tuple[tuple[tuple[str, ...], float, float, str], ...] = ()
    exact: tuple[str, ...] = ()
    exact_after_s: float = 0.5
    counts: dict[str, Any] = {}  # noqa: RUF012 - never changed


SPIKE = "14 values not used: single samples that jump off and back"
FROZEN = "values not used: it repeated itself while the wheels' speed changed: a frozen sensor"
CASES: dict[str, Case] = {
    # Single IMU signals. Spikes: refused one by one, nothing else changes. Frozen or dead: noticed within
    # 1 s (accelerometers) or 3 s (gyros) of driving and stale 0.5 s later.
    **{f"{channel} spiked": Case(spiked(channel), 12.0, (f"{channel}: {SPIKE}",)) for channel in sd.OFFSETS},
    **{
        f"{channel} frozen in a bend": Case(
            frozen(channel, 14.2), 14.2, (f"{channel}: [0-9]+ {FROZEN}",), (((channel,), 18.0, 26.0, "invalid"),)
        )
        for channel in sd.OFFSETS
    },
    **{
        f"{channel} zero": Case(
            constant(channel, 0, 12.0), 12.0, (f"{channel}: [0-9]+ {FROZEN}",), (((channel,), 15.6, 26.0, "invalid"),),
            (channel,), 3.6,
        )
        for channel in sd.OFFSETS
    },
    **{
        f"{channel} all bits set": Case(
            constant(channel, -1, 12.0), 12.0, (f"{channel}: [0-9]+ {FROZEN}",),
            (((channel,), 15.6, 26.0, "invalid"),), (channel,), 3.6,
        )
        for channel in ("gyro_z", "accel_y", "accel_z")
    },
    "accel_x frozen while braking": Case(
        frozen("accel_x", 19.2), 19.2, (f"accel_x: [0-9]+ {FROZEN}",), ((("accel_x",), 20.8, 26.0, "invalid"),)
    ),
    "gyro_z frozen for 5 s": Case(
        frozen("gyro_z", 13.0, 18.0), 13.0, (f"gyro_z: [0-9]+ {FROZEN}",),
        ((("gyro_z",), 16.7, 17.9, "invalid"), (("gyro_z",), 18.1, 26.0, "converged")),
    ),
    # Wheels. One that disagrees closes the gate of accel_x; none at all: no speed, no accelerometer learns.
    "wheel_speed_rl spiked": Case(spiked("wheel_speed_rl"), 12.0, (r"wheel_speed_rl: 14 of 1300 values refused .*range 14",)),
    "wheel_speed_rl spiked within its range": Case(spiked("wheel_speed_rl", 43_000), 12.0),
    "wheel_speed_rl frozen": Case(frozen("wheel_speed_rl", 14.2), 14.2),
    "wheel_speed_rl zero": Case(constant("wheel_speed_rl", 0, 12.0), 12.0),
    "wheel_speed_rl all bits set": Case(
        constant("wheel_speed_rl", 65_535, 12.0), 12.0,
        ("wheel_speed_rl: 700 of 1300 values refused", "wheel_speed_rl: no value in the last 14.0 s of the run"),
    ),
    "all wheels cut for 3 s": Case(
        cut([WHEELS], 12.0, 15.0), 12.0, (r"can0 0AA: 150 frames .* \(longest gap 3.02 s\)",), (), ACCELEROMETERS[:0]
    ),
    "all wheels cut for good": Case(
        cut([WHEELS], 12.0), 12.0,
        ("wheel_speed_fl, wheel_speed_fr, wheel_speed_rl, wheel_speed_rr: no value in the last 14.0 s",),
        (), ACCELEROMETERS,
    ),
    "all wheels all bits set": Case(all_bits_set([WHEELS], 12.0), 12.0, ("wheel_speed_fl: 700 of 1300",), (), ACCELEROMETERS),
    "all wheels frozen in a bend": Case(
        lambda sent: sd.words_changed(sent, WHEELS, ">4H", lambda t_s, *v: v if t_s < 14.2 else (4320, 4400, 4310, 4390)), 14.2
    ),
    "all wheels 100 ms late": Case(delayed([WHEELS], 0.1), 0.0),
    # Steering and brake.
    "steering_wheel_angle spiked": Case(spiked("steering_wheel_angle"), 12.0, ("steering_wheel_angle: 14 of 1300 values refused",)),
    "steering_wheel_angle spiked within its range": Case(spiked("steering_wheel_angle", 3000), 12.0),
    "steering_wheel_angle frozen in a bend": Case(frozen("steering_wheel_angle", 14.2), 14.2),
    "steering_wheel_angle zero": Case(constant("steering_wheel_angle", 0, 12.0), 12.0),
    "steering cut for 3 s": Case(cut([STEER], 12.0, 15.0), 12.0, (r"can0 025: 150 frames .* \(longest gap 3.02 s\)",)),
    "steering cut for good": Case(cut([STEER], 12.0), 12.0, ("steering_wheel_angle: no value in the last 14.0 s",)),
    "steering 100 ms late": Case(delayed([STEER], 0.1), 0.0),
    "brake on for good": Case(constant("brake", 1, 12.0), 12.0),
    "brake cut for good": Case(cut([PEDALS], 12.0), 12.0, ("brake: no value in the last 14.0 s",)),
    # The IMU as a whole.
    "gyros cut for 3 s": Case(
        cut([RATES], 12.0, 15.0), 12.0, (r"can1 310: 300 frames .* \(longest gap 3.01 s\)",),
        ((GYROS, 12.6, 14.98, "invalid"), (GYROS, 15.1, 26.0, "converged")),
    ),
    "IMU cut for good": Case(
        cut([RATES, ACCELS], 12.0), 12.0, (f"{', '.join(sorted(sd.OFFSETS))}: no value in the last 14.0 s of the run",),
        ((tuple(sd.OFFSETS), 12.6, 26.0, "invalid"),), tuple(sd.OFFSETS),
    ),
    "IMU all zero": Case(all_zero([RATES, ACCELS], 12.0), 12.0, (f"gyro_x: [0-9]+ {FROZEN}", f"accel_z: [0-9]+ {FROZEN}")),
    "IMU at half its rate": Case(half_rate, 0.0),
    "all frames twice": Case(lambda sent: [frame for frame in sent for _ in range(2)], 0.0),
    "all frames out of order within 20 ms": Case(reordered, 0.0, (r"stamps go backwards [0-9]+ times, by up to 0\.0[12]",)),
    "IMU 100 ms late": Case(delayed([RATES, ACCELS], 0.1), 0.0),
    # Time.
    "all silent for 0.5 s": Case(cut(range(2048), 21.0, 21.5), 21.0, (r"can1 310: 50 frames",), (), (), 0.0, {"gaps": 0}),
    "all silent for 5 s": Case(cut(range(2048), 20.0, 25.0), 20.0, (r"can1 310: 500 frames",), (), (), 0.0, {"gaps": 1}),
    "clock put forward by an hour": Case(clock_stepped(3600.0), 21.0, ("can1 310: ",), (), (), 0.0, {"gaps": 1, "clock_steps": 0}),
    "clock put back by an hour": Case(
        clock_stepped(-3600.0), 21.0, ("stamps go backwards 1 times, by up to 3599.99",), (), (), 0.0,
        {"gaps": 0, "clock_steps": 1},
    ),
    "one stamp far ahead": Case(
        one_far_ahead, 21.0, ("gyro_z: 1 values not used: their time is far ahead", "stamps go backwards 1 times"), (), (),
        0.0, {"gaps": 0, "clock_steps": 0},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_one_fault(dsz: Dsz, drive: Frames, clean: Replayed, tmp_path: Path, name: str) -> None:
    case = CASES[name]
    faulty = run(dsz, tmp_path, case.fault(drive))
    summary = faulty.summary
    beyond = {c: distance for c, distance in moved(faulty, clean, case.start_s).items() if distance > BOUND[c]}
    assert not beyond
    for pattern in case.said:
        assert any(re.match(pattern, warning) for warning in summary["warnings"]), summary["warnings"]
    assert case.said or not summary["warnings"], summary["warnings"]
    for channels, start_s, end_s, state in case.states:
        for channel in channels:
            assert faulty.states(channel, start_s, end_s) == {state}, channel
    for channel in case.exact:
        assert len(set(faulty.offsets(channel, case.start_s + case.exact_after_s + 0.1))) == 1, channel
    assert {key: summary["counts"][key] for key in case.counts} == case.counts
