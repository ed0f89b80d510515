"""What a fitted model leaves on blocks that it has not seen, and how sure its parameters are."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from dsz_daemon.diagnose.effects.row import CAR
from dsz_daemon.diagnose.effects.shape_names import with_shapes
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.descent import Place
from dsz_daemon.diagnose.fitting.dives import noise_of_a_dive
from dsz_daemon.diagnose.fitting.limits import limits_read_off
from dsz_daemon.diagnose.fitting.model import (
    BESIDE_TYRES,
    DRAWN,
    GRIP,
    IMU,
    MOMENTS,
    OWN_CHANNEL,
    TILTS,
    UPRIGHT,
    Fit,
    Slopes,
    room,
)
from dsz_daemon.diagnose.fitting.mounts import IN_A_BODY_M, MOUNT, as_drawn_rad
from dsz_daemon.diagnose.residuals.comparison import Rows, floors, noises
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import Sums, held_out, held_out_kinds, inverse_of_told, sums
from dsz_daemon.diagnose.residuals.slow_noise import slope_of_slow_noise
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.simulation.loads import LOAD, between_ends
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.pulls import offset_by_a_pull_rad
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.smooth_roads import (
    SURER,
    leaning,
    leans_on_a_bank,
    rows_as_one,
    slopes_of_bends,
)

# No effect of a real car is to the letter what the simulation makes of it.
_EFFECT_FORM = 0.03
# Least of all the limit of grip: every tyre has a curve of its own.
_GRIP_FORM = 0.1
# Nor is what has no name just what the simplest of a library makes of it, from inputs with their noise.
_SHAPE_FORM = 0.1
# And its parameter is so uncertain at least.
OF_ITSELF = 0.02
# And no better known than by this share of what is worth a name, which is what form does to it: sines for angles, two
# wheels for four, a message's own few milliseconds.
_OF_THE_LEAST = 0.25
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
# Of how much a load turns with a car more is known than its ends: all of it, or nothing.
_TURNS, _SURER_THAN_ITS_ENDS = INDEX[f"{LOAD}.turns"], 2.0
# How far front wheels give way is told no better than by so much of what their tyres' stiffness may be off.
_FRONT_STIFFNESS, _OF_A_TOLERANCE = "front_cornering_stiffness_n_per_rad", 0.5
_COMPLIANCE = INDEX["steering_compliance.rad_per_n"]
# What simulations hold their inputs for: no delay is surer than that.
_A_STEP_S = 0.001


def may_be_a_curve(drive: Drive, effects: Collection[str], effect: str) -> bool:
    """Whether a tyre's own curve may look like this effect: beside a limit of grip, what a car does may."""
    known = {one.name for one in drive.vocabulary.effects if one.touches == CAR} - {*GRIP, *OWN_CHANNEL}
    return effect in known and bool(GRIP & set(effects))


def judged_model(drive: Drive, rows: Rows, tolerance: Mapping[str, float], here: Place, slopes: Slopes) -> Fit:
    """What a model leaves on blocks that a fit has not seen, and how sure its parameters are."""
    words, left, scatter, (x, effects, columns, values) = drive.vocabulary, here.left, here.scatter, slopes
    found = sums(rows, left, values, scatter)
    per_row = correlated_rows(left / scatter[rows.block], rows.used)
    box = room(drive, x, columns, tolerance)
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
    form = form_of(drive, rows, x, effects, here.base)
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
        slow = slope_of_slow_noise(rows, left, per_row, IMU)
        for i, more in zip(words.columns_of("bias_drift")[:IMU], slow.tolist(), strict=True):
            if i in columns:
                std[columns.index(i)] = math.hypot(std[columns.index(i)], more)
    for i in limits_read_off(drive, x) if "sensor_saturation" in effects else ():
        # Readings tell it to the last digit, but for what the filter makes of short tops.
        std[columns.index(i)] = OF_ITSELF * x[i]
    known = (x, std, effects, left, scatter, per_row, found, columns, unseen, here.road, form, together, here.felt)
    fit = Fit(*known, covariance, here.felt.unseen_along(x, rows))
    return fit._replace(between=_beside_tyres(drive, fit, tolerance)) if BESIDE_TYRES & set(effects) else fit


def _beside_tyres(drive: Drive, fit: Fit, tolerance: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Values and spreads (p,) that are told of what turns a car as its tyres do, whose stiffness may be off by much.

    A load is what is between the ends of that. Front wheels that give way are softer tyres, but for how wheels are
    drawn.
    """
    columns, parameters = fit.columns, drive.vocabulary.columns
    values, spreads = fit.x[list(columns)], fit.std
    if LOAD in fit.effects:
        ends = {columns.index(_TURNS): (0.0, parameters[_TURNS][1].high)}
        names = [parameters[i][1].name for i in columns]
        ends |= {at: (-tolerance[name], tolerance[name]) for at, name in enumerate(names) if tolerance.get(name)}
        values, spreads = between_ends(values, fit.covariance, ends)
        spreads = np.hypot(spreads, OF_ITSELF * values)
    softer_rad_per_n = (
        _OF_A_TOLERANCE * tolerance.get(_FRONT_STIFFNESS, 0.0) / (2.0 * getattr(drive.car, _FRONT_STIFFNESS))
    )
    is_compliance = np.array(columns) == _COMPLIANCE
    return values, np.where(is_compliance, np.hypot(spreads, softer_rad_per_n), spreads)


@np.errstate(over="ignore", invalid="ignore")
def form_of(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], base: Floats) -> Floats:
    """What the simulation's form may be off by (13,): its own, and a share of what the effects in it do."""
    if not effects:
        return rows.form
    without = x.copy()
    without[[i for effect in effects for i in drive.vocabulary.columns_of(effect)]] = 0.0
    change = np.where(rows.used, (base - predicted(drive, without, flat(len(base))))[rows.at], 0.0)
    count = np.maximum(np.sum(rows.used, axis=0), 1)
    # Of the IMU what lasts all the way is the offset's to say.
    lasting = np.sum(change[:, :IMU], axis=0) / count[:IMU]
    change[:, :IMU] -= np.where(rows.used[:, :IMU], lasting, 0.0)
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
