"""Samples that no moving car can produce: single spikes, and sensors that have frozen.

Both pass every bound on a value, and both poison offsets: a spike through the observer, which
remembers it, a frozen reading by being learnt from. They are refused here, before anything is
averaged, and a refused sample is as good as one that never came: its channel goes stale.

Wheels tell whether the car moves, so an IMU channel that repeats itself meanwhile is frozen. Wheels
that all repeat themselves are frozen when they were seen to jitter before (every real wheel speed does,
in its last digits; a simulated one may not) and turn too fast to be silent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from dsz_daemon.pipeline.mapping import Sample
from dsz_daemon.pipeline.rows import Refusal
from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS, WHEEL_SPEEDS


class WatchLimits(NamedTuple):
    """When a value is a spike and a sensor frozen; `config.watch` gives the reasons for these numbers."""

    gyro_jump_radps: float = 1.0
    accel_jump_mps2: float = 30.0
    gyro_patience_ns: int = 3_000_000_000
    accel_patience_ns: int = 1_000_000_000
    wheel_patience_ns: int = 1_000_000_000
    wheel_step_mps: float = 0.03
    wheel_speed_mps: float = 3.0
    patience_factor: float = 3.0
    wheels_change_ns: int = 500_000_000
    alive_changes: int = 20


_DEFAULT = WatchLimits()


class _Seen(NamedTuple):
    """One channel's memory.

    Its last sample, one that jumped off and waits for its next, how often it changed, for how long
    it has repeated itself while the car moved, and the longest that it did and then went on.
    """

    last: Sample | None = None
    suspect: Sample | None = None
    changes: int = 0
    still_ns: int = 0
    longest_ns: int = 0


@dataclass
class _Wheels:
    """All wheels' memory: last value and last step of each, and when any of them changed.

    `jitters` counts steps back right after a step forth (and the reverse), `finest_mps` is the smallest
    step; `still_ns` is for how long all have repeated themselves, `longest_ns` the longest that they did
    and then went on; both while fast.
    """

    values: dict[str, float] = field(default_factory=dict)
    steps: dict[str, float] = field(default_factory=dict)
    changed_ns: int | None = None
    seen_ns: int = 0
    jitters: int = 0
    finest_mps: float = math.inf
    still_ns: int = 0
    longest_ns: int = 0


@dataclass
class SensorWatch:
    """Passes samples on, one or (where a jump turns out to be real) two at a time, or refuses them.

    `refused` gathers refusals until somebody takes them.
    """

    limits: WatchLimits = _DEFAULT
    seen: dict[str, _Seen] = field(default_factory=dict)
    wheels: _Wheels = field(default_factory=_Wheels)
    refused: list[Refusal] = field(default_factory=list)

    def __post_init__(self) -> None:
        limits = self.limits
        gyros, accels = dict.fromkeys(GYRO_CHANNELS), dict.fromkeys(ACCEL_CHANNELS)
        self._largest_jump = dict.fromkeys(gyros, limits.gyro_jump_radps)
        self._largest_jump |= dict.fromkeys(accels, limits.accel_jump_mps2)
        self._patience_ns = dict.fromkeys(gyros, limits.gyro_patience_ns)
        self._patience_ns |= dict.fromkeys(accels, limits.accel_patience_ns)

    def passed(self, sample: Sample) -> tuple[Sample, ...]:
        """What of this sample, and of the one before it, can be used."""
        role = sample.role
        limit = self._largest_jump.get(role)
        if limit is None:
            return (sample,) if role not in WHEEL_SPEEDS or self._turns(sample) else ()
        old = self.seen.get(role, _Seen())
        last, suspect, changes, still_ns, longest_ns = old
        if last is None:
            self.seen[role] = old._replace(last=sample)
            return (sample,)
        if still_ns == 0 and suspect is None and 0.0 < abs(sample.value - last.value) <= limit:
            # Nearly every sample; the rest of this method comes to the same.
            self.seen[role] = _Seen(sample, None, changes + 1, 0, longest_ns)
            return (sample,)
        patience_ns = self._patience(self._patience_ns[role], longest_ns)
        old = self._lived(old, last, sample, patience_ns)
        if old.changes >= self.limits.alive_changes and old.still_ns > patience_ns:
            self.seen[role] = old._replace(last=sample)
            self.refused.append(Refusal(role, "frozen"))
            return ()
        return self._without_spike(old, sample, limit)

    def forget(self) -> None:
        """What comes after a gap or a clock step is not compared with what was before it."""
        for role, old in self.seen.items():
            self.seen[role] = old._replace(last=None, suspect=None, still_ns=0)
        wheels = self.wheels
        wheels.values.clear()
        wheels.steps.clear()
        wheels.changed_ns, wheels.still_ns = None, 0

    def _patience(self, patience_ns: int, longest_ns: int) -> float:
        return max(patience_ns, self.limits.patience_factor * longest_ns)

    def _turns(self, sample: Sample) -> bool:
        """Takes a wheel's sample into account; whether it can be used."""
        wheels, limits = self.wheels, self.limits
        t_ns, role, value = sample
        step = value - wheels.values.get(role, value)
        wheels.values[role] = value
        is_fast = value > limits.wheel_speed_mps
        if step != 0.0:
            wheels.finest_mps = min(wheels.finest_mps, abs(step))
            wheels.jitters += is_fast and step * wheels.steps.get(role, 0.0) < 0.0
            if wheels.still_ns <= self._patience(limits.wheel_patience_ns, wheels.longest_ns):
                wheels.longest_ns = max(wheels.longest_ns, wheels.still_ns)
            wheels.still_ns, wheels.changed_ns, wheels.seen_ns = 0, t_ns, t_ns
        elif is_fast:
            wheels.still_ns += max(0, t_ns - wheels.seen_ns) if wheels.changed_ns is not None else 0
            wheels.seen_ns = t_ns
        wheels.steps[role] = step
        is_fine = wheels.jitters >= limits.alive_changes and wheels.finest_mps <= limits.wheel_step_mps
        if is_fine and wheels.still_ns > self._patience(limits.wheel_patience_ns, wheels.longest_ns):
            self.refused.append(Refusal(role, "frozen"))
            return False
        return True

    def _lived(self, old: _Seen, last: Sample, sample: Sample, patience_ns: float) -> _Seen:
        """The channel's signs of life with one more sample."""
        if sample.value != last.value:
            went_on_ns = old.still_ns if old.still_ns <= patience_ns else 0
            return old._replace(changes=old.changes + 1, still_ns=0, longest_ns=max(old.longest_ns, went_on_ns))
        changed_ns = self.wheels.changed_ns
        if changed_ns is None or not 0 <= sample.t_ns - changed_ns < self.limits.wheels_change_ns:
            return old
        return old._replace(still_ns=old.still_ns + max(0, sample.t_ns - last.t_ns))

    def _without_spike(self, old: _Seen, sample: Sample, limit: float) -> tuple[Sample, ...]:
        """A sample that jumps off is used once the next one stays with it; one that does not was a spike."""
        role, suspect, last = sample.role, old.suspect, old.last
        passed: tuple[Sample, ...] = (sample,)
        if suspect is not None and abs(sample.value - suspect.value) <= limit:
            passed = (suspect, sample)
        else:
            if suspect is not None:
                self.refused.append(Refusal(role, "spike"))
            if last is not None and abs(sample.value - last.value) > limit:
                self.seen[role] = old._replace(suspect=sample)
                return ()
        self.seen[role] = old._replace(last=sample, suspect=None)
        return passed
