"""Effects of road and air: profiles over a distance or a time that tilt, push or make slippery."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.sim.effects_of_sensors import PutInto, Values
from dsz_daemon.sim.road import Road
from dsz_daemon.sim.world import World

Array = NDArray[np.float64]


def random_profile(rms: float, correlation: float, seed: float) -> Callable[[Array], Array]:
    """Return a smooth zero-mean profile of this root mean square over a distance or a time.

    Forty sines of random phase; their density falls as that of a second-order low-pass at 1/correlation.
    """
    rng = np.random.default_rng(round(seed))
    waves = np.geomspace(0.1, 5.0, 40) / correlation
    density = np.sqrt(np.gradient(waves)) / (1.0 + (waves * correlation) ** 2)
    heights = rms * math.sqrt(2.0) * density / math.sqrt(float(sum((density**2).tolist())))
    phases = rng.uniform(0.0, 2.0 * math.pi, len(waves))

    def profile(at: Array) -> Array:
        total = np.zeros(len(at))
        for wave, height, phase in zip(waves.tolist(), heights.tolist(), phases.tolist(), strict=True):
            total += height * np.sin(wave * at + phase)
        return total

    return profile


def _tilted(road: Road, columns: tuple[int, int], profile: Callable[[Array], Array]) -> Road:
    """The road with a profile added to an angle and its slope; a table fine and long enough is laid under it."""
    step_m, rows = 1.0, 30_000
    at_m: Array = step_m * np.arange(rows, dtype=np.float64)
    tilt, bend, rough = np.zeros((rows, 4)), np.zeros(rows), np.zeros((rows, 4))
    place = np.minimum(at_m / road.step_m, len(road.tilt) - 1.0)
    known = np.arange(len(road.tilt), dtype=np.float64)
    for i in range(4):
        tilt[:, i] = np.interp(place, known, road.tilt[:, i])
        rough[:, i] = np.interp(place, known, road.rough[:, i])
    bend[:] = np.interp(place, known, road.bend_per_m)
    angle, slope = columns
    tilt[:, angle] += profile(at_m)
    tilt[:, slope] += (profile(at_m + 0.01) - profile(at_m - 0.01)) / 0.02
    return Road(step_m, tilt, bend, rough)


def tilt(angle: int) -> PutInto:
    """Return what tilts the road sideways (0) or along (1), on top of the tilt that it has."""

    def put_into(world: World, v: Values) -> World:
        profile = random_profile(v["rms_rad"], v["correlation_m"], v["seed"])
        return replace(world, road=_tilted(world.road, (angle, angle + 2), profile))

    return put_into


def wind(world: World, v: Values) -> World:
    """Gusts from the side, instead of any other wind."""
    gusts = random_profile(v["rms_n"], v["correlation_s"], v["seed"])
    return replace(world, programme=replace(world.programme, side_wind_n=gusts))


def slippery(world: World, v: Values) -> World:
    """A limit of the road's own for a while; where it is more slippery already, it stays so."""
    start_s, end_s, level = v["start_s"], v["end_s"], v["friction_coefficient"]
    before = world.programme.friction_limit

    def limit(t_s: Array) -> Array:
        icy = np.where((t_s >= start_s) & (t_s < end_s), level, math.inf)
        return icy if before is None else np.minimum(icy, before(t_s))

    return replace(world, programme=replace(world.programme, friction_limit=limit))


def slippery_wrong(v: Values) -> str:
    """What can't be of a slippery while."""
    return (
        "" if v["end_s"] > v["start_s"] else f"ends at {v['end_s']:g} s; expected after its start, {v['start_s']:g} s"
    )
