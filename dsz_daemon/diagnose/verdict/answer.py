"""From the search to what is said: causes with parameters, what they can't be told from, how well it fits then."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from dsz_daemon.diagnose.effects.nuisances import TOLERATED
from dsz_daemon.diagnose.effects.row import CAR, WHEELS
from dsz_daemon.diagnose.effects.shape_names import is_of_the_car, is_shape
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.faults.wiring import AxisFault
from dsz_daemon.diagnose.fitting.fit import GRIP, OF_ITSELF, values_of
from dsz_daemon.diagnose.fitting.gains import TOLD_GAIN, told_from
from dsz_daemon.diagnose.fitting.mounts import BY_GRAVITY, as_offsets_else
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.residuals.locate import located
from dsz_daemon.diagnose.selection import search as searching
from dsz_daemon.diagnose.selection.plausible import is_told, wheels_differ
from dsz_daemon.diagnose.selection.screening import NEVER_SCREENED
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.selection.smaller import unfelt_roads
from dsz_daemon.diagnose.shapes.eccentric import about_the_middle, circle_of
from dsz_daemon.diagnose.shapes.unlisted import Shape, pull_shapes, shapes_of_all, unlisted, wheel_shapes
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.prediction import Drive, Floats, driven
from dsz_daemon.diagnose.verdict.aliases import MUCH_MPS2, alternatives, same_as_offsets, same_as_slip
from dsz_daemon.diagnose.verdict.goodness import goodness
from dsz_daemon.diagnose.verdict.grip import over_shapes
from dsz_daemon.diagnose.verdict.in_part import explains_a_part
from dsz_daemon.diagnose.verdict.level import doubt, doubt_of, level_of, turned_by_another, unexplained_of, verdict
from dsz_daemon.diagnose.verdict.manoeuvres import next_manoeuvre
from dsz_daemon.diagnose.verdict.said import Cause, Diagnosis, ParameterError, Value
from dsz_daemon.diagnose.verdict.told_roads import rms_told, told_road
from dsz_daemon.diagnose.verdict.unnamed import not_named
from dsz_daemon.diagnose.verdict.untested import untested

_TOLERATED_SPREADS, _LEAST_STIFFNESS, _LEAST_TOLERATED = 3.0, 0.03, 0.005
# A stiffness that gains less of what all causes gain only takes up what the simulation's form gets wrong about these.
_STIFFNESS_SHARE = 0.05
# One number at least has to be off zero by so many of its spreads, or all of them together have to gain much.
_LEAST_SPREADS, _SURE = 2.0, 10.0 * LEAST_GAIN
# Of what gains that much parameters may hide each other; but one that is nothing as likely as not is no number.
_OF_WHAT_IS_SURE = 0.5
# And what alone surely is there has a name from half of the size, but for wheels' radii, which may all turn by a scale.
_ALONE = 0.5
# Counted in sealed trials (`dsz prove`, seeds 2031 and 2032): how often a cause was true by what it gained.
_EVEN_ODDS_GAIN = 10.0
# The rms of a wind that is one: less is no more than a crosswind that changes by 0.3 m/s on a motorway, and any small
# thing in the steering turns a car as much.
_LEAST_WIND_N = 25.0
# Nor is it one that pushes no more than so many times what the steering's resolution does: half a degree is 13 N.
_BEYOND_STEPS = 3.0
# Of a factor that all wheels share: a drive that tells it no better does not tell it.
_UNTOLD_FACTOR = 0.005
# Values with their spreads, None where there is none.
Told = dict[str, tuple[float, float | None]]
# So much of how a car follows its road is not in its recording.
_LIFTS_NOTHING = 0.7
# Of roads without their gyros.
_UNFELT = {"road_bank": "how the car yaws on it", "road_grade": "the accelerometer, as a function of place"}
# Of a moment: so uncertain that no spread is stated.
_NEVER_S = 100.0
# As the contract has them: true over configured, which is 1 where nothing is left out.
_OVER_CONFIGURED = {("wheel_radius", wheel) for wheel in ("fl", "fr", "rl", "rr")} | {
    ("steering_ratio", "scale"),
    ("cornering_stiffness", "front_scale"),
    ("cornering_stiffness", "rear_scale"),
    ("track_width", "front"),
    ("track_width", "rear"),
}
# What is configured, by the effect that it is where it is off by more than its tolerance.
_TYRES = "cornering_stiffness"
_BEYOND = {
    _TYRES: {f"{axle}_cornering_stiffness_n_per_rad": f"{axle}_scale" for axle in ("front", "rear")},
    "track_width": {f"{axle}_track_m": axle for axle in ("front", "rear")},
    "yaw_inertia": {"yaw_inertia_kgm2": "share"},
}


def answered(
    found: Search,
    faults: Sequence[AxisFault] = (),
    each: Each = map,
    by_numbers: float = 0.0,
    beside: Sequence[Shape] = (),
) -> Diagnosis:
    """What is said of a search, after faults that were mended; `by_numbers`: what the car's numbers gain over names.

    `beside`: shapes of what drives the simulation.
    """
    level = level_of(found)
    unexplained = unexplained_of(found, level)
    circle = circle_of(found.drive, found.best)
    left = doubt(found, unexplained)
    sure = {effect for effect, gain in found.gains.items() if gain > TOLD_GAIN * left}
    no_names = not_named(found.drive, found.best, sure)
    if unexplained:
        of_all = (found.drive, found.rows, found.best)
        no_names |= {e for e in found.best.effects if not is_shape(e) and explains_a_part(*of_all, e, unexplained)}
    by_another, turning = turned_by_another(found, level)
    no_names, unexplained = no_names | by_another, [*unexplained, *(c for c in turning if c not in unexplained)]
    # What is given no name has no numbers, but for what is a number of the car and never had one.
    withheld = {key for effect in no_names - {"yaw_inertia"} for key in _BEYOND.get(effect, ())}
    # Within their tolerance tyres make up for how what turns a car without a name is drawn.
    if _TYRES not in found.best.effects and any(map(is_of_the_car, sure)):
        withheld |= set(_BEYOND[_TYRES])
    errors = [error for error in parameter_errors(found, each) if error.parameter not in withheld]
    named = [effect for effect in found.best.effects if effect not in no_names and not is_shape(effect)]
    doubts = (doubt_of(found, effect, unexplained) for effect in named)
    said = (_cause(found, effect, left, each) for effect, left in zip(named, doubts, strict=True))
    causes = [cause for cause in said if cause is not None]
    causes.sort(key=lambda cause: -cause.gain)
    causes = [*(_fault(fault) for fault in faults), *_another_car(errors, by_numbers), *causes]
    # A car has many ways to turn a little otherwise.
    there = [shape for shape in found.shapes if not is_of_the_car(shape.effect.name) or shape.effect.name in sure]
    shapes = [*beside, *unlisted(found.drive, found.rows, found.best, there)]
    shapes += [*wheel_shapes(found.drive, found.best), *pull_shapes(found.drive, found.best)]
    shapes += shapes_of_all(found.drive, found.best, {e for e in sure if is_told(found.drive, found.best, e)})
    shapes = shapes if circle is None else about_the_middle(shapes, circle)
    anything = causes or errors or shapes or unexplained
    offsets = _offsets(found, [cause.effect for cause in causes])
    return Diagnosis(
        verdict(bool(causes), bool(shapes or unexplained)),
        located(found.drive, found.rows, found.nominal.left, _usual(found), found.best.per_row) if anything else [],
        causes,
        errors,
        shapes,
        goodness(found),
        level,
        untested(found, each),
        {name: Value(v, s, "rad/s" if "gyro" in name else "m/s2") for name, (v, s) in offsets.items()},
        same_as_offsets({name: v for name, (v, _) in offsets.items()}),
        same_as_slip(found.drive, found.rows) if _names_slip_alone(causes) else [],
    )


def _names_slip_alone(causes: Sequence[Cause]) -> bool:
    """Whether wheels slip, and nothing is said of their radii."""
    return "wheel_slip" in {cause.effect for cause in causes} and "wheel_radius" not in {c.effect for c in causes}


def _offsets(found: Search, causes: Collection[str] = ()) -> dict[str, tuple[float, float]]:
    """Each channel's offset and spread beside these causes.

    With what gravity makes of a tilted road or a turned mount that is no cause.
    """
    turned = "imu_misalignment" in found.best.effects and "imu_misalignment" not in causes
    values = values_of(found.drive, found.best, "")
    offsets = {name: value for name, value in values.items() if name.startswith("offset_")}
    bank, grade = told_road(found.drive, found.best, causes)[1]
    roll, pitch = (found.best.x[INDEX[f"imu_misalignment.{axis}_rad"]] if turned else 0.0 for axis in ("roll", "pitch"))
    for name, tilt_rad in (("offset_accel_x", grade - pitch), ("offset_accel_y", bank + roll)):
        value, std = offsets[name]
        offsets[name] = (value + motion.G * float(tilt_rad), std)
    return offsets


def _usual(found: Search) -> Floats:
    """What each channel scatters by where all is explained."""
    n = np.maximum(found.best.sums.counts.sum(axis=0), 1.0)
    rms = np.sqrt((found.best.sums.left * found.best.scatter**2).sum(axis=0) / n)
    return np.asarray(np.maximum(rms, found.best.scatter.min(axis=0)), dtype=np.float64)


def _cause(found: Search, effect: str, left: float = 1.0, each: Each = map) -> Cause | None:
    """One named effect; None where it is too small to be given a name, or gains too little.

    Where a simulation is off by `left` times what it may be, what looks like a cause may be how it is wrong: so many
    times more has to be gained.
    """
    described = found.drive.vocabulary.described(effect)
    values = _values(found, effect)
    # What came before a car did something that has no name may be that.
    is_beside = described.touches == CAR and any(map(is_of_the_car, found.best.effects))
    surely = found.gains[effect] > _SURE and not is_beside
    is_alone = found.best.effects == (effect,) and (described.touches != WHEELS or effect == "wheel_slip")
    share = _ALONE if surely and is_alone else 1.0
    least = {p.name: share * p.least for p in described.parameters}
    if effect == "side_wind":
        least["rms_n"] = _least_wind_n(found.drive)
    # How a tyre's curve bends makes a limit of grip uncertain, not whether there is one.
    judged = values_of(found.drive, found.best, effect) if effect in GRIP else values
    spreads = _OF_WHAT_IS_SURE if surely else _LEAST_SPREADS
    judged = {name: told for name, told in judged.items() if math.isfinite(least.get(name, math.inf))}
    named = [abs(value) >= max(least[name], spreads * (std or 0.0)) for name, (value, std) in judged.items()]
    # What wheels have in common may be the scale of something else: their differences count, too.
    is_much = not named or any(named) or wheels_differ(found.drive, found.best, effect)
    if not is_much or found.gains[effect] < left * told_from(found.drive, found.best, effect):
        return None
    if effect == "imu_misalignment" and not surely and _takes_back(found):
        return None
    units = {p.name: p.unit for p in described.parameters}
    values = {n: v for n, v in values.items() if not math.isinf(least.get(n, 0.0)) or n in {"start_s", "end_s"}}
    values = {
        n: (v, None if s is not None and s > _NEVER_S and n.endswith("_s") else s) for n, (v, s) in values.items()
    }
    values, units = _as_told(effect, _on_the_clock(found, values), units)
    group, others = alternatives(found, effect, left)
    words = described.words.format(**{name: value for name, (value, _) in values.items()})
    if effect == "wheel_radius" and _shares_a_factor(found):
        words += ", but for a factor that all share, which this drive does not tell"
    if effect in _UNFELT and effect in unfelt_roads(found.drive):
        words += f", which no gyro feels: told by {_UNFELT[effect]}"
    if effect == "road_grade" and found.best.x[INDEX["flat_roads"]] > _LIFTS_NOTHING:
        words += ", by its gravity alone: accel_z shows nothing of a car that follows such a road"
    odds = sum(float(one["probability"]) for one in others if one["effect"] not in group)
    return Cause(
        effect,
        (1.0 - odds) * found.gains[effect] / (found.gains[effect] + _EVEN_ODDS_GAIN),
        words,
        {name: Value(value, s, units[name]) for name, (value, s) in values.items()},
        described.equation,
        found.gains[effect],
        dict(found.elsewhere[effect]),
        group,
        others,
        _to_drive_next(found, effect, group, each),
    )


def _takes_back(found: Search) -> bool:
    """Whether an offset beyond data sheets takes back what gravity makes of a turned mount: then it is no mount."""
    offsets = _offsets(found, found.best.effects)
    roll, pitch = (float(found.best.x[INDEX[f"imu_misalignment.{axis}_rad"]]) for axis in ("roll", "pitch"))
    of_gravity = {"offset_accel_x": -motion.G * pitch, "offset_accel_y": motion.G * roll}
    return any(
        abs(offsets[name][0]) > MUCH_MPS2 and offsets[name][0] * of_gravity[name] < 0.0
        for name in of_gravity
        if name in offsets
    )


def _least_wind_n(drive: Drive) -> float:
    """The least rms of a side force that is a wind; rounding by e pushes the front axle by C_f e of each tyre."""
    rounding_rad = drive.recording.rounding_rad
    if rounding_rad is None:
        return _LEAST_WIND_N
    moving = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS
    rms_rad = float(np.sqrt(np.mean(np.nan_to_num(rounding_rad[:, moving]) ** 2))) if moving.any() else 0.0
    return max(_LEAST_WIND_N, _BEYOND_STEPS * 2.0 * drive.car.front_cornering_stiffness_n_per_rad * rms_rad)


def _to_drive_next(found: Search, effect: str, group: list[str], each: Each) -> str | None:
    """What would split an effect from its group; None where it stands alone."""
    screened = [other for other in group if other not in NEVER_SCREENED]
    if not screened or effect in NEVER_SCREENED:
        return None
    words = next_manoeuvre(found.drive, found.best.x, effect, screened, each)
    return words or f"none that steers and brakes splits it from {', '.join(screened)}: weigh the car, measure the part"


def _fault(fault: AxisFault) -> Cause:
    """An axis that is not what it is called, which was put right before anything else."""
    kind = fault.kind.replace("_", " ").replace(" for ", " instead of ")
    return Cause(
        "axis_fault",
        1.0 / (1.0 + math.exp(-min(fault.gain, 50.0))),
        f"{fault.channel} is not what it is called: {kind} ({fault.evidence.rstrip('.')})",
        {"channel": Value(fault.channel, None, ""), "kind": Value(fault.kind, None, "")},
        "reading_i = s u reading_j",
        fault.gain,
        {},
        [],
        [],
        None,
    )


def _another_car(errors: Sequence[ParameterError], gain: float) -> list[Cause]:
    """A configuration that is another car's, if its numbers gain so much over names of what is left out."""
    if gain <= 0.0 or not errors:
        return []
    words = ", ".join(f"{error.parameter} by {error.fitted / error.configured - 1.0:+.1%}" for error in errors)
    return [
        Cause(
            "configuration",
            gain / (gain + _EVEN_ODDS_GAIN),
            f"The car is not the one that is configured: off are {words} (forces and inertia by the mass)",
            {e.parameter: Value(e.fitted / e.configured, e.std / e.configured, "1") for e in errors},
            "m, I_z, l_f, l_r, C_f, C_r of (1), ratio, v = v_x -+ r track / 2",
            gain,
            {},
            [],
            [],
            None,
        )
    ]


def _values(found: Search, effect: str) -> Told:
    """(value, spread) of an effect's parameters; of a profile its rms over what was driven."""
    profile = rms_told(found.drive, found.rows, found.best, effect)
    if profile is not None:
        return profile
    values: Told = dict(values_of(found.drive, found.best, effect))
    if effect in BY_GRAVITY:
        values = as_offsets_else(found.drive.vocabulary.described(effect).parameters, values)
    if effect == "wheel_radius" and _shares_a_factor(found):
        values = _apart(found, values)
    if "inverse_square" in values:
        square, std = values["inverse_square"]
        mean, spread = over_shapes(*_front_share(found, effect))
        square /= mean * mean
        values["inverse_square"] = (square, math.hypot((std or 0.0) / mean**2, 2.0 * square * spread / mean))
    return values


def _of_radii(found: Search) -> tuple[Floats, Floats]:
    """The wheels' radii (4,), as shares beyond 1, and their covariance (4, 4)."""
    best = found.best
    columns = found.drive.vocabulary.columns_of("wheel_radius")
    places = [best.columns.index(i) for i in columns]
    covariance = np.zeros((4, 4)) if best.covariance is None else best.covariance[np.ix_(places, places)]
    return best.x[list(columns)], covariance


def _shares_a_factor(found: Search) -> bool:
    """Whether all radii may be off by one factor that this drive does not tell."""
    radii, covariance = _of_radii(found)
    spread = math.sqrt(float(np.sum(covariance))) / 4.0
    return spread > _UNTOLD_FACTOR and abs(float(np.mean(radii))) < _LEAST_SPREADS * spread


def _apart(found: Search, values: Told) -> Told:
    """Radii against their mean, with the spread of that."""
    radii, covariance = _of_radii(found)
    against = np.eye(4) - 0.25
    apart = against @ radii
    spread = np.hypot(np.sqrt(np.diag(against @ covariance @ against.T)), OF_ITSELF * apart)
    return dict(zip(values, zip(apart.tolist(), spread.tolist(), strict=True), strict=True))


def _front_share(found: Search, effect: str) -> tuple[Floats, float]:
    """The front axle's lateral force over its limit (k,) wherever grip ends, and how sharply the fit bends it.

    Of the limit counts what drive and brakes leave of it.
    """
    drive, best = found.drive, found.best
    moving, car = driven(drive, best.x, best.road), drive.car
    grip = moving.road.grip[found.rows.at]
    load_n = car.mass_kg * motion.G * car.cg_to_rear_axle_m / car.wheelbase_m
    free_n = load_n * moving.rolling.front_free[found.rows.at]
    share = moving.moved[found.rows.at, motion.FRONT_N] * np.sqrt(grip) / free_n
    return share[grip > 0.0], motion.SHARPNESS + float(best.x[INDEX[f"{effect}.sharpness"]])


def _on_the_clock(found: Search, values: Told) -> Told:
    """Moments, in which the simulation counts what was recorded, in s since the first frame: pauses count, too."""
    time_s = found.drive.recording.time_s

    def at(moment_s: float) -> float:
        return float(time_s[min(max(round(moment_s / DT_S), 0), len(time_s) - 1)])

    return {n: (at(v), s) if n in {"start_s", "end_s"} else (v, s) for n, (v, s) in values.items()}


def _as_told(effect: str, values: Told, units: dict[str, str]) -> tuple[Told, dict[str, str]]:
    """In the parameters that the outside knows."""
    units = units | {"rms_rad": "rad", "rms_n": "N", "friction_coefficient": "1", "cutoff_hz": "Hz"}
    if "inverse_square" in values:
        square, std = values.pop("inverse_square")
        friction = square**-0.5
        values = {"friction_coefficient": (friction, 0.5 * friction * (std or 0.0) / square)} | values
    if effect == "sensor_bandwidth":
        time_constant_s, std = values["time_constant_s"]
        cutoff_hz = 1.0 / (2.0 * math.pi * time_constant_s)
        values = values | {"cutoff_hz": (cutoff_hz, cutoff_hz * (std or 0.0) / time_constant_s)}
    told = {
        name: (value + 1.0, std) if (effect, name) in _OVER_CONFIGURED else (value, std)
        for name, (value, std) in values.items()
    }
    return told, units


def parameter_errors(found: Search, each: Each) -> list[ParameterError]:
    """Configured parameters that fit better otherwise: by more than their spread, and on unseen data."""
    values, beyond = values_of(found.drive, found.best, ""), set[str]()
    for effect in set(_BEYOND) & set(found.best.effects):
        far = values_of(found.drive, found.best, effect)
        values |= {key: far[name] for key, name in _BEYOND[effect].items()}
        beyond |= set(_BEYOND[effect])
    off = dict[str, tuple[float, float]]()
    for parameter in TOLERATED:
        share, std = values.get(parameter.name, (0.0, 0.0))
        least = _LEAST_STIFFNESS if "stiffness" in parameter.name else _LEAST_TOLERATED
        if abs(share) > max(_TOLERATED_SPREADS * std, least):
            off[parameter.name] = share, std
    # What is beyond its tolerance has earned its place already.
    asked = max(LEAST_GAIN, _STIFFNESS_SHARE * sum(found.gains.values()))
    if not set(off) <= beyond and searching.tolerance_gain(found, each) < asked:
        off = {key: told for key, told in off.items() if key in beyond}
    errors = []
    for key, (share, std) in off.items():
        configured = found.drive.steering_ratio if key == "steering_ratio" else float(getattr(found.drive.car, key))
        errors.append(ParameterError(key, configured, configured * (1.0 + share), configured * std))
    return errors
