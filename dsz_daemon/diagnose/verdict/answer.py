"""From the search to what is said: causes with parameters, what they can't be told from, how well it fits then."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsz_daemon.diagnose.effects.nameless import OUTER_LOAD
from dsz_daemon.diagnose.effects.shape_names import NO_SHAPE, is_of_the_car, is_shape
from dsz_daemon.diagnose.faults.bunches import delays_of
from dsz_daemon.diagnose.faults.single_readings import EVERY_OTHER, hidden_by_steps
from dsz_daemon.diagnose.faults.turning_readings import uneven_rings
from dsz_daemon.diagnose.faults.wiring import AxisFault
from dsz_daemon.diagnose.fitting.gains import TOLD_GAIN
from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.residuals.locate import channel_names, located
from dsz_daemon.diagnose.selection.plausible import is_told
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.selection.smaller import asked_of
from dsz_daemon.diagnose.shapes.eccentric import about_the_middle, circle_of
from dsz_daemon.diagnose.shapes.unlisted import (
    Coefficient,
    Found,
    Shape,
    pull_shapes,
    shapes_of_all,
    unit_of,
    unlisted,
    wheel_shapes,
)
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.diagnose.verdict.aliases import same_as_offsets, same_as_slip
from dsz_daemon.diagnose.verdict.causes import cause_of, cause_of_a_fault, cause_of_another_car
from dsz_daemon.diagnose.verdict.configured import BEYOND, TYRES, parameter_errors
from dsz_daemon.diagnose.verdict.goodness import goodness
from dsz_daemon.diagnose.verdict.in_part import explains_a_part, is_of_a_lean, leaves_its_own
from dsz_daemon.diagnose.verdict.late_leans import leans_late, with_their_roads
from dsz_daemon.diagnose.verdict.level import (
    OF_A_TURN,
    TURNED,
    curve_of_an_axle,
    doubt,
    doubt_of,
    driven_by_other_wheels,
    late_besides,
    level_of,
    off_where_nothing_is_said,
    turned_by_another,
    unexplained_of,
    verdict,
)
from dsz_daemon.diagnose.verdict.numbers import offsets_of
from dsz_daemon.diagnose.verdict.paces import differs_by_pace
from dsz_daemon.diagnose.verdict.said import Cause, Diagnosis, Value
from dsz_daemon.diagnose.verdict.steady import changes_all_the_way, times_that_change
from dsz_daemon.diagnose.verdict.unnamed import differ_by, not_named
from dsz_daemon.diagnose.verdict.untested import untested
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

# Units of what is neither of the IMU nor a wheel's speed, by how it is called.
_BY_END = {"_radps": "rad/s", "_rad": "rad"}


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
    no_names |= curve_of_an_axle(found) | driven_by_other_wheels(found, level) | late_besides(found, sure)
    # Nor has what two sensors in turn show a scale that is a number.
    no_names |= {f"{one.channel.partition('_')[0]}_scale" for one in beside if one.shape.endswith(EVERY_OTHER)}
    no_names |= delays_of(beside)
    # Nor does a ring that is not even count as many teeth as another.
    if differ_by(found.drive, found.best, uneven_rings(beside)):
        no_names |= {"wheel_radius"}
    # Nor is known how a hand or a wheel moves of which only steps are.
    by_steps = hidden_by_steps(beside)
    no_names |= by_steps
    effects = {effect for effect in found.best.effects if not is_shape(effect)}
    changing = {effect for effect in effects if changes_all_the_way(found.drive, found.rows, found.best, effect)}
    by_pace = differs_by_pace(found.drive, found.rows, found.best, each)
    late = leans_late(found.best)
    no_names |= changing | set(by_pace) | with_their_roads(late)
    of_all = (found.drive, found.rows, found.best)
    # A reference has faults of its own, and another clock.
    off = {name for name in unexplained_of(found, level, TURNED) if name in (*IMU_CHANNELS, *WHEEL_SPEEDS)}
    no_names |= {effect for effect in effects if leaves_its_own(*of_all, effect, off)}
    if unexplained:
        no_names |= {effect for effect in effects if explains_a_part(*of_all, effect, unexplained)}
        no_names |= {effect for effect, gain in found.gains.items() if is_of_a_lean(effect, gain, unexplained)}
    by_another, turning = turned_by_another(found, level)
    no_names, unexplained = no_names | by_another, [*unexplained, *(c for c in turning if c not in unexplained)]
    # What is given no name has no numbers, but for what is a number of the car and never had one.
    withheld = {key for effect in no_names - {"yaw_inertia"} for key in BEYOND.get(effect, ())}
    # Within tolerance tyres make up for how what turns a car without a name is drawn, and for what nothing explains.
    if TYRES not in found.best.effects and ("gyro_z" in unexplained or any(map(is_of_the_car, sure))):
        withheld |= set(BEYOND[TYRES])
    # Nor is a car that turns otherwise, or whose hand wheel or speed only steps are known of, harder to turn.
    if turning or by_steps:
        withheld |= set(BEYOND["yaw_inertia"])
    errors = [error for error in parameter_errors(found, each) if error.parameter not in withheld]
    named = [effect for effect in found.best.effects if effect not in no_names and not is_shape(effect)]
    doubts = (doubt_of(found, effect, unexplained) for effect in named)
    said = (cause_of(found, effect, left, each) for effect, left in zip(named, doubts, strict=True))
    causes = [cause for cause in said if cause is not None]
    causes.sort(key=lambda cause: -cause.gain)
    causes = [*(cause_of_a_fault(fault) for fault in faults), *cause_of_another_car(errors, by_numbers), *causes]
    # A car has many ways to turn a little otherwise.
    there = [shape for shape in found.shapes if not is_of_the_car(shape.effect.name) or shape.effect.name in sure]

    def is_enough(left: Found) -> bool:
        # What is left of a channel that is explained may be how the simulation draws what explains it.
        return left.channel in unexplained or left.gain >= asked_of(found.drive, left.effect.name, found.gains)

    # When a time is another one says more than that it is.
    shapes = [*beside, *times_that_change(found.drive, found.best, changing - set(by_pace))]
    shapes += [*by_pace.values(), *late.values()]
    shapes += [*unlisted(found.drive, found.rows, found.best, there, is_enough)]
    shapes += [*wheel_shapes(found.drive, found.best), *pull_shapes(found.drive, found.best)]
    shapes += shapes_of_all(found.drive, found.best, {e for e in sure if is_told(found.drive, found.best, e)})
    shapes = shapes if circle is None else about_the_middle(shapes, circle)
    # Where nothing is said, less is enough to say that something is there.
    unexplained = unexplained if causes or shapes else [*unexplained, *off_where_nothing_is_said(found, level)]
    anything = causes or errors or shapes or unexplained
    offsets = offsets_of(found, [cause.effect for cause in causes])
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


def with_nothing_said(said: Diagnosis, found: Search) -> tuple[Diagnosis, Search]:
    """What is said, and the search, where neither a cause nor a number nor a shape is.

    What was fitted and is not said has improved no fit that anybody could have, and explains nothing: where the nominal
    simulation is off, it is `unexplained`. How a car is drawn is no physics left out, whatever that takes off.
    """
    alone = found._replace(best=found.nominal)
    said = said._replace(fit=goodness(alone))
    if set(found.best.effects) <= {OUTER_LOAD}:
        return said, alone
    level = level_of(alone)
    off = off_where_nothing_is_said(alone, level)
    if not off:
        return said, alone
    nominal = found.nominal
    places = located(found.drive, found.rows, nominal.left, _usual(found), nominal.per_row)
    return said._replace(verdict=verdict(False, True), level=level, located=said.located or places), alone


def with_what_has_no_shape(said: Diagnosis, found: Search) -> Diagnosis:
    """Where nothing is said of what is left, at least in which channels it is, the most first, and how much.

    The rms is of all that is left, noise too; its spread that of the mean of blocks.
    """
    if said.causes or said.unlisted or said.verdict != verdict(False, True):
        return said
    turning = [channel for channel in OF_A_TURN if said.level.get(channel, 0.0) >= TURNED]
    off = off_where_nothing_is_said(found, said.level) or set(turning)
    names, sums, shapes = channel_names(found.drive), found.best.sums, list[Shape]()
    for name in sorted(off, key=lambda channel: -said.level[channel]):
        c = names.index(name)
        seen = sums.counts[:, c] > 0
        powers = (sums.left[:, c] * found.best.scatter[:, c] ** 2)[seen] / sums.counts[seen, c]
        rms = float(np.sqrt(np.average(powers, weights=sums.counts[seen, c])))
        std = float(np.std(powers) / np.sqrt(len(powers)) / (2.0 * rms))
        shapes.append(Shape(name, NO_SHAPE, Coefficient(rms, std, _unit(name)), 1.0))
    return said._replace(unlisted=shapes)


def _unit(channel: str) -> str:
    if channel in IMU_CHANNELS:
        return unit_of(IMU_CHANNELS.index(channel))
    return next((unit for end, unit in _BY_END.items() if channel.endswith(end)), "m/s")


def _names_slip_alone(causes: Sequence[Cause]) -> bool:
    """Whether wheels slip, and nothing is said of their radii."""
    return "wheel_slip" in {cause.effect for cause in causes} and "wheel_radius" not in {c.effect for c in causes}


def _usual(found: Search) -> Floats:
    """What each channel scatters by where all is explained."""
    n = np.maximum(found.best.sums.counts.sum(axis=0), 1.0)
    rms = np.sqrt((found.best.sums.left * found.best.scatter**2).sum(axis=0) / n)
    return np.asarray(np.maximum(rms, found.best.scatter.min(axis=0)), dtype=np.float64)
