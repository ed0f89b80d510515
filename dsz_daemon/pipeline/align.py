"""Asynchronous samples onto the fixed-rate grid: causal, with true sample times.

IMU channels faster than the loop are averaged over the tick's own interval; everything else,
and a slower IMU, is held, with its age, until it is too old to be used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from dsz_daemon.pipeline.mapping import Sample
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES

_AVERAGED = frozenset(IMU_CHANNELS)
# Switches come at a few Hz and change rarely: they stay good for this many times longer.
SWITCH_PATIENCE = 5.0
SWITCHES = frozenset(name for name, quantity in QUANTITIES.items() if quantity.si_unit in {"1", "degC"})


class Held(NamedTuple):
    """One role's memory: last value and stamp, and the running sum since the last tick."""

    t_ns: int
    value: float
    total: float
    samples: int


@dataclass
class Aligner:
    """Holds the latest samples; `aligned` reads them at a tick and begins the next interval."""

    stale_after_ns: int
    held: dict[str, Held] = field(default_factory=dict)

    def take(self, sample: Sample) -> None:
        """One sample in. A late one never replaces a newer value, but joins the running mean."""
        old = self.held.get(sample.role)
        if old is None:
            self.held[sample.role] = Held(sample.t_ns, sample.value, sample.value, 1)
        elif sample.t_ns < old.t_ns:
            self.held[sample.role] = old._replace(total=old.total + sample.value, samples=old.samples + 1)
        else:
            self.held[sample.role] = Held(sample.t_ns, sample.value, old.total + sample.value, old.samples + 1)

    def aligned(self, t_ns: int) -> tuple[dict[str, float], dict[str, float]]:
        """Values (SI, NaN when stale) and ages (s) of all roles seen, at the tick t_ns."""
        values: dict[str, float] = {}
        ages: dict[str, float] = {}
        for role, held in self.held.items():
            value = held.value
            if held.samples:
                if role in _AVERAGED:
                    value = held.total / held.samples
                self.held[role] = Held(held.t_ns, value, 0.0, 0)
            age_ns = t_ns - held.t_ns
            patience = SWITCH_PATIENCE if role in SWITCHES else 1.0
            values[role] = math.nan if age_ns > patience * self.stale_after_ns else value
            ages[role] = max(0, age_ns) * 1e-9
        return values, ages

    def forget(self) -> None:
        """Nothing of before a gap or a clock step may be held past it."""
        self.held.clear()
