"""What a cause says of itself, and whether it is large enough to be called one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dsz_daemon.diagnose.effects.row import CAR, WHEELS, Parameter
from dsz_daemon.diagnose.effects.shape_names import is_of_the_car
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.faults.wiring import AxisFault
from dsz_daemon.diagnose.fitting.gains import told_from
from dsz_daemon.diagnose.fitting.model import GRIP, OWN_CHANNEL
from dsz_daemon.diagnose.fitting.spreads import LIMIT_OF, spread_of
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.plausible import wheels_differ
from dsz_daemon.diagnose.selection.screening import NEVER_SCREENED
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.selection.smaller import unfelt_roads
from dsz_daemon.diagnose.simulation import motion
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.loads import LOAD
from dsz_daemon.diagnose.simulation.pulls import pulled_rad
from dsz_daemon.diagnose.verdict.aliases import MUCH_MPS2, alternatives
from dsz_daemon.diagnose.verdict.manoeuvres import next_manoeuvre
from dsz_daemon.diagnose.verdict.numbers import (
    LEAST_SPREADS,
    as_told,
    offsets_of,
    on_the_clock,
    shares_a_factor,
    values_told,
)
from dsz_daemon.diagnose.verdict.said import Cause, ParameterError, Value

# One number at least has to be off zero by `LEAST_SPREADS`, or all of them together have to gain so much.
_SURE = 10.0 * LEAST_GAIN
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
# Nor less than so much of what pulls the car aside as it is driven, or braked.
_OF_A_PULL = 0.25
# So much of how a car follows its road is not in its recording.
_LIFTS_NOTHING = 0.7
# Of roads without their gyros.
_UNFELT = {"road_bank": "how the car yaws on it", "road_grade": "the accelerometer, as a function of place"}
# A number whose interval has so much of what is plausible is none.
_ALL_OF_IT = 0.8
# Of a moment: so uncertain that no spread is stated.
_NEVER_S = 100.0


def _is_untold(parameter: Parameter, std: float | None) -> bool:
    """Whether nearly all that is plausible is inside the 95 % interval."""
    return std is not None and 2.0 * std > _ALL_OF_IT * (parameter.high - parameter.low) / 2.0


def cause_of(found: Search, effect: str, left: float = 1.0, each: Each = map) -> Cause | None:
    """One named effect; None where it is too small to be given a name, or gains too little.

    Where a simulation is off by `left` times what it may be, what looks like a cause may be how it is wrong: so many
    times more has to be gained.
    """
    described = found.drive.vocabulary.described(effect)
    values = values_told(found, effect)
    # What came before a car did something that has no name may be that.
    is_beside = described.touches == CAR and any(map(is_of_the_car, found.best.effects))
    surely = found.gains[effect] > _SURE and not is_beside
    is_alone = found.best.effects == (effect,) and (described.touches != WHEELS or effect == "wheel_slip")
    share = _ALONE if surely and is_alone else 1.0
    least = {p.name: share * p.least for p in described.parameters}
    if effect == "side_wind":
        least["rms_n"] = _least_wind_n(found.drive, found.best.x)
    # How a tyre's curve bends makes a limit of grip uncertain, not whether there is one; nor do tyres a compliance.
    judged = values
    if effect in GRIP:
        limit = LIMIT_OF[effect]
        judged = {"inverse_square": (float(found.best.x[limit]), spread_of(found.best, limit))}
    elif effect not in {LOAD, *OWN_CHANNEL}:
        judged = values_told(found, effect, as_fitted=True)
    spreads = _OF_WHAT_IS_SURE if surely else LEAST_SPREADS
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
    values, units = as_told(effect, on_the_clock(found, values), units)
    if effect == "low_friction" and _is_no_number(values["friction_coefficient"]):
        return None
    group, others = alternatives(found, effect, left)
    words = described.words.format(**{name: value for name, (value, _) in values.items()})
    untold = [p.name for p in described.parameters if p.name in values and _is_untold(p, values[p.name][1])]
    if untold and len(untold) < len(values):
        words += f" ({', '.join(untold)} not told by this drive)"
    if effect == "wheel_radius" and shares_a_factor(found):
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
        described.source,
    )


def _is_no_number(value: tuple[float, float | None]) -> bool:
    """Whether a friction may as well be none: a stretch of less of it of which nobody knows how much is no stretch."""
    return value[1] is not None and value[1] > value[0]


def _takes_back(found: Search) -> bool:
    """Whether an offset beyond data sheets takes back what gravity makes of a turned mount: then it is no mount."""
    offsets = offsets_of(found, found.best.effects)
    roll, pitch = (float(found.best.x[INDEX[f"imu_misalignment.{axis}_rad"]]) for axis in ("roll", "pitch"))
    of_gravity = {"offset_accel_x": -motion.G * pitch, "offset_accel_y": motion.G * roll}
    return any(
        abs(offsets[name][0]) > MUCH_MPS2 and offsets[name][0] * of_gravity[name] < 0.0
        for name in of_gravity
        if name in offsets
    )


def _least_wind_n(drive: Drive, x: Floats) -> float:
    """The least rms of a side force that is a wind.

    Rounding by e pushes the front axle by C_f e of each tyre; so does what turns the wheels as the car is driven, or
    braked, of which no simulation knows all.
    """
    moving = np.mean(drive.wheels, axis=1) > motion.ROLLING_MPS
    if not moving.any():
        return _LEAST_WIND_N
    rounding_rad = drive.recording.rounding_rad
    steps = np.zeros((1, len(moving))) if rounding_rad is None else np.nan_to_num(rounding_rad)
    v_rate = filtered(np.gradient(np.mean(drive.wheels, axis=1), DT_S), filter_kernel())
    steps_rad, pull_rad = _rms(steps[:, moving]), _rms(pulled_rad(x, v_rate)[moving])
    per_rad = 2.0 * drive.car.front_cornering_stiffness_n_per_rad
    return max(_LEAST_WIND_N, per_rad * max(_BEYOND_STEPS * steps_rad, _OF_A_PULL * pull_rad))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _to_drive_next(found: Search, effect: str, group: list[str], each: Each) -> str | None:
    """What would split an effect from its group; None where it stands alone."""
    screened = [other for other in group if other not in NEVER_SCREENED]
    if not screened or effect in NEVER_SCREENED:
        return None
    words = next_manoeuvre(found.drive, found.best.x, effect, screened, each)
    return words or f"none that steers and brakes splits it from {', '.join(screened)}: weigh the car, measure the part"


def cause_of_a_fault(fault: AxisFault) -> Cause:
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


def cause_of_another_car(errors: Sequence[ParameterError], gain: float) -> list[Cause]:
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
