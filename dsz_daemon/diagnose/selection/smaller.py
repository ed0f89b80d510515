"""Models with an effect less: what of a larger one had to go, and what the rest is worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, partial

from dsz_daemon.diagnose.effects.row import CAR
from dsz_daemon.diagnose.effects.shape_names import is_of_the_car, is_shape, steers_by_speed, with_shapes
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained, is_beyond_form, told_from
from dsz_daemon.diagnose.fitting.model import GRIP, OWN_CHANNEL, Fit, Slopes
from dsz_daemon.diagnose.fitting.spreads import may_be_a_curve
from dsz_daemon.diagnose.fitting.without import slopes_at, surely_without, without
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, all_hands
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.plausible import does_nothing, is_implausible, is_told
from dsz_daemon.diagnose.shapes.shape_beside import another_course
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.surroundings.unfelt_banks import is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt

# What comes after the first may be what the simulation's form gets wrong about it: it has to gain so much of the rest.
_SHARE_OF_ALL = 0.015
# And beside a limit of grip so much of what that gains, if it may be that: every tyre has a curve of its own.
_SHARE_OF_GRIP = 0.08
# A second limit of grip beside the first is that curve once more, unless it does much.
_SHARE_OF_LIMIT = 0.2
# And beside a shape in a gyro, or accelerometer, so much of what that gains, if it is what all of these show: it is the
# simplest of a library, of inputs with their noise, and leaves some of what is there.
_SHARE_OF_SHAPE = 0.1
# And what wheels' sizes are beside tyres that grow, each as it likes and by some power of the speed, and beside slip,
# whose force is no one's to tell.
_OF_ANOTHER = {
    ("wheel_growth", "track_width"): 0.1,
    ("wheel_growth", "wheel_radius"): 0.1,
    ("wheel_square", "wheel_radius"): 0.5,
    # A nose follows the speed as its springs let it, by some delay: with how quickly the car goes faster.
    ("nose_lift", "accel_scale"): 0.1,
    ("nose_lift", "wheel_growth"): 0.1,
    ("wheel_slip", "wheel_radius"): 0.05,
    # Just when front wheels let go no simulation knows to the row, and what that leaves turns a car as a push does.
    ("steering_backlash", "side_wind"): 0.03,
}
# The hand wheel's sine, of which a ratio is one half: an eccentric sensor has both.
_OF_THE_HAND, _SHARE_OF_HAND = "hand", 1.0
# A ratio that follows the speed is no number: what is left of it does not come of a simulation's form.
_SHARE_OF_SPEED = 0.05
# The same for one that steers and what a car does, or what looks like a car that turns otherwise: its rear wheels may
# steer, or what steers it has another phase. Neither is a car in a simulation to the letter what it is on a road.
_SHARE_OF_STEERING, _PLACE_AND_TIME = 0.25, {"imu_lever_arm", "imu_delay", "sensor_bandwidth"}

# What gains so much stands by itself.
BY_ITSELF = 100.0
_WIND = "side_wind"
_INSTRUMENTS = ("gyro", "accel")


def share_of_all(gains: Mapping[str, float]) -> float:
    """What one effect has to gain beside others; no simulation's form gets wrong that a sensor clips."""
    return _SHARE_OF_ALL * sum(gain for effect, gain in gains.items() if effect != "sensor_saturation")


def asked_of(drive: Drive, effect: str, gains: Mapping[str, float]) -> float:
    """What this effect, or shape, has to gain beside others."""
    is_one = is_shape(effect) or may_be_a_curve(drive, gains, effect)
    share = _SHARE_OF_LIMIT if effect in GRIP else _SHARE_OF_GRIP if is_one else 0.0
    by_grip = [share * gains[limit] for limit in (GRIP - {effect}) & gains.keys()]
    by_shapes = [_share_of(drive, effect, other) * gain for other, gain in gains.items()]
    return max([share_of_all(gains), *by_grip, *by_shapes])


def _share_of(drive: Drive, effect: str, other: str) -> float:
    """What an effect has to gain of what another does: some do by themselves, else a shape and a name."""
    if (other, effect) in _OF_ANOTHER:
        return _OF_ANOTHER[other, effect]
    if is_shape(effect) == is_shape(other):
        return 0.0
    shape, name = (effect, other) if is_shape(effect) else (other, effect)
    if is_of_the_car(shape):
        if name == "steering_ratio" and _OF_THE_HAND in shape:
            return _SHARE_OF_HAND
        if name == "steering_ratio" and steers_by_speed(shape):
            return _SHARE_OF_SPEED
        is_alike = drive.vocabulary.described(name).touches == CAR or name in _PLACE_AND_TIME
        return _SHARE_OF_STEERING if is_alike else 0.0
    instrument = name.partition("_")[0]
    is_alike = shape is other and instrument in _INSTRUMENTS and shape.startswith(instrument)
    return _SHARE_OF_SHAPE if is_alike else 0.0


class Grown:
    """A model with one effect more than it had `before`, and what it is with one less, fitted side by side."""

    def __init__(
        self, drive: Drive, rows: Rows, tolerance: Mapping[str, float], before: Fit, now: Fit, each: Each = map
    ) -> None:
        self._drive, self._rows, self._tolerance, self._each = drive, rows, tolerance, each
        self._before, self._now = before, now
        self._is_on_a_road = bool(OWN_CHANNEL.keys() & set(before.effects))

    def settled(self) -> Fit | None:
        """The model without its newest effect, if that is all it gains over what it was before.

        Beside a road fits are not settled: what any other candidate would have brought, too, is the model's own.
        """
        if not self._is_on_a_road:
            return None
        rest = self._smaller[self._now.effects[-1]]
        is_all = gained(self._drive, rest, self._now) < LEAST_GAIN < gained(self._drive, self._before, rest)
        return rest if is_all else None

    def without_idle(self, gains: dict[str, float]) -> Fit:
        """Each earlier effect is tried without: what another explains better has to go. Writes what the others gain.

        What drives another out has gained what both did.
        """
        best, new = self._now, self._now.effects[-1]
        for effect in self._now.effects[:-1]:
            rest = self._smaller[effect] if best is self._now else self._without(best, effect)
            gains[effect] = 0.0 if does_nothing(self._drive, best, effect) else self._worth(rest, best)
            if gains[effect] < LEAST_GAIN:
                best = rest
        if best is not self._now:
            gains[new] = max(gains[new], self._worth(self._without(best, new), best))
        return best

    def what_stays(self, gains: Mapping[str, float]) -> tuple[Fit, dict[str, float]]:
        """The model without what does nothing beside its newest, a shape, and what the rest gains.

        That is no more than it did without the shape: what a name gains with its help it does not gain by itself.
        """
        now = dict(gains)
        best = self.without_idle(now)
        return best, {effect: min(gains[effect], now[effect]) for effect in best.effects}

    @cached_property
    def known(self) -> Slopes:
        """The slopes of the model as it is now."""
        return slopes_at(self._drive, self._rows, self._now, self._each)

    @cached_property
    def _smaller(self) -> dict[str, Fit]:
        effects = self._now.effects if self._is_on_a_road else self._now.effects[:-1]
        # What takes longest comes first.
        effects = tuple(sorted(effects, key=lambda effect: effect not in OWN_CHANNEL))
        # By these, which are taken side by side, too.
        known = self.known if effects else None
        fits = all_hands(partial(self._surely_without, known), effects, self._each)
        return dict(zip(effects, fits, strict=True))

    def _worth(self, rest: Fit, fit: Fit) -> float:
        return gained(self._drive, rest._replace(form=self._rows.form), fit)

    def _surely_without(self, known: Slopes | None, effect: str, each: Each) -> Fit:
        now = self._now

        def worth(rest: Fit) -> float:
            return min(self._worth(rest, now), gained(self._drive, rest, now))

        return surely_without(self._drive, self._rows, now, self._tolerance, effect, known, worth, each)

    def _without(self, fit: Fit, effect: str) -> Fit:
        return without(self._drive, self._rows, fit, self._tolerance, (effect,), self._each)


def plausible(
    drive: Drive, rows: Rows, before: Fit, best: Fit, tolerance: Mapping[str, float], each: Each
) -> tuple[Fit, set[str]]:
    """The model without effects that want to be what they can't be beside the newest, and what is refused next.

    Beside what comes in later an effect that had to go may be what it can be. What came in now, and explains less than
    what it drives out, has to go itself: then the model is the one `before`. A grade that no gyro feels is as smooth as
    it is beside the newest.
    """
    lost = set(before.effects) - set(best.effects)
    if lost and gained(drive, best, before) > gained(drive, before, best):
        return before, {best.effects[-1]}
    new, wrong = best.effects[-1], {effect for effect in best.effects if is_implausible(drive, rows, best, effect)}
    if not wrong:
        felt = best.felt.smoothed_anew()
        if felt is not None:
            best = fitted(drive, rows, best.x, best.effects, tolerance, each=each, felt=felt)
        return best, wrong
    rest = without(drive, rows, best, tolerance, wrong, each)
    # Neither is the larger one: each is held against the other by its own independent rows.
    if new not in wrong and gained(drive, rest, before) > max(gained(drive, before, rest), LEAST_GAIN):
        return before, {new}
    return rest, wrong


def unfelt_roads(drive: Drive) -> list[str]:
    """Roads that an accelerometer shows by itself, where no gyro feels them."""
    return [*(["road_bank"] if is_unfelt(drive) else []), *(["road_grade"] if climbs_unfelt(drive) else [])]


def worth_now(
    drive: Drive,
    rows: Rows,
    best: Fit,
    tolerance: Mapping[str, float],
    gains: Mapping[str, float],
    came: Sequence[str],
    each: Each,
) -> dict[str, float]:
    """What was gained; of some, what they gain beside all that came after.

    Such are roads that no gyro feels, since what is quick hides a hill, and a wind that was felt anew, by other tyres
    than those that it came with. What `came` after something that has given its place to another is worth no more than
    it is beside that: it may have made up for what was wrong there.
    """
    mine = {effect: gains[effect] for effect in best.effects}
    later = set(unfelt_roads(drive))
    if best.felt.is_anew and mine.get(_WIND, math.inf) < told_from(drive, best, _WIND):
        later |= {_WIND}
    for one in later & set(best.effects):
        mine[one] = max(mine[one], gained(drive, without(drive, rows, best, tolerance, (one,), each), best))
    gone = [place for place, effect in enumerate(came) if effect not in best.effects]
    after = came[gone[0] :] if gone else ()
    for one in [effect for effect in after if effect in mine and not is_shape(effect)]:
        mine[one] = min(mine[one], gained(drive, without(drive, rows, best, tolerance, (one,), each), best))
    return mine


def without_trifles(
    drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float], gains: Mapping[str, float], each: Each
) -> Fit:
    """What came early has to gain its share of all that was gained in the end, too."""
    mine = {effect: gains[effect] for effect in best.effects}
    # An accelerometer's own road would hide there what is not said.
    hidden = {road for road in unfelt_roads(drive) if mine.get(road, 0.0) < told_from(drive, best, road)}
    trifles = [
        effect
        for effect in best.effects
        if effect in hidden
        or (
            mine[effect] < asked_of(drive, effect, mine)
            and not is_beyond_form(drive, without(drive, rows, best, tolerance, (effect,), each), best)
        )
    ]
    return without(drive, rows, best, tolerance, trifles, each) if trifles else best


def without_leaners(
    drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float], gains: Mapping[str, float], each: Each
) -> Fit:
    """The model without what gains too little to be told where what is not told is out of it.

    A mount that is turned by too little to have a name takes some of what a shape leaves, and what that does to the
    gyros takes a leak: what is not said is no ground for what is.
    """
    names = [effect for effect in best.effects if not is_shape(effect)]
    silent = {effect for effect in names if not is_told(drive, best, effect)}
    weak = [effect for effect in names if effect not in silent and gains[effect] < BY_ITSELF]
    if not silent or not weak:
        return best
    rest = without(drive, rows, best, tolerance, silent, each)
    # None of them is alone, though what is not told is out.
    beside = rest._replace(effects=best.effects)
    leaners = [
        effect
        for effect in weak
        if gained(drive, without(drive, rows, rest, tolerance, (effect,), each), rest)
        < told_from(drive, beside, effect)
    ]
    return without(drive, rows, best, tolerance, leaners, each) if leaners else best


def without_courses(
    drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float], gains: Mapping[str, float], each: Each
) -> Fit:
    """The model without what gains little, beside a shape of its own instrument, and no more than that bent otherwise.

    A shape is the simplest of a library. Between a square and a cube it leaves what a scale does, too.
    """
    shaped = with_shapes(best.effects)
    for effect in [name for name in best.effects if not is_shape(name) and gains[name] < BY_ITSELF]:
        instrument = effect.partition("_")[0]
        channels = [channel for channel in shaped if instrument in _INSTRUMENTS and channel.startswith(instrument)]
        if not channels:
            continue
        rest = without(drive, rows, best, tolerance, (effect,), each)
        known = slopes_at(drive, rows, rest, each)
        if another_course(drive, rows, rest, known, tolerance, channels) > gained(drive, rest, best):
            best = rest
    return best


def without_idle_shapes(drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float], each: Each) -> Fit:
    """The model without shapes that came first and do nothing beside what came after them."""
    for effect in [name for name in best.effects if is_shape(name) and not is_told(drive, best, name)]:
        rest = without(drive, rows, best, tolerance, (effect,), each)
        if gained(drive, rest, best) < LEAST_GAIN:
            best = rest
    return best
