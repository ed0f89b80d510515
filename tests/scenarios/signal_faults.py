"""Faults of single signals and of time, as changes to the frames of the short drive."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence

import short_drive as sd
from short_drive import ACCELS, PEDALS, RATES, STEER, WHEELS, Sent

Frames = Sequence[Sent]
Fault = Callable[[Frames], Frames]

# Message, layout and place of each role's raw value, and the largest that it can hold.
WORDS = {channel: (RATES if n < 3 else ACCELS, "<3h", n % 3, 32767) for n, channel in enumerate(sd.OFFSETS)}
WORDS |= {f"wheel_speed_{wheel}": (WHEELS, ">4H", n, 65535) for n, wheel in enumerate(("fl", "fr", "rl", "rr"))}
WORDS |= {"steering_wheel_angle": (STEER, ">h", 0, 32767), "brake": (PEDALS, "<B", 0, 255)}


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


def message_frozen(can_id: int, start_s: float) -> Fault:
    """All of a message, as a gateway repeats what it has."""

    def change(sent: Frames) -> Frames:
        last = [frame.data for frame in sent if frame.can_id == can_id and frame.t_s < start_s][-1]
        return [f._replace(data=last) if f.can_id == can_id and f.t_s >= start_s else f for f in sent]

    return change


def twice(sent: Frames) -> Frames:
    return [frame for frame in sent for _ in range(2)]


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
