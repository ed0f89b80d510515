"""A drive as a list of legs: so far, so fast, so bent, so steep; road and programme follow from it.

The road is a matter of distance and the driver's speed one of time: each leg begins with a change to its own speed, at
a comfortable rate, and may end with a stop. What the driver is off the wanted speed shifts the two against each other
by a metre or so, which is less than the transitions are long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.driver import Programme, SpeedChange
from dsz_daemon.sim.road import Profile, Road, tabled_road

Array = NDArray[np.float64]

# Chosen: what drivers do in traffic, at most.
COMFORTABLE_MPS2 = 2.0
# Chosen: bends, banks and grades come and go over this way, where both legs are twice as long.
EASED_OVER_M = 25.0


class Leg(NamedTuple):
    """A piece of the way. Bend: 1/m, left positive; bank: left side high; `stop_s`: standing at its end."""

    length_m: float
    speed_mps: float
    bend_per_m: float = 0.0
    grade_up_rad: float = 0.0
    bank_rad: float = 0.0
    stop_s: float = 0.0


def road_along(legs: Sequence[Leg]) -> Road:
    """Return the road of these legs; the first leg's tilt is there from the start."""
    ends = np.cumsum([leg.length_m for leg in legs]).tolist()

    def profile(values: Sequence[float]) -> Profile:
        def along(distance_m: Array) -> Array:
            total = np.full(len(distance_m), values[0])
            for number in range(1, len(legs)):
                eased_m = min(EASED_OVER_M, 0.5 * legs[number - 1].length_m, 0.5 * legs[number].length_m)
                x = np.clip((distance_m - ends[number - 1]) / eased_m + 0.5, 0.0, 1.0)
                total += (values[number] - values[number - 1]) * x * x * x * (10.0 + x * (6.0 * x - 15.0))
            return total

        return along

    return tabled_road(
        ends[-1] + 50.0,
        profile([leg.bank_rad for leg in legs]),
        profile([leg.grade_up_rad for leg in legs]),
        profile([leg.bend_per_m for leg in legs]),
    )


def programme_along(
    legs: Sequence[Leg],
    stand_s: float = 5.0,
    start_mps: float = 0.0,
    friction_limit: Callable[[Array], Array] | None = None,
    comfortable_mps2: float = COMFORTABLE_MPS2,
) -> Programme:
    """Return the speeds of these legs over time: standing first (or rolling at `start_mps`), standing at the end.

    ValueError: a leg too short for its changes of speed.
    """
    changes: list[SpeedChange] = []
    t_s, speed_mps = stand_s, start_mps
    if start_mps > 0.0:
        changes.append(SpeedChange(-2.0, -1.0, start_mps))

    def change(to_mps: float) -> float:
        """Adds one; returns its way."""
        nonlocal t_s, speed_mps
        if to_mps == speed_mps:
            return 0.0
        # An S has its steepest slope in the middle, half again its mean.
        takes_s = 1.5 * abs(to_mps - speed_mps) / comfortable_mps2
        changes.append(SpeedChange(t_s, t_s + takes_s, to_mps - speed_mps))
        way_m = 0.5 * (speed_mps + to_mps) * takes_s
        t_s, speed_mps = t_s + takes_s, to_mps
        return way_m

    for number, leg in enumerate(legs):
        way_m = change(leg.speed_mps)
        stops = leg.stop_s > 0.0 or number == len(legs) - 1
        braking_m = 0.75 * leg.speed_mps**2 / comfortable_mps2 if stops else 0.0
        if way_m + braking_m > leg.length_m:
            raise ValueError(f"leg {number}: {leg.length_m:g} m are too short for its changes of speed")
        t_s += (leg.length_m - way_m - braking_m) / leg.speed_mps
        if stops:
            change(0.0)
            t_s += leg.stop_s
    return Programme(np.ceil(t_s + 2.0).item(), tuple(changes), follows_road=True, friction_limit=friction_limit)
