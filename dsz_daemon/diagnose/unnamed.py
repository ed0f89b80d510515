"""Names of the model that are not said, for something without a name, which is said, explains what they do."""

from __future__ import annotations

from collections.abc import Collection

from dsz_daemon.diagnose.eccentric import parts_of
from dsz_daemon.diagnose.fit import GRIP, Fit
from dsz_daemon.diagnose.nameless_effects import NAMELESS
from dsz_daemon.diagnose.plausible import is_told
from dsz_daemon.diagnose.prediction import Drive
from dsz_daemon.diagnose.shape_names import SHAPE, is_of_the_car, is_shape, steers_by_speed
from dsz_daemon.diagnose.trials import TURNS
from dsz_daemon.diagnose.uneven_scales import is_uneven
from dsz_daemon.diagnose.unfelt_banks import is_unfelt

_NAMELESS = frozenset(effect.name for effect in NAMELESS)
# In the course of what a yaw gyro shows: the car's steering, sideslip and tyres, and not the gyro's own rate alone.
# Drive and brakes turn a car besides.
_OF_A_TURN = ("delta", "ay", "vy", "r'")


def not_named(drive: Drive, fit: Fit, sure: Collection[str]) -> set[str]:
    """The effects of a fit that are given no name.

    What a car does without a name is said where it is `sure`: what is not said is no ground (decision 0054). A sensor's
    own shape is said always.
    """
    said = [e for e in fit.effects if is_shape(e) and (e in sure or not is_of_the_car(e))]
    shapes = [(place, course) for place, _, course in (effect.partition(SHAPE) for effect in said)]
    yaws, slides = ({course for place, course in shapes if place == channel} for channel in ("gyro_z", "accel_y"))
    names = {*_NAMELESS, *parts_of(drive, fit, said)}
    # What the steering does by the speed is no number that is the same at all of them.
    if any(map(steers_by_speed, said)):
        names |= {"steering_ratio"}
    # Nor has what a sensor shows to one side, or as it warms up, a scale beside it.
    names |= {f"{place.partition('_')[0]}_scale" for place, course in shapes if is_uneven(course)}
    # And what holds a car back in bends, beside an axle whose wheels turn alike, is these wheels'.
    if "locked_axle" in sure and is_told(drive, fit, "locked_axle"):
        names |= {*TURNS}
    # What the yaw rate and the lateral acceleration show alike, each by itself, a car does.
    if yaws & slides:
        names |= {*TURNS, *GRIP}
    # And where it still turns by its steering and its tyres as none of these has it, none of these it is.
    if any(part in course and "ax" not in course for course in yaws for part in _OF_A_TURN):
        names |= {*TURNS, *GRIP, "steering_backlash"}
    # A bank that no roll gyro feels is what these two show: it is none where either shows something else.
    if is_unfelt(drive) and (yaws or slides):
        names |= {"road_bank"}
    return names
