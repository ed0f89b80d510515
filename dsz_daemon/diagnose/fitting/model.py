"""A fitted model: its parameters, how far they may go, and what it leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.body import MASS_LOADING
from dsz_daemon.diagnose.effects.nuisances import FORM, OFFSETS, TOLERATED
from dsz_daemon.diagnose.effects.row import Parameter
from dsz_daemon.diagnose.effects.steering import STEERING_COMPLIANCE
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, COLUMNS, INDEX, NUISANCES
from dsz_daemon.diagnose.fitting.limits import room_of_limits
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.evidence import Box, Sums
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.road import Profiles
from dsz_daemon.diagnose.surroundings.profiles import Felt

# The channel that a profile is taken from.
OWN_CHANNEL = {"road_bank": 0, "road_grade": 1, "side_wind": 4}
# Of the channels the upright accelerometer, and how many are the IMU's.
UPRIGHT, IMU = 5, 6
TILTS = frozenset({"road_bank", "road_grade"})
# When a slippery stretch begins and ends.
MOMENTS = tuple(("low_friction", p) for p in BUILT_IN.described("low_friction").parameters if p.name.endswith("_s"))
# Where grip ends.
GRIP = {"low_friction", "tyre_saturation"}
# No recording of yaw rate and lateral acceleration can split these: they turn the car alike.
SAME_TURN = frozenset({MASS_LOADING.name, *MASS_LOADING.like})
# Of these numbers what tyres may be off by leaves much open.
BESIDE_TYRES = frozenset({MASS_LOADING.name, STEERING_COMPLIANCE.name})
# And this one readings tell by themselves.
SATURATION = "sensor_saturation"
_TOLERATED = tuple(range(len(OFFSETS), len(OFFSETS) + len(TOLERATED)))
DRAWN = frozenset(INDEX[parameter.name] for parameter in FORM)

# Values and spreads (p,).
Told = tuple[Floats, Floats]


class Fit(NamedTuple):
    """A converged model: its parameters, their spread, what it leaves, and its sums over all of its own columns.

    `scatter` (b, 13): each block's deviation; the sums are in it.
    `unseen` (b, c): what it leaves on blocks that a fit has not seen; `together`: whole kinds of blocks unseen.
    `along`: of a grade that no gyro feels (b,), on unseen blocks, and how many rows of it count as one.
    `is_exact`: judged by the slopes of its end, not of where it came from. `told`: what an answer tells, where that
    is something else than what it is judged by: by how far off tyres may be, and without what judging keeps in hand.
    """

    x: Floats
    std: Floats
    effects: tuple[str, ...]
    left: Floats
    scatter: Floats
    per_row: Floats
    sums: Sums
    columns: tuple[int, ...]
    unseen: Floats
    road: Profiles
    form: Floats
    together: Mapping[str, Floats]
    felt: Felt
    covariance: Floats
    along: tuple[Floats, float] | None = None
    is_exact: bool = True
    told: Told | None = None


class Slopes(NamedTuple):
    """Sensitivities (k, 13, len(columns)) of the model that has these effects, at x."""

    x: Floats
    effects: tuple[str, ...]
    columns: tuple[int, ...]
    values: Floats

    def of(self, x: Floats, effects: tuple[str, ...], columns: Sequence[int]) -> Floats | None:
        """Those of some columns; None at another x, on another road, or where one is missing."""
        roads = OWN_CHANNEL.keys() & set(effects), OWN_CHANNEL.keys() & set(self.effects)
        are_known = roads[0] == roads[1] and np.array_equal(x, self.x) and set(columns) <= set(self.columns)
        return self.at(columns) if are_known else None

    def at(self, columns: Sequence[int]) -> Floats:
        """Those of some columns: `take` costs a tenth of an index."""
        return np.take(self.values, [self.columns.index(i) for i in columns], axis=2)


def nuisances(tolerance: Mapping[str, float]) -> tuple[int, ...]:
    """What is refitted first: all that has some room."""
    return tuple(i for i in NUISANCES if i not in _TOLERATED or tolerance.get(COLUMNS[i][1].name, 0.0) > 0.0)


def box_of(
    parameters: Sequence[tuple[str, Parameter]], x: Floats, columns: Sequence[int], tolerance: Mapping[str, float]
) -> Box:
    """How far the columns may go from x: the plausible, the tolerance for configured stiffnesses."""
    low, high = [], []
    for i in columns:
        parameter = parameters[i][1]
        most = tolerance.get(parameter.name, 0.0) if i in _TOLERATED else None
        low.append((parameter.low if most is None else -most) - x[i])
        high.append((parameter.high if most is None else most) - x[i])
    # A prior as wide as what is plausible keeps what nothing was said of where it is.
    width = np.array([parameters[i][1].high - parameters[i][1].low for i in columns])
    return Box(np.array(low), np.array(high), 1.0 / width**2)


def room(drive: Drive, x: Floats, columns: Sequence[int], tolerance: Mapping[str, float]) -> Box:
    """`box_of`, in which a limit stays where readings stand, and a stretch begins and ends on the way."""
    box = box_of(drive.vocabulary.columns, x, columns, tolerance)
    for at, i in enumerate(columns):
        if drive.vocabulary.columns[i] in MOMENTS:
            box.high[at] = len(drive.steer) * DT_S - x[i]
    for i, (low, high) in room_of_limits(drive, x).items():
        if i in columns:
            at = list(columns).index(i)
            box.low[at], box.high[at] = min(low - x[i], 0.0), max(high - x[i], 0.0)
    return box


def values_of(drive: Drive, fit: Fit, effect: str, *, as_fitted: bool = False) -> dict[str, tuple[float, float]]:
    """(value, spread) of each parameter of an effect, as they are told; or `as_fitted`, as they are judged by."""
    values, spreads = fit.x[list(fit.columns)], fit.std
    if fit.told is not None and not as_fitted:
        # Of others a model may have been moved since: when a stretch begins to the middle of what is as good.
        values, spreads = fit.told if effect in {*BESIDE_TYRES, SATURATION} else (values, fit.told[1])
    own = drive.vocabulary.columns_of(effect) if effect else NUISANCES
    there = [(fit.columns.index(i), drive.vocabulary.columns[i][1].name) for i in own if i in fit.columns]
    return {name: (float(values[place]), float(spreads[place])) for place, name in there}
