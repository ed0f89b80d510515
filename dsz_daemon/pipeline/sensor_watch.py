"""IMU samples that no moving car can produce: single spikes, and a sensor that has frozen.

Both pass every bound on a value, and both poison offsets: a spike through the observer, which
remembers it, a frozen reading by being learnt from. They are refused here, before anything is
averaged, and a refused sample is as good as one that never came: its channel goes stale.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from dsz_daemon.pipeline.mapping import Sample
from dsz_daemon.pipeline.rows import Refusal
from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS, WHEEL_SPEEDS

# About three times the largest step between two samples in recordings of real cars: 0.36 rad/s and
# 9.5 m/s^2, both of a phone on a dashboard (104 Hz); the cars' own IMUs stay below 0.02 and 5.1.
_LARGEST_JUMP = dict.fromkeys(GYRO_CHANNELS, 1.0) | dict.fromkeys(ACCEL_CHANNELS, 30.0)
# Three times the longest that a working sensor repeated itself while the wheels' speed changed, in
# the same recordings: 0.97 s (a yaw rate in steps of 0.24 deg/s) and 0.31 s (accelerations at 10 Hz).
_PATIENCE_NS = dict.fromkeys(GYRO_CHANNELS, 3_000_000_000) | dict.fromkeys(ACCEL_CHANNELS, 1_000_000_000)
# Wheel speeds of a car that drives change within 0.44 s there; a car at rest shakes no sensor.
_WHEELS_CHANGE_NS = 500_000_000
# A sensor that was never seen alive may be a very coarse one: `plausibility` speaks of that.
_ALIVE_CHANGES = 20


class _Seen(NamedTuple):
    """One channel: its last sample, one that jumped off and waits for its next, signs of life, time frozen."""

    last: Sample
    suspect: Sample | None = None
    changes: int = 0
    still_ns: int = 0


@dataclass
class SensorWatch:
    """Passes samples on, one or (where a jump turns out to be real) two at a time, or refuses them.

    `refused` gathers refusals until somebody takes them.
    """

    seen: dict[str, _Seen] = field(default_factory=dict)
    wheels: dict[str, float] = field(default_factory=dict)
    wheels_changed_ns: int | None = None
    refused: list[Refusal] = field(default_factory=list)

    def passed(self, sample: Sample) -> tuple[Sample, ...]:
        """What of this sample, and of the one before it, can be used."""
        limit = _LARGEST_JUMP.get(sample.role)
        if limit is None:
            if sample.role in WHEEL_SPEEDS:
                if self.wheels.get(sample.role, sample.value) != sample.value:
                    self.wheels_changed_ns = sample.t_ns
                self.wheels[sample.role] = sample.value
            return (sample,)
        old = self.seen.get(sample.role)
        if old is None:
            self.seen[sample.role] = _Seen(sample)
            return (sample,)
        return self._without_spike(old, sample, limit) if self._is_alive(old, sample) else ()

    def forget(self) -> None:
        """What comes after a gap or a clock step is not compared with what was before it."""
        self.seen.clear()
        self.wheels.clear()
        self.wheels_changed_ns = None

    def _is_alive(self, old: _Seen, sample: Sample) -> bool:
        """Whether the channel still moves, as it did before, while the car does."""
        role = sample.role
        if sample.value != old.last.value:
            self.seen[role] = old._replace(changes=old.changes + 1, still_ns=0)
            return True
        changed_ns = self.wheels_changed_ns
        is_moving = changed_ns is not None and 0 <= sample.t_ns - changed_ns < _WHEELS_CHANGE_NS
        still_ns = old.still_ns + (max(0, sample.t_ns - old.last.t_ns) if is_moving else 0)
        self.seen[role] = old._replace(last=sample, still_ns=still_ns)
        if old.changes < _ALIVE_CHANGES or still_ns <= _PATIENCE_NS[role]:
            return True
        self.refused.append(Refusal(role, "frozen"))
        return False

    def _without_spike(self, old: _Seen, sample: Sample, limit: float) -> tuple[Sample, ...]:
        """A sample that jumps off is used once the next one stays with it; one that does not was a spike."""
        role, suspect = sample.role, old.suspect
        is_near = abs(sample.value - old.last.value) <= limit
        if suspect is not None and abs(sample.value - suspect.value) <= limit:
            self.seen[role] = self.seen[role]._replace(last=sample, suspect=None)
            return (suspect, sample)
        if suspect is not None:
            self.refused.append(Refusal(role, "spike"))
        if is_near:
            self.seen[role] = self.seen[role]._replace(last=sample, suspect=None)
            return (sample,)
        self.seen[role] = self.seen[role]._replace(suspect=sample)
        return ()
