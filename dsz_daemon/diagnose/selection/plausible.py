"""What an effect can't be, however well it fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from dsz_daemon.diagnose.effects.nameless import OUTER_LOAD
from dsz_daemon.diagnose.effects.steering import STEERING_COMPLIANCE
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.gains import far_off
from dsz_daemon.diagnose.fitting.limits import limits_read_off
from dsz_daemon.diagnose.fitting.model import GRIP, OWN_CHANNEL, TILTS, Fit
from dsz_daemon.diagnose.fitting.moments import SHORTEST_S, moments_of
from dsz_daemon.diagnose.fitting.spreads import may_be_a_curve, spread_of
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, SLOW_MPS, Ints, Rows
from dsz_daemon.diagnose.selection.tilts import (
    is_a_tilt_alone,
    is_the_bodys,
    pulls_nothing,
    tips_only_what_stands_on_it,
)
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import drifted_s
from dsz_daemon.diagnose.simulation.loads import LOAD
from dsz_daemon.diagnose.simulation.prediction import ALONG, predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.wheel_readings import locks_in_front
from dsz_daemon.diagnose.surroundings.unfelt_banks import YAW_GYRO, is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt, goes_by_the_speed, rises_and_falls, way_of
from dsz_daemon.diagnose.surroundings.winds import changes_once, changes_twice, follows_the_car
from dsz_daemon.signals import IMU_CHANNELS

# So far may the furthest readings, but for some, stand beyond a limit that they clip at.
_BEYOND, _NEARLY_ALL = 1.1, 0.999
# What is left where they clip is no more than it is elsewhere, but for the edges: 0.4 to 2 times that, rms, and 0.01 to
# 0.03 of what would be without a limit. Where brakes pulsed it was 12 times, and 0.37.
_NOT_AT_IT, _BESIDE_IT = 0.15, 4.0
_LIMITED = {c: INDEX[f"sensor_saturation.{'gyro_limit_radps' if c < 3 else 'accel_limit_mps2'}"] for c in range(5)}
# An offset that drifts does so in each third of the way, by this share of what it does in all of it.
_PIECES, _STEADY, _LEAST_ROWS = 3, 0.35, 300
# A third in which a drift that fades has no more of its mean rate does not tell.
_FADED = 0.4
# And by the end it has gone so many times as far as what is left beside it wanders (rms of blocks' means): a sensor's
# flicker, whose power is the inverse of frequency, goes that far in one of some hundreds.
_FAR_BEYOND = 8.0
# Of the power of a gyro's block means what a road leaves: a hundredth where one is felt, 0.7 and more where none is.
_UNFELT = 0.5
# A parameter is told by so many of its spreads.
_TOLD = 2.0
# And one that is off by so many is as likely as not to be none.
_RATHER, _REAR_TYRES = 0.5, INDEX["cornering_stiffness.rear_scale"]
# And two together, by their ellipse (chi squared, one in a thousand).
_TOLD_TOGETHER = 13.8
# So little of any unit is nothing.
_NOTHING = 1e-9
# Who and what a configured car may be without (1 spread).
_MAY_BE_MISSING_KG = 100.0
# A load is one that weighs something, by so many spreads.
_WEIGHS, _WEIGHT = 1.5, INDEX[f"{LOAD}.added_mass_kg"]
# Two leaks are there from so many spreads on, and opposite up to so many.
_LEAKS = INDEX["accel_cross_axis.xy"], INDEX["accel_cross_axis.yx"]
_SURELY_LEAKS, _OPPOSITE = 3.0, 2.0
_OF_WHEELS = ("wheel_radius", "wheel_square")
# Wind blows all the way: of a fifth of it no less than so much of its rms; of blocks enough to tell.
_MUCH, _HARDLY, _LEAST_BLOCKS = 0.2, 0.3, 8
# But for gusts that come one by one, by so much of the way from the C.G. to the front axle ahead of it: three of two
# simulators pushed 0.24 to 0.35 m ahead, and their blocks' rms went with the car's turns, pulls and speed by 0.3 at
# most; of eight pushes that were none six came from elsewhere, one went with turns by 0.53, one with speed by -0.84.
_OF_A_GUST, _WITH_THE_CAR = 0.4, 0.5
# Nor does it push close to an axle, by the share of how far that is: the centre of pressure of cars is some tenths of a
# metre ahead of the C.G., and what pushes an axle is what that axle's wheels are steered by.
_TO_AN_AXLE, _HALF_AS_FAR = 0.6, 0.5
# What is slippery for more of the way is so all the way.
_FOR_A_WHILE = 0.6
# Bodies go up and down on their springs by 1 to 2 Hz, and roads, as they are driven on, much more slowly.
_BOUNCES_HZ = 0.5
# Of a track that is configured wrongly the other one is so much nearer to what it is at most.
_NARROWER, _TRACKS = 0.12, (INDEX["track_width.front"], INDEX["track_width.rear"])
_ROLL_GYRO = 0
# No car's C.G. is as low as this, or as high.
_HEIGHT, _CG_M = INDEX["outer_load.height_m"], (0.2, 1.15)
_AHEAD, _SLIPS = INDEX["side_wind.ahead_m"], INDEX["steering_slip.at_s"]


def is_implausible(drive: Drive, rows: Rows, fit: Fit, effect: str) -> bool:
    """Whether an effect is what it can't be, or a told parameter at the end of what is plausible: something else is."""
    if effect == "sensor_saturation" and (
        _reads_beyond(drive, fit) or _slides(drive, fit) or _stands_elsewhere(drive, rows, fit)
    ):
        return True
    if effect == "side_wind" and _is_no_wind(drive, fit):
        return True
    if effect == OUTER_LOAD and not _CG_M[0] < fit.x[_HEIGHT] < _CG_M[1]:
        return True
    if effect == "low_friction" and _is_no_stretch(drive, fit):
        return True
    if effect == "track_width" and _holds_wheels_together(drive, fit):
        return True
    if effect == "road_grade" and climbs_unfelt(drive):
        return not rises_and_falls(way_of(drive), fit.road.grade_rad) or _is_of_the_speed(drive, rows, fit)
    if effect in TILTS:
        gyro = YAW_GYRO if effect == "road_bank" and is_unfelt(drive) else OWN_CHANNEL[effect]
        is_no_road = _is_denied_by_its_gyro(drive, rows, fit, gyro) or _bounces(fit, effect)
        if is_no_road or pulls_nothing(drive, rows, fit, effect) or is_the_bodys(drive, fit, effect):
            return True
        may_lift_nothing = effect == "road_grade" and is_a_tilt_alone(drive, rows, fit)
        if not may_lift_nothing and tips_only_what_stands_on_it(drive, rows, fit, effect):
            return True
    if effect == "bias_drift" and _wanders(drive, rows, fit):
        return True
    # A clock that goes evenly is none: what comes late has a name, and what comes early has inputs that are late.
    if effect == "imu_clock" and not is_told(drive, fit, effect):
        return True
    # A C.G. that stands above the way on which a road turns is no arm: on one that tilts that is all an arm may be.
    may_be_that = effect == "imu_lever_arm" and bool(TILTS & set(fit.effects))
    # Nor is a tyre's curve a steering, beside a limit of its grip.
    may_be_that |= may_be_a_curve(drive, fit.effects, effect)
    if may_be_that and not is_told(drive, fit, effect):
        return True
    return _ends(drive, fit, effect)


def _is_of_the_speed(drive: Drive, rows: Rows, fit: Fit) -> bool:
    """Whether what an accelerometer takes for a grade goes by the speed."""
    if fit.along is None:
        return False
    level_mps2 = fit.left[:, ALONG] + motion.G * fit.road.grade_rad[rows.at]
    return goes_by_the_speed(drive, rows, level_mps2, fit.along[0])


def is_told(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a fit tells one of an effect's parameters at least; a profile's are no numbers of its own.

    Of wheels their differences count: what all of them have in common may be the scale of something else.
    """
    parameters = drive.vocabulary.columns
    there = [i for i in drive.vocabulary.columns_of(effect) if i in fit.columns]
    told = effect in OWN_CHANNEL or any(_tells(drive, fit, i) for i in there)
    if effect == LOAD and not told:
        return _are_told(drive, fit, [i for i in there if math.isfinite(parameters[i][1].least)])
    return told or wheels_differ(drive, fit, effect)


def is_rather_something(drive: Drive, fit: Fit, effect: str, tyres: Fit | None = None) -> bool:
    """Whether one of an effect's parameters is something rather than nothing, however uncertain it is what.

    Front wheels that give way do not where tyres tell, in a fit of their own, that the rear ones are others.
    """
    if effect == STEERING_COMPLIANCE.name and tyres is not None and _tells(drive, tyres, _REAR_TYRES):
        return False
    there = [i for i in drive.vocabulary.columns_of(effect) if i in fit.columns]
    told = [i for i in there if math.isfinite(drive.vocabulary.columns[i][1].least)]
    return any(abs(fit.x[i]) > _RATHER * fit.std[fit.columns.index(i)] for i in told)


def _tells(drive: Drive, fit: Fit, i: int) -> bool:
    return abs(float(fit.x[i])) >= max(drive.vocabulary.columns[i][1].least, _TOLD * spread_of(fit, i))


def does_nothing(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether an effect of a fit is not there: what slopes say that it would gain it has not."""
    own = [i for i in drive.vocabulary.columns_of(effect) if math.isfinite(drive.vocabulary.columns[i][1].least)]
    return bool(own) and effect not in OWN_CHANNEL and bool((np.abs(fit.x[own]) < _NOTHING).all())


def wheels_differ(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether this is an effect of wheels, and surely not the same one of two of them."""
    if effect not in _OF_WHEELS:
        return False
    there = [i for i in drive.vocabulary.columns_of(effect) if i in fit.columns]
    return any(are_apart(drive, fit, *pair) for pair in combinations(there, 2))


def weighs_nothing(fit: Fit) -> bool:
    """Whether a load is but another place of the C.G., as far as is told, or there is less on board than configured."""
    return _WEIGHT in fit.columns and not fit.x[_WEIGHT] > _WEIGHS * fit.std[fit.columns.index(_WEIGHT)]


def odds_against_less(fit: Fit) -> float:
    """How unlikely so much less than configured on board is to begin with, in log likelihood: who weighs a car does."""
    missing_kg = max(-float(fit.x[_WEIGHT]), 0.0) if _WEIGHT in fit.columns else 0.0
    return 0.5 * (missing_kg / _MAY_BE_MISSING_KG) ** 2


def are_one_turn(fit: Fit) -> bool:
    """Whether two accelerometers leak into each other by as much the other way, as those of a turned mount do."""
    if not set(_LEAKS) <= set(fit.columns):
        return False
    values, spreads = fit.x[list(_LEAKS)], fit.std[[fit.columns.index(i) for i in _LEAKS]]
    are_there = bool((np.abs(values) > _SURELY_LEAKS * spreads).all())
    return are_there and abs(float(values.sum())) < _OPPOSITE * float(np.hypot(*spreads))


def _are_told(drive: Drive, fit: Fit, there: Sequence[int]) -> bool:
    """Whether parameters that may be each other are surely something together: a load, and where it is."""
    much = [i for i in there if abs(fit.x[i]) >= drive.vocabulary.columns[i][1].least]
    if not much:
        return False
    places = [fit.columns.index(i) for i in much]
    covariance, values = fit.covariance[np.ix_(places, places)], fit.x[much]
    return bool(values @ np.linalg.lstsq(covariance, values, rcond=None)[0] > _TOLD_TOGETHER)


def are_apart(drive: Drive, fit: Fit, one: int, other: int) -> bool:
    """Whether two parameters are surely not the same."""
    i, j = fit.columns.index(one), fit.columns.index(other)
    variance = fit.covariance[i, i] + fit.covariance[j, j] - 2.0 * fit.covariance[i, j]
    spread = math.sqrt(max(float(variance), 0.0))
    return bool(abs(fit.x[one] - fit.x[other]) >= max(drive.vocabulary.columns[one][1].least, _TOLD * spread))


def _ends(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether parameters stand at their ends: one that is told, or any where none of the others is told.

    What a drive hardly tells goes to its end for next to nothing, while something else is still wrong.
    """
    at_end, told = [], []
    for i in drive.vocabulary.columns_of(effect):
        parameter = drive.vocabulary.columns[i][1]
        if i not in fit.columns or not math.isfinite(parameter.least):
            continue
        at_end.append(any(abs(fit.x[i] - end) < 1e-6 * abs(end) for end in (parameter.low, parameter.high)))
        told.append(abs(fit.x[i]) > _TOLD * fit.std[fit.columns.index(i)])
    pairs = list(zip(at_end, told, strict=True))
    return any(end and sure for end, sure in pairs) or (any(at_end) and not any(told))


def _holds_wheels_together(drive: Drive, fit: Fit) -> bool:
    """Whether the driven axle's track alone is narrow: its wheels turn alike by what a differential holds."""
    front, rear = (float(fit.x[i]) for i in _TRACKS)
    narrower = rear - front if locks_in_front(drive.car) else front - rear
    return narrower > _NARROWER


def _is_no_wind(drive: Drive, fit: Fit) -> bool:
    """Whether what pushes is of the car, or of the road."""
    by_place = _lulls(drive, fit) or _pushes_an_axle(drive, fit) or _is_a_bank_unfelt(drive, fit)
    return by_place or follows_the_car(drive, fit.x, fit.road) or changes_once(drive, fit.road)


def _lulls(drive: Drive, fit: Fit) -> bool:
    """Whether there is hardly any wind for much of the way: then it is what a car does there that pushes.

    Unless that comes as a gust does: not far ahead of the C.G., and neither with what the car turns, drives or brakes,
    nor with its speed.
    """
    size = round(BLOCK_S / DT_S)
    count = len(drive.steer) // size
    v_mps = np.mean(drive.wheels, axis=1)
    moving = (v_mps > SLOW_MPS)[: count * size].reshape(count, size)
    driven = np.count_nonzero(moving, axis=1) > 0.5 * size
    if np.count_nonzero(driven) < _LEAST_BLOCKS:
        return False

    def rms(course: Floats) -> Floats:
        squares = np.where(moving, (course**2)[: count * size].reshape(count, size), 0.0)
        return np.asarray(np.sqrt(np.sum(squares, axis=1)[driven] / np.count_nonzero(moving, axis=1)[driven]))

    blocks = rms(fit.road.side_n)
    if float(np.quantile(blocks, _MUCH)) >= _HARDLY * float(np.sqrt(np.mean(blocks**2))):
        return False
    if not 0.0 < float(fit.x[_AHEAD]) < _OF_A_GUST * drive.car.cg_to_front_axle_m:
        return True
    yaws_radps = np.nan_to_num(drive.measured[:, YAW_GYRO])
    does = (yaws_radps * v_mps, np.gradient(v_mps, DT_S), v_mps)
    with np.errstate(invalid="ignore"):
        alike = np.abs(np.nan_to_num(np.corrcoef([blocks, *map(rms, does)])[0, 1:]))
    return bool(np.max(alike) > _WITH_THE_CAR)


def _pushes_an_axle(drive: Drive, fit: Fit) -> bool:
    """Whether a wind pushes at an axle or beyond: its wheels are steered otherwise than it is told.

    Or half as far ahead, where it changes twice: a steering sensor that slips on its shaft, and slips back.
    """
    ahead_m, car = float(fit.x[_AHEAD]), drive.car
    nearest_m = _TO_AN_AXLE * car.cg_to_front_axle_m
    if ahead_m > _HALF_AS_FAR * nearest_m and changes_twice(drive, fit.road):
        return True
    return not -_TO_AN_AXLE * car.cg_to_rear_axle_m < ahead_m < nearest_m


def _wanders(drive: Drive, rows: Rows, fit: Fit) -> bool:
    """Whether no offset that moves does so all the way, and further than it wanders: flicker ends elsewhere, too."""
    least = {parameter.name: parameter.least for parameter in drive.vocabulary.described("bias_drift").parameters}
    for c, channel in enumerate(IMU_CHANNELS):
        slope = float(fit.x[INDEX[f"bias_drift.{channel}"]])
        used = rows.used[:, c]
        if abs(slope) < least[channel] or np.count_nonzero(used) < _LEAST_ROWS:
            continue
        time_s, left = rows.at[used] * DT_S, fit.left[used, c]
        gone_s = _gone_s(drive, fit, rows.at[used])
        pieces = np.array_split(np.arange(len(left)), _PIECES)
        # What is left beside the drift, and the drift, wherever it has not faded.
        rates = {k: slope * np.polyfit(time_s[one], gone_s[one], 1)[0] for k, one in enumerate(pieces)}
        there = [k for k, rate in rates.items() if abs(rate) > _FADED * abs(slope)]
        if min(1.0 + np.polyfit(time_s[pieces[k]], left[pieces[k]], 1)[0] / rates[k] for k in there) < _STEADY:
            continue
        count = np.bincount(rows.block[used])
        means = (np.bincount(rows.block[used], left) / np.maximum(count, 1))[count > 0.5 * np.max(count)]
        if abs(slope) * (time_s[-1] - time_s[0]) > _FAR_BEYOND * float(np.std(means)):
            return False
    return True


def _gone_s(drive: Drive, fit: Fit, at: Ints) -> Floats:
    """For how long at its mean rate a drift has gone (k,)."""
    whole_s, fades_per_s = DT_S * len(drive.steer), float(fit.x[INDEX["bias_drift.fades_per_s"]])
    return np.array([drifted_s(DT_S * one, whole_s, fades_per_s) for one in at.tolist()])


def _is_a_bank_unfelt(drive: Drive, fit: Fit) -> bool:
    """Whether there is no roll gyro to feel a bank, and what it is taken from is not told by the wind.

    Both push a car aside; an accelerometer that shows a push that the car does not follow stands on a tilted road.
    """
    return bool(np.isnan(drive.measured[:, _ROLL_GYRO]).all() and far_off(drive, fit)[OWN_CHANNEL["side_wind"]])


def _is_denied_by_its_gyro(drive: Drive, rows: Rows, fit: Fit, c: int) -> bool:
    """Whether a road leaves its own gyro, slowly, nearly as far off as none would: nobody felt it.

    Its corrections are for what a gyro drifts by, and not for what an accelerometer shows by itself. A bank that no
    roll gyro feels turns the car.
    """
    used = rows.used[:, c]
    road, flat_road = (predicted(drive, fit.x, one)[rows.at, c] for one in (fit.road, flat(len(drive.steer))))
    left, block = fit.left[used, c], rows.block[used]
    count = np.bincount(block)
    enough = count > 0.5 * np.max(count, initial=1)

    def slowly(values: Floats) -> float:
        means = np.bincount(block, values)[enough] / count[enough]
        return float(np.var(means)) if len(means) else 0.0

    return slowly(left) > _UNFELT * slowly(left + (road - flat_road)[used])


def _bounces(fit: Fit, effect: str) -> bool:
    """Whether a road tilts to and fro as quickly as a body does on its springs, for the most part."""
    tilt = fit.road.bank_rad if effect == "road_bank" else fit.road.grade_rad
    power = np.abs(np.fft.rfft((tilt - np.mean(tilt)) * np.hanning(len(tilt)))) ** 2
    quick = np.fft.rfftfreq(len(tilt), DT_S) > _BOUNCES_HZ
    return bool(np.sum(power[quick]) > 0.5 * np.sum(power))


def _is_no_stretch(drive: Drive, fit: Fit) -> bool:
    """Whether a slippery stretch is over before a car shows it, or before it begins; or has no end.

    Nor is one that begins or ends as a steering sensor slips: it is how that does.
    """
    begins_s, ends_s = moments = fit.x[moments_of(drive)]
    slips = "steering_slip" in fit.effects and bool(np.min(np.abs(moments - fit.x[_SLIPS])) < SHORTEST_S)
    return slips or not SHORTEST_S <= ends_s - begins_s <= _FOR_A_WHILE * DT_S * len(drive.steer)


def _slides(drive: Drive, fit: Fit) -> bool:
    """Whether grip ends, and no reading stands at a limit: then what goes no further is the car."""
    return bool(GRIP & set(fit.effects)) and not limits_read_off(drive, fit.x)


def _stands_elsewhere(drive: Drive, rows: Rows, fit: Fit) -> bool:
    """Whether readings are not at the limit where they would be beyond it: what goes up and down there is not clipped.

    Of all channels that clip by this fit, by what is left of them there, beside what would be without limits.
    """
    x, limits = fit.x.copy(), {c: float(fit.x[i]) for c, i in _LIMITED.items() if fit.x[i] > 0.0}
    x[list(_LIMITED.values())] = 0.0
    reads = predicted(drive, x, fit.road)[rows.at]
    left, without, beside = 0.0, 0.0, 0.0
    for c, limit in limits.items():
        there = rows.used[:, c] & (np.abs(reads[:, c]) > limit)
        elsewhere = rows.used[:, c] & ~there
        if not there.any() or not elsewhere.any():
            continue
        power = max(float(np.mean(fit.left[elsewhere, c] ** 2)), 1e-30)
        left += float(np.sum(fit.left[there, c] ** 2)) / power
        without += float(np.sum((rows.measured[there, c] - reads[there, c]) ** 2)) / power
        beside += float(np.count_nonzero(there))
    return left > max(_NOT_AT_IT**2 * without, _BESIDE_IT**2 * beside)


def _reads_beyond(drive: Drive, fit: Fit) -> bool:
    """Whether there are readings far beyond a limit that is said to be theirs."""
    for first, name in ((0, "gyro_limit_radps"), (3, "accel_limit_mps2")):
        limit = fit.x[INDEX[f"sensor_saturation.{name}"]]
        read = np.nan_to_num(drive.measured[:, first : first + (3 if first == 0 else 2)])
        if limit > 0.0 and float(np.quantile(np.max(np.abs(read), axis=1), _NEARLY_ALL)) > _BEYOND * limit:
            return True
    return False
