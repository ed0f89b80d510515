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
# A coarser sensor has shown that by its own longest repeat: the same factor is allowed on that.
_PATIENCE = 3
# Wheel speeds of a car that drives change within 0.44 s there; a car at rest shakes no sensor.
_WHEELS_CHANGE_NS = 500_000_000
# What was never seen alive can't be told from a very coarse sensor: `plausibility` speaks of that.
_ALIVE_CHANGES = 20


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
        role = sample.role
        if role not in _LARGEST_JUMP:
            if role in WHEEL_SPEEDS:
                if self.wheels.get(role, sample.value) != sample.value:
                    self.wheels_changed_ns = sample.t_ns
                self.wheels[role] = sample.value
            return (sample,)
        old = self.seen.get(role, _Seen())
        last, suspect, changes, still_ns, longest_ns = old
        if last is None:
            self.seen[role] = old._replace(last=sample)
            return (sample,)
        if still_ns == 0 and suspect is None and 0.0 < abs(sample.value - last.value) <= _LARGEST_JUMP[role]:
            # Nearly every sample; the rest of this method comes to the same.
            self.seen[role] = _Seen(sample, None, changes + 1, 0, longest_ns)
            return (sample,)
        patience_ns = max(_PATIENCE_NS[role], _PATIENCE * longest_ns)
        old = self._lived(old, last, sample, patience_ns)
        if old.changes >= _ALIVE_CHANGES and old.still_ns > patience_ns:
            self.seen[role] = old._replace(last=sample)
            self.refused.append(Refusal(role, "frozen"))
            return ()
        return self._without_spike(old, sample, _LARGEST_JUMP[role])

    def forget(self) -> None:
        """What comes after a gap or a clock step is not compared with what was before it."""
        for role, old in self.seen.items():
            self.seen[role] = old._replace(last=None, suspect=None, still_ns=0)
        self.wheels.clear()
        self.wheels_changed_ns = None

    def _lived(self, old: _Seen, last: Sample, sample: Sample, patience_ns: int) -> _Seen:
        """The channel's signs of life with one more sample."""
        if sample.value != last.value:
            went_on_ns = old.still_ns if old.still_ns <= patience_ns else 0
            return old._replace(changes=old.changes + 1, still_ns=0, longest_ns=max(old.longest_ns, went_on_ns))
        changed_ns = self.wheels_changed_ns
        if changed_ns is None or not 0 <= sample.t_ns - changed_ns < _WHEELS_CHANGE_NS:
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
