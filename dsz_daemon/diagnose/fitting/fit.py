"""One model fitted to one drive: offsets, stiffnesses in their box, the parameters of the effects that are in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.nuisances import FORM, OFFSETS, TOLERATED
from dsz_daemon.diagnose.effects.row import CAR, Parameter
from dsz_daemon.diagnose.effects.shape_names import with_shapes
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, COLUMNS, GUESSED, INDEX, NUISANCES
from dsz_daemon.diagnose.fitting.descent import Place, Slope, descended
from dsz_daemon.diagnose.fitting.dives import noise_of_a_dive
from dsz_daemon.diagnose.fitting.drawings import told
from dsz_daemon.diagnose.fitting.limits import limits_read_off, room_of_limits
from dsz_daemon.diagnose.fitting.mounts import IN_A_BODY_M, MOUNT, TURNED, as_drawn_rad, untold_turns
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, floors, noises, sensitivities
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import Box, Sums, held_out, held_out_kinds, inverse_of_told, sums
from dsz_daemon.diagnose.residuals.slow_noise import slope_of_slow_noise
from dsz_daemon.diagnose.simulation.loads import LOAD, between_ends
from dsz_daemon.diagnose.simulation.prediction import CHANNELS, Drive, Floats, Profiles, flat, predicted
from dsz_daemon.diagnose.simulation.pulls import BY_FORCE, offset_by_a_pull_rad
from dsz_daemon.diagnose.simulation.rolling import tells_engine_from_brakes
from dsz_daemon.diagnose.surroundings.profiles import Felt, undrawn
from dsz_daemon.diagnose.surroundings.smooth_roads import (
    SURER,
    bends,
    leaning,
    leans_on_a_bank,
    rows_as_one,
    slopes_of_bends,
)
from dsz_daemon.diagnose.surroundings.unfelt_banks import untold_beside
from dsz_daemon.diagnose.surroundings.unfelt_grades import evenly_by

# The channel that a profile is taken from.
OWN_CHANNEL = {"road_bank": 0, "road_grade": 1, "side_wind": 4}
UPRIGHT, _IMU = 5, 6
TILTS = frozenset({"road_bank", "road_grade"})
# When a slippery stretch begins and ends.
MOMENTS = tuple(("low_friction", p) for p in BUILT_IN.described("low_friction").parameters if p.name.endswith("_s"))
# No effect of a real car is to the letter what the simulation makes of it.
_EFFECT_FORM = 0.03
# Least of all the limit of grip: every tyre has a curve of its own.
_GRIP_FORM, GRIP = 0.1, {"low_friction", "tyre_saturation"}
# Nor is what has no name just what the simplest of a library makes of it, from inputs with their noise.
_SHAPE_FORM = 0.1
# And its parameter is so uncertain at least.
OF_ITSELF = 0.02
# And no better known than by this share of what is worth a name, which is what form does to it: sines for angles, two
# wheels for four, a message's own few milliseconds.
_OF_THE_LEAST = 0.25
# No recording of yaw rate and lateral acceleration can split these: they turn the car alike.
SAME_TURN = frozenset({"mass_loading", "cornering_stiffness", "steering_compliance"})
# Beside a limit of grip a tyre's own curve does more of what a car's steering and tyres do.
_OF_THE_LEAST_BY_GRIP = 1.25
# What a simulation gets wrong is a matter of so many things (speed, forces, how quickly they change), however long the
# drive: it does not average out. Counted on two cars whose equations are others (docs/decisions/0019).
_WAYS_TO_BE_WRONG = 8
# What hangs together over no more rows than white noise does is noise, too, however much of it there is.
_WHITE_ROWS, _WRONG_ROWS = 5.0, 20.0
# What is more than noise by less than so many of its own spreads is noise, of which so many rows count as one.
_CHANCE, _NOISE_ROWS = 2.0, 5.0
# A road that tilts turns a car about the way under its tyres, the simulation about its C.G.: as if the IMU stood higher
# by so much. Whether whoever drew the car has its C.G. stand above the way nobody has said.
_ABOVE_THE_WAY_M, _ARM_UP = 0.4, INDEX["imu_lever_arm.z_m"]
# Of smaller road wheel angles a sine is the angle to a thousandth or two.
_FROM_RAD = {INDEX["large_angles"]: 0.1}
_SMALL_TURNS, _ENGINE = (INDEX[name] for name in ("small_turns", "wheel_slip.engine_brakes_mps2"))
# Where it pushes is no course over time.
_OF_THE_WIND = ("ahead_m", "leans")
_TOLERATED = tuple(range(len(OFFSETS), len(OFFSETS) + len(TOLERATED)))
# Effects that are what may be a little off anyway, with more room.
_INSTEAD_OF = {
    effect: {INDEX[f"{effect}.{mine}"]: INDEX[other] for mine, other in pairs}
    for effect, pairs in {
        "cornering_stiffness": [
            (f"{axle}_scale", f"{axle}_cornering_stiffness_n_per_rad") for axle in ("front", "rear")
        ],
        "track_width": [("front", "front_track_m"), ("rear", "rear_track_m")],
        "yaw_inertia": [("share", "yaw_inertia_kgm2")],
        "steering_delay": [("delay_s", "steering_skew_s")],
        # In a body that leans both feel the same swing.
        "imu_lever_arm": [("z_m", "suspension_roll.above_m")],
    }.items()
}
# What one wheel has, and not all of them: once it is told of some the others have none.
ONE_BY_ONE = frozenset({"wheel_square"})
DRAWN = frozenset(INDEX[parameter.name] for parameter in FORM)
# Of how much a load turns with a car more is known than its ends: all of it, or nothing.
_TURNS, _SURER_THAN_ITS_ENDS = INDEX[f"{LOAD}.turns"], 2.0
# What simulations hold their inputs for: no delay is surer than that.
_A_STEP_S = 0.001


class Fit(NamedTuple):
    """A converged model: its parameters, their spread, what it leaves, and its sums over all of its own columns.

    `scatter` (b, 13): each block's deviation; the sums are in it.
    `unseen` (b, c): what it leaves on blocks that a fit has not seen; `together`: whole kinds of blocks unseen.
    `along`: of a grade that no gyro feels (b,), on unseen blocks, and how many rows of it count as one.
    `is_exact`: judged by the slopes of its end, not of where it came from. `between` (p,): values and spreads beside
    a load, by where tolerances end.
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
    between: tuple[Floats, Floats] | None = None


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


def _room(drive: Drive, x: Floats, columns: Sequence[int], tolerance: Mapping[str, float]) -> Box:
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


def fitted(
    drive: Drive,
    rows: Rows,
    start: Floats,
    effects: tuple[str, ...],
    tolerance: Mapping[str, float],
    settled: float = 1e-3,
    each: Each = map,
    known: Slopes | None = None,
    felt: Felt | None = None,
    is_hopeless: Callable[[Fit], bool] | None = None,
) -> Fit:
    """Gauss-Newton in the box, over offsets, stiffnesses and the effects' parameters.

    Until a step takes no more than this share off what is left. What candidates are compared with has to be settled
    better than these: else they gain what it has left undone. With slopes that are `known` where it starts, the fit is
    judged by those of its last step: `exactly` does so by its own. `felt`: the road of the model that it starts from;
    where it has more of a road, or less, that is felt from the start on. What `is_hopeless` after some rounds is left
    there.
    """
    words = drive.vocabulary
    hidden = {one for effect in effects for one in _INSTEAD_OF.get(effect, {}).values()}
    hidden |= {i for i, least_rad in _FROM_RAD.items() if float(np.max(np.abs(drive.steer))) < least_rad}
    hidden |= (set() if TURNED & set(effects) else {_SMALL_TURNS}) | undrawn(effects)
    hidden |= {BY_FORCE} if start[BY_FORCE] == 0.0 else set()
    hidden |= told(start) | (set() if tells_engine_from_brakes(drive.wheels) else {_ENGINE})
    first = [i for i in nuisances(tolerance) if i not in hidden]
    # A guessed effect's parameter that nothing was guessed of is not there; but what begins may do so at 0.
    there = {i for i, column in enumerate(words.columns) if start[i] != 0.0 or column in MOMENTS}
    untold = (untold_turns(drive, effects) if MOUNT in effects else set()) | untold_beside(drive)
    few = {*GUESSED, *(e for e in ONE_BY_ONE if there.intersection(words.columns_of(e)))}
    own = (i for e in effects for i in words.columns_of(e) if (i in there or e not in few) and i not in untold | hidden)
    evenly = evenly_by(drive, effects)
    columns = tuple(dict.fromkeys((*first, *own, *([] if evenly is None else [evenly]))))
    sizes = np.array([math.inf if i in range(len(OFFSETS)) else words.columns[i][1].step for i in columns])
    x = start.copy()
    moments = [i for i, column in enumerate(words.columns) if column in MOMENTS]
    x[moments] = np.minimum(x[moments], len(drive.steer) * DT_S)
    x[[*undrawn(effects)]] = 0.0
    for effect in effects:
        # Beyond what may be off anyway it has one name, not two.
        for mine, other in _INSTEAD_OF.get(effect, {}).items():
            x[mine], x[other] = x[mine] + x[other], 0.0
    profiles = set(effects) & set(OWN_CHANNEL)
    if felt is not None and profiles - felt.profiles == {"side_wind"} and felt.profiles < profiles:
        felt = felt.blown(x, effects)
    if felt is None or felt.profiles != profiles:
        for profile in OWN_CHANNEL:
            x[[i for i in words.columns_of(profile) if words.columns[i][1].name not in _OF_THE_WIND]] = 0.0
        felt = Felt(drive, x, effects)

    def taken(here: Place) -> Floats:
        return sensitivities(drive, rows, here.x, here.road, here.base, columns, here.felt, each)

    def judged(here: Place, slopes: Floats) -> Fit:
        return _judged(drive, rows, tolerance, here, Slopes(here.x, effects, columns, slopes))

    def box(x: Floats) -> Box:
        return _room(drive, x, columns, tolerance)

    asked = None if is_hopeless is None else lambda here, slopes: is_hopeless(judged(here, slopes))
    floor = _floors(drive, rows, x, effects, felt)
    slope = Slope(drive, rows, floor, columns, sizes, taken, box, leans_on_a_bank(effects), moments)
    here, given = slope.place(x, felt), None if known is None else known.of(x, effects, columns)
    here, learnt = descended(slope, here, given, settled, roughly=given is not None, is_hopeless=asked)
    if known is None and not learnt.is_exact:
        learnt = slope.learnt(here)
    return judged(here, learnt.slopes)._replace(is_exact=learnt.is_exact)


def _floors(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], felt: Felt) -> Floats:
    """What white noise leaves (13,); and where a lean is told from its bank, what the simulation's form does.

    What either shows that the other does not is less than that.
    """
    found = floors(drive)
    if leans_on_a_bank(effects):
        found = np.hypot(found, _form(drive, rows, x, effects, predicted(drive, x, felt(x))))
    return found


def may_be_a_curve(drive: Drive, effects: Collection[str], effect: str) -> bool:
    """Whether a tyre's own curve may look like this effect: beside a limit of grip, what a car does may."""
    known = {one.name for one in drive.vocabulary.effects if one.touches == CAR} - {*GRIP, *OWN_CHANNEL}
    return effect in known and bool(GRIP & set(effects))


def exactly(drive: Drive, rows: Rows, fit: Fit, tolerance: Mapping[str, float], each: Each = map) -> Fit:
    """A fit judged by the slopes that it has at its end."""
    if fit.is_exact:
        return fit
    base = predicted(drive, fit.x, fit.road)
    slopes = sensitivities(drive, rows, fit.x, fit.road, base, fit.columns, fit.felt, each)
    bent = bends(drive, fit.road, fit.x) if leans_on_a_bank(fit.effects) else np.zeros(0)
    here = Place(fit.x, fit.felt, fit.road, base, fit.left, fit.scatter, bent)
    return _judged(drive, rows, tolerance, here, Slopes(fit.x, fit.effects, fit.columns, slopes))


def _judged(drive: Drive, rows: Rows, tolerance: Mapping[str, float], here: Place, slopes: Slopes) -> Fit:
    """What a model leaves on blocks that a fit has not seen, and how sure its parameters are."""
    words, left, scatter, (x, effects, columns, values) = drive.vocabulary, here.left, here.scatter, slopes
    found = sums(rows, left, values, scatter)
    per_row = correlated_rows(left / scatter[rows.block], rows.used)
    box = _room(drive, x, columns, tolerance)
    hang, prior = np.ones(len(columns)), box.weight.copy()
    prior[[place for place, i in enumerate(columns) if i == _TURNS]] *= _SURER_THAN_ITS_ENDS
    if leans_on_a_bank(effects):
        lean = leaning(slopes_of_bends(drive, here.felt, x, here.bent), here.bent)
        places = [columns.index(column) for column in lean.columns]
        box.weight[places] += np.diag(lean.squares)
        prior[places] += np.diag(lean.squares)
        # What hangs together tells as much as fewer rows, and no more than it does where it counts for more.
        hang[places] = np.where(np.diag(lean.squares) > 0.0, SURER * rows_as_one(here.bent), 1.0)
    # When a stretch begins and ends is told by the moments around, which some fold has not seen; and how a car is drawn
    # is not what is judged.
    lasting = [place for place, i in enumerate(columns) if words.columns[i] not in MOMENTS and i not in DRAWN]
    unseen = held_out(found, lasting, box) * scatter**2
    together = {
        name: held_out_kinds(found, lasting, box, kind, per_row) * scatter**2 for name, kind in rows.together.items()
    }
    form = _form(drive, rows, x, effects, here.base)
    steps = drive.steps_rows * (drive.steps / scatter) ** 2
    covariance = _covariance(found, per_row, prior, steps, np.nan_to_num(noises(drive)) / scatter, hang)
    std = np.hypot(np.sqrt(np.diag(covariance)), OF_ITSELF * np.abs(x[list(columns)]))
    least = np.array([words.columns[i][1].least for i in columns])
    share = [
        _OF_THE_LEAST_BY_GRIP if may_be_a_curve(drive, effects, words.columns[i][0]) else _OF_THE_LEAST for i in columns
    ]
    std = np.hypot(std, np.where(np.isfinite(least), share * least, 0.0))
    if _ARM_UP in columns:
        way_m, body_m = bool(TILTS & set(effects)) * _ABOVE_THE_WAY_M, ("suspension_roll" in effects) * IN_A_BODY_M
        std[columns.index(_ARM_UP)] = math.hypot(std[columns.index(_ARM_UP)], way_m, body_m)
    for i, more in as_drawn_rad(x).items() if MOUNT in effects else ():
        if i in columns:
            std[columns.index(i)] = math.hypot(std[columns.index(i)], more)
    if "steering_delay" in effects:
        at = columns.index(INDEX["steering_delay.delay_s"])
        std[at] = math.hypot(std[at], _A_STEP_S)
    if "steering_offset" in effects:
        at = columns.index(INDEX["steering_offset.offset_rad"])
        std[at] = math.hypot(std[at], offset_by_a_pull_rad(x))
    if "bias_drift" in effects:
        slow = slope_of_slow_noise(rows, left, per_row, _IMU)
        for i, more in zip(words.columns_of("bias_drift")[:_IMU], slow.tolist(), strict=True):
            if i in columns:
                std[columns.index(i)] = math.hypot(std[columns.index(i)], more)
    for i in limits_read_off(drive, x) if "sensor_saturation" in effects else ():
        # Readings tell it to the last digit, but for what the filter makes of short tops.
        std[columns.index(i)] = OF_ITSELF * x[i]
    known = (x, std, effects, left, scatter, per_row, found, columns, unseen, here.road, form, together, here.felt)
    fit = Fit(*known, covariance, here.felt.unseen_along(x, rows))
    if LOAD not in effects:
        return fit
    ends = {columns.index(_TURNS): (0.0, words.columns[_TURNS][1].high)}
    names = [words.columns[i][1].name for i in columns]
    ends |= {at: (-tolerance[name], tolerance[name]) for at, name in enumerate(names) if tolerance.get(name)}
    values, spreads = between_ends(x[list(columns)], covariance, ends)
    return fit._replace(between=(values, np.hypot(spreads, OF_ITSELF * values)))


@np.errstate(over="ignore", invalid="ignore")
def _form(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], base: Floats) -> Floats:
    """What the simulation's form may be off by (13,): its own, and a share of what the effects in it do."""
    if not effects:
        return rows.form
    without = x.copy()
    without[[i for effect in effects for i in drive.vocabulary.columns_of(effect)]] = 0.0
    change = np.where(rows.used, (base - predicted(drive, without, flat(len(base))))[rows.at], 0.0)
    count = np.maximum(np.sum(rows.used, axis=0), 1)
    # Of the IMU what lasts all the way is the offset's to say.
    lasting = np.sum(change[:, :_IMU], axis=0) / count[:_IMU]
    change[:, :_IMU] -= np.where(rows.used[:, :_IMU], lasting, 0.0)
    rms = np.sqrt(np.sum(change**2, axis=0) / count)
    share = np.full(len(rms), _GRIP_FORM if GRIP & set(effects) else _EFFECT_FORM)
    share[[CHANNELS.index(channel) for channel in with_shapes(effects)]] = _SHAPE_FORM
    found = np.hypot(np.hypot(rows.form, share * rms), noise_of_a_dive(drive, x))
    if TILTS & set(effects):
        # A road that a gyro has felt has the gyro's noise in it, and -q v shows it.
        noise = float(np.nan_to_num(floors(drive)[1])) * float(np.sqrt(np.mean(drive.wheels**2)))
        found[UPRIGHT] = math.hypot(found[UPRIGHT], noise)
    return np.asarray(found, dtype=np.float64)


def _covariance(
    found: Sums, per_row: Floats, weight: Floats, steps: Floats, floor: Floats, hang: Floats | float = 1.0
) -> Floats:
    """Covariance (p, p) by the sandwich over blocks, no less than autocorrelation and the steering's steps allow.

    And no less than what is left beyond the sensors' noise may have done to the parameters, if it is the simulation
    that is wrong there. In the blocks' scatter: the power of steps times the rows for which they stay (b, 13), and
    the `floor` (b, 13). What a prior's `weight` (p,) is of may `hang` together over so many rows (p,).
    """
    bread, untold = inverse_of_told(found.squares.sum(axis=(0, 1)), np.maximum(weight, 1e-12))
    n = np.maximum(found.counts.sum(axis=0), 1.0)
    power = found.left.sum(axis=0) / n
    counts, noise = np.maximum(found.counts, 1.0), floor**2
    block_power, by_chance = found.left / counts, _CHANCE * np.sqrt(2.0 * np.minimum(per_row, _NOISE_ROWS) / counts)
    hangs = np.clip((per_row - _WHITE_ROWS) / (_WRONG_ROWS - _WHITE_ROWS), 0.0, 1.0)
    wrong = hangs * np.where(block_power > noise * (1.0 + by_chance), block_power - noise, 0.0)
    lasting = np.max(np.broadcast_arrays(power * per_row, steps, wrong * n / _WAYS_TO_BE_WRONG), axis=0)
    meat = np.einsum("bcij,bc->ij", found.squares, lasting)
    block = found.cross.sum(axis=1)
    meat_blocks = block.T @ block
    one, other = bread @ meat @ bread, bread @ meat_blocks @ bread
    prior = bread @ np.diag(weight * hang) @ bread + untold
    whole = one + prior
    more = np.maximum(np.diag(one), np.diag(other)) + np.diag(prior)
    share = np.sqrt(np.maximum(more, 0.0) / np.maximum(np.diag(whole), 1e-300))
    covariance = whole * share * share[:, np.newaxis]
    # Of what is hardly told rounding may leave anything.
    np.fill_diagonal(covariance, np.maximum(more, 0.0))
    return np.asarray(covariance, dtype=np.float64)


def values_of(drive: Drive, fit: Fit, effect: str) -> dict[str, tuple[float, float]]:
    """(value, spread) of each parameter of an effect."""
    values, spreads = fit.between if effect == LOAD and fit.between else (fit.x[list(fit.columns)], fit.std)
    own = drive.vocabulary.columns_of(effect) if effect else NUISANCES
    there = [(fit.columns.index(i), drive.vocabulary.columns[i][1].name) for i in own if i in fit.columns]
    return {name: (float(values[place]), float(spreads[place])) for place, name in there}
