"""How sure a model's parameters are: as it is judged by, and as it is told."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.effects.row import CAR, SENSORS, WHEELS
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.limits import limits_read_off
from dsz_daemon.diagnose.fitting.model import BESIDE_TYRES, GRIP, IMU, OWN_CHANNEL, SATURATION, TILTS, Fit, Slopes, Told
from dsz_daemon.diagnose.fitting.mounts import IN_A_BODY_M, MOUNT, as_drawn_rad
from dsz_daemon.diagnose.residuals.comparison import Rows
from dsz_daemon.diagnose.residuals.evidence import Sums, inverse_of_told
from dsz_daemon.diagnose.residuals.slow_noise import slope_of_slow_noise
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.loads import LOAD, between_ends
from dsz_daemon.diagnose.simulation.pulls import offset_by_a_pull_rad

# Of a limit of grip what says that there is one, and the curve that bends to it.
LIMIT_OF = {effect: INDEX[f"{effect}.inverse_square"] for effect in GRIP}
_CURVES = {i: [INDEX[f"{effect}.{name}"] for name in ("sharpness", "brush")] for effect, i in LIMIT_OF.items()}


class _Form(NamedTuple):
    """What form does to a parameter at least, as a share `of_itself` and of the `least` that is worth a name.

    Sines for angles, two wheels for four, a message's own few milliseconds.
    """

    of_itself: float
    least: float


# By these it is judged whether an effect is there.
JUDGED = _Form(0.02, 0.25)
# An answer tells no less than what came true of four simulators by other authors and two of our own
# (docs/decisions/0083): of sensors form makes little.
_TOLD = {SENSORS: _Form(0.005, 0.05), WHEELS: _Form(0.01, 0.15), CAR: _Form(0.01, 0.1)}
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
# How much of a load turns with a car.
TURNS = INDEX[f"{LOAD}.turns"]
# How far front wheels give way is told no better than by so much of what their tyres' stiffness may be off.
_FRONT_STIFFNESS, _OF_A_TOLERANCE = "front_cornering_stiffness_n_per_rad", 0.5
_COMPLIANCE = INDEX["steering_compliance.rad_per_n"]
# What simulations hold their inputs for, or their tyres and low-passes: no delay or time constant is surer than that.
_A_STEP_S = 0.001
_TIMES = [INDEX["steering_delay.delay_s"], INDEX["sensor_bandwidth.time_constant_s"]]
# What has no name was not planted often enough to know; and what a mount's turns are also depends on their order.
_TOLD_AS_JUDGED = frozenset({MOUNT, *(effect.name for effect in NAMELESS)})


def may_be_a_curve(drive: Drive, effects: Collection[str], effect: str) -> bool:
    """Whether a tyre's own curve may look like this effect: beside a limit of grip, what a car does may."""
    known = {one.name for one in drive.vocabulary.effects if one.touches == CAR} - {*GRIP, *OWN_CHANNEL}
    return effect in known and bool(GRIP & set(effects))


def spreads_of(
    drive: Drive,
    rows: Rows,
    model: Slopes,
    left: tuple[Floats, Floats],
    covariance: Floats,
    tolerance: Mapping[str, float],
) -> tuple[Floats, Told]:
    """The spread (p,) of each parameter as it is judged by, and what is told of each.

    `left`: what the model leaves (k, 13), and how many of these rows count as one (13,).
    """
    own = np.hypot(np.sqrt(np.diag(covariance)), _by_what_is_beside(drive, rows, model, left))
    std, spreads = (np.hypot(own, form) for form in _by_form(drive, model))
    columns, values = model.columns, model.x[list(model.columns)]
    for i, tops in limits_read_off(drive, model.x).items() if SATURATION in model.effects else ():
        # Readings tell it to the last digit; of short tops the filter leaves less, and so does a fit.
        at = columns.index(i)
        values[at] = float(np.mean([top.limit for top in tops]))
        std[at], spreads[at] = JUDGED.of_itself * values[at], _TOLD[SENSORS].of_itself * values[at]
    told = values, spreads
    if BESIDE_TYRES & set(model.effects):
        told = _beside_tyres(drive, model, told, covariance, tolerance)
    return std, told


def _by_form(drive: Drive, model: Slopes) -> tuple[Floats, Floats]:
    """What form does at least (p,), as it is judged by and as it is told."""
    words = drive.vocabulary
    told_by = {one.name: _TOLD[one.touches] for one in words.effects if one.name not in _TOLD_AS_JUDGED}
    judged, told = np.zeros(len(model.columns)), np.zeros(len(model.columns))
    for at, i in enumerate(model.columns):
        effect, parameter = words.columns[i]
        least = parameter.least if math.isfinite(parameter.least) else 0.0
        by_grip = _OF_THE_LEAST_BY_GRIP if may_be_a_curve(drive, model.effects, effect) else 0.0
        for form, found in ((JUDGED, judged), (told_by.get(effect, JUDGED), told)):
            found[at] = math.hypot(form.of_itself * model.x[i], max(form.least, by_grip) * least)
    return judged, told


def _by_what_is_beside(drive: Drive, rows: Rows, model: Slopes, left: tuple[Floats, Floats]) -> Floats:
    """What else a parameter may be off by (p,): by what is in the model beside it, and by slow noise."""
    x, effects, columns = model.x, set(model.effects), model.columns
    found = np.zeros(len(columns))

    def adds(i: int, *more: float) -> None:
        if i in columns:
            found[columns.index(i)] = math.hypot(found[columns.index(i)], *more)

    adds(_ARM_UP, bool(TILTS & effects) * _ABOVE_THE_WAY_M, ("suspension_roll" in effects) * IN_A_BODY_M)
    for i, more in as_drawn_rad(x).items() if MOUNT in effects else ():
        adds(i, more)
    for i in _TIMES:
        adds(i, _A_STEP_S)
    if "tyre_relaxation" in effects:
        v_mps = np.mean(drive.wheels, axis=1)
        adds(INDEX["tyre_relaxation.relaxation_length_m"], _A_STEP_S * float(np.sqrt(np.mean(v_mps**2))))
    if "steering_offset" in effects:
        adds(INDEX["steering_offset.offset_rad"], offset_by_a_pull_rad(x))
    if "bias_drift" in effects:
        slow = slope_of_slow_noise(rows, *left, IMU)
        for i, more in zip(drive.vocabulary.columns_of("bias_drift")[:IMU], slow.tolist(), strict=True):
            adds(i, more)
    return found


def _beside_tyres(drive: Drive, model: Slopes, told: Told, covariance: Floats, tolerance: Mapping[str, float]) -> Told:
    """What is told of what turns a car as its tyres do, whose stiffness may be off by much.

    A load is what is between the ends of that. Front wheels that give way are softer tyres, but for how wheels are
    drawn.
    """
    columns, parameters = model.columns, drive.vocabulary.columns
    values, spreads = told
    if LOAD in model.effects:
        ends = {columns.index(TURNS): (0.0, parameters[TURNS][1].high)}
        names = [parameters[i][1].name for i in columns]
        ends |= {at: (-tolerance[name], tolerance[name]) for at, name in enumerate(names) if tolerance.get(name)}
        between, apart = between_ends(values, covariance, ends)
        is_beside = np.array([parameters[i][0] in BESIDE_TYRES for i in columns])
        values = np.where(is_beside, between, values)
        spreads = np.where(is_beside, np.hypot(apart, JUDGED.of_itself * between), spreads)
    softer_rad_per_n = (
        _OF_A_TOLERANCE * tolerance.get(_FRONT_STIFFNESS, 0.0) / (2.0 * getattr(drive.car, _FRONT_STIFFNESS))
    )
    is_compliance = np.array(columns) == _COMPLIANCE
    return values, np.where(is_compliance, np.hypot(spreads, softer_rad_per_n), spreads)


def covariance_of(
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


def spread_of(fit: Fit, i: int) -> float:
    """How sure column i is that it is not 0: as sure as it is; of a limit of grip, for just the curve that was fitted.

    How that bends makes a limit uncertain, not whether there is one.
    """
    at, curve = fit.columns.index(i), [fit.columns.index(j) for j in _CURVES.get(i, ()) if j in fit.columns]
    if not curve:
        return float(fit.std[at])
    shared, variance = fit.covariance[at, curve], float(fit.covariance[at, at])
    taken = float(shared @ np.linalg.lstsq(fit.covariance[np.ix_(curve, curve)], shared, rcond=None)[0])
    left = max(1.0 - taken / variance, 0.0) if variance > 0.0 else 1.0
    return float(fit.std[at]) * math.sqrt(left)
