"""Names of the model that are not said, for something without a name explains what they do."""

from __future__ import annotations

from dsz_daemon.diagnose.eccentric import parts_of
from dsz_daemon.diagnose.fit import GRIP, Fit
from dsz_daemon.diagnose.nameless_effects import NAMELESS
from dsz_daemon.diagnose.plausible import is_told
from dsz_daemon.diagnose.prediction import Drive
from dsz_daemon.diagnose.shape_names import SHAPE, is_shape, steers_by_speed
from dsz_daemon.diagnose.trials import TURNS
from dsz_daemon.diagnose.uneven_scales import is_uneven
from dsz_daemon.diagnose.unfelt_banks import is_unfelt

_NAMELESS = frozenset(effect.name for effect in NAMELESS)


def not_named(drive: Drive, fit: Fit) -> set[str]:
    """The effects of a fit that are given no name."""
    names = {*_NAMELESS, *parts_of(drive, fit)}
    # What the steering does by the speed is no number that is the same at all of them.
    if any(map(steers_by_speed, fit.effects)):
        names |= {"steering_ratio"}
    # Nor has what a sensor shows to one side, or as it warms up, a scale beside it.
    uneven = [effect.partition(SHAPE) for effect in fit.effects if is_shape(effect)]
    names |= {f"{place.partition('_')[0]}_scale" for place, _, course in uneven if is_uneven(course)}
    # And what holds a car back in bends, beside an axle whose wheels turn alike, is these wheels'.
    if "locked_axle" in fit.effects and is_told(drive, fit, "locked_axle"):
        names |= {*TURNS}
    if _turns_without_a_name(fit):
        names |= {*TURNS, *GRIP}
    # A bank that no roll gyro feels is what these two show: it is none where either shows something else.
    if is_unfelt(drive) and {"gyro_z", "accel_y"} & _with_own_shapes(fit):
        names |= {"road_bank"}
    return names


def _with_own_shapes(fit: Fit) -> set[str]:
    """The channels that have a shape of their own, and none of the car's."""
    return {effect.partition(SHAPE)[0] for effect in fit.effects if is_shape(effect)}


def _turns_without_a_name(fit: Fit) -> bool:
    """Whether the yaw rate and the lateral acceleration show the same course, each by itself: a car does that."""
    shapes = [effect.partition(SHAPE) for effect in fit.effects if is_shape(effect)]
    yaws, slides = ({course for place, _, course in shapes if place == channel} for channel in ("gyro_z", "accel_y"))
    return bool(yaws & slides)
