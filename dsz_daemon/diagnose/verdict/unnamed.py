"""Names of the model that are not said, for something without a name, which is said, explains what they do."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations

import numpy as np

from dsz_daemon.diagnose.effects.nameless import NAMELESS
from dsz_daemon.diagnose.effects.shape_names import (
    MOMENT,
    REAR,
    SHAPE,
    STEERING,
    TYRES,
    is_of_the_car,
    is_shape,
    steers_by_speed,
)
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.model import GRIP, SAME_TURN, Fit
from dsz_daemon.diagnose.fitting.mounts import MOUNT
from dsz_daemon.diagnose.selection.plausible import are_apart, is_told
from dsz_daemon.diagnose.selection.trials import TURNS
from dsz_daemon.diagnose.shapes.eccentric import parts_of
from dsz_daemon.diagnose.shapes.uneven_scales import is_uneven, sticks
from dsz_daemon.diagnose.shapes.unlisted import wheel_squares, wheels_follow
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.simulation.motion import G
from dsz_daemon.diagnose.surroundings.unfelt_banks import is_unfelt
from dsz_daemon.signals import IMU_CHANNELS, WHEELS

_NAMELESS = frozenset(effect.name for effect in NAMELESS)
# In the course of what a yaw gyro shows: the car's steering, sideslip and tyres, and not the gyro's own rate alone.
# Drive and brakes turn a car besides.
_OF_A_TURN = ("delta", "ay", "vy", "r'")

_PULLED, _FROM_THEN_ON = ("accel_x", "accel_y"), "(t > "
# Bodies that lean or dive, the scale of the accelerometer that is pulled, and the gyro that would feel it.
_ONE_WITHOUT_A_GYRO = (
    ("suspension_roll.roll_gradient_rad_per_mps2", "accel_scale.y", 0),
    ("suspension_pitch.pitch_gradient_rad_per_mps2", "accel_scale.x", 1),
)
_APART_SPREADS = 4.0
# So much of a scale may a lean leave that undoes it.
_UNDONE = 0.25
_SWINGS = {effect: INDEX[f"{effect}.frequency_share"] for effect in ("suspension_roll", "suspension_pitch")}
# Over 1.5 Hz; the end of what a body does is 1.
_FASTEST = 0.95
_RESISTANCE = INDEX["wheel_slip.resistance"]
_SIDES = tuple(tuple(INDEX[f"wheel_radius.{axle}{side}"] for side in "lr") for axle in "fr")
# A wheel whose speed is so many times as rough as the smoothest one's has teeth that are not alike: rings that are as
# good as each other differ by half, and one of which 3 % go round was 50 times as rough.
_ROUGHER, _WHEELS = 5.0, slice(6, 10)
# Nor are those of one that is so many times as rough as the others, where these are alike: twice as far as they differ.
_THAN_OTHERS, _PAIR = 1.5, 2


def not_named(drive: Drive, fit: Fit, sure: Collection[str]) -> set[str]:
    """The effects of a fit that are given no name.

    What a car does without a name is said where it is `sure`: what is not said is no ground (decision 0054). A sensor's
    own shape is said always.
    """
    said = [e for e in fit.effects if is_shape(e) and (e in sure or not is_of_the_car(e))]
    shapes = [(place, course) for place, _, course in (effect.partition(SHAPE) for effect in said)]
    yaws, slides = ({course for place, course in shapes if place == channel} for channel in ("gyro_z", "accel_y"))
    names = {*_NAMELESS, *parts_of(drive, fit, said)}
    # What the steering does by the speed is no number that is the same at all of them, and has a course of its own, of
    # which tyres or a load take the rest.
    if any(map(steers_by_speed, said)):
        names |= {"steering_ratio", *SAME_TURN}
    # Nor has what a sensor shows to one side, or as it warms up, or not near nothing, a scale beside it.
    uneven = (place for place, course in shapes if is_uneven(course) or sticks(course, place))
    names |= {f"{place.partition('_')[0]}_scale" for place in uneven}
    # Where a gyro shows nothing of a small turn, the force that comes with one is no more than that.
    names |= (
        {"gyro_g_sensitivity"}
        if any(sticks(course, "gyro_z") for place, course in shapes if place == "gyro_z")
        else set()
    )
    # And what holds a car back in bends, beside an axle whose wheels turn alike, is these wheels'.
    if "locked_axle" in sure and is_told(drive, fit, "locked_axle"):
        names |= {*TURNS}
    # Tyres that change have no stiffness that is theirs, nor are there two ways to turn beside one without a name.
    of_car = {effect.partition(SHAPE)[0] for effect in said if is_of_the_car(effect)}
    names |= SAME_TURN if TYRES in of_car else set()
    if of_car and len(set(TURNS) & set(fit.effects) & set(sure) - names) > 1:
        names |= {*TURNS}
    # Nor have those a stiffness whose forces are another yaw moment at another speed.
    if any(one.startswith(f"{MOMENT}{SHAPE}") and "ay" in one for one in said):
        names |= SAME_TURN
    # Without its gyro a lean and a scale are one: two that undo each other are none. Nor are they beside what the gyro
    # shows by itself, of which they are a part.
    for tilt, scale, gyro in _ONE_WITHOUT_A_GYRO:
        effects = {tilt.partition(".")[0], "accel_scale"}
        if not effects <= set(fit.effects):
            continue
        if np.isnan(drive.measured[:, gyro]).all():
            pair = [INDEX[tilt], INDEX[scale]]
            spreads = [abs(fit.x[i]) / fit.std[fit.columns.index(i)] for i in pair if i in fit.columns]
            names |= effects if max(spreads, default=0.0) < _APART_SPREADS else set()
        elif any(place == IMU_CHANNELS[gyro] for place, _ in shapes):
            more, less = G * fit.x[INDEX[tilt]], fit.x[INDEX[scale]]
            names |= effects if abs(more + less) < _UNDONE * abs(less) else set()
    # Nor is a mount turned all the way where gravity comes in from some moment on: who got in, or a mount that slips.
    if any(place in _PULLED and course.startswith(_FROM_THEN_ON) for place, course in shapes):
        names |= {MOUNT}
    # A body that swings as fast as any may, beside an IMU that swings on its mount, is that mount.
    if "soft_mount" in fit.effects:
        names |= {effect for effect, share in _SWINGS.items() if fit.x[share] > _FASTEST}
    # Nor are wheels late by a time that follow smoothly.
    names |= {"wheel_speed_delay"} if wheels_follow(drive, fit) else set()
    # Of wheels that slip, what they do at a steady speed is their radii's as well: neither is told at resistance's end.
    # What a wheel with uneven teeth is off by is theirs, and what one that grows with the speed is off by, its growth.
    if _rolls_otherwise(drive, fit) or _counts_unevenly(drive, fit) or _grows(drive, fit):
        names |= {"wheel_radius"}
    # What the yaw rate and the lateral acceleration show alike, each by itself, a car does.
    if yaws & slides:
        names |= {*TURNS, *GRIP, "steering_offset"}
    # And where it still turns by its steering and its tyres as none of these has it, none of these it is.
    if any(part in course and "ax" not in course for course in yaws for part in _OF_A_TURN):
        names |= {*TURNS, *GRIP, "steering_backlash"}
    # Nor is a zero told where what is steered is another angle than is read.
    steered = yaws | {course for place, course in shapes if place in {STEERING, REAR}}
    if any("delta" in course and "'" not in course for course in steered):
        names |= {"steering_offset"}
    # A bank that no roll gyro feels is what these two show: it is none where either shows something else.
    if is_unfelt(drive) and (yaws or slides):
        names |= {"road_bank"}
    return names


def _counts_unevenly(drive: Drive, fit: Fit) -> bool:
    """Whether radii differ by wheels alone whose speed is rough: one tooth less of a ring is a larger wheel, too."""
    if "wheel_radius" not in fit.effects:
        return False
    rough = np.nan_to_num(drive.recording.floor[_WHEELS])
    # A wheel that says nothing is no measure of the others.
    told = np.sort(rough[rough > 0.0])
    if len(told) < _PAIR:
        return False
    least = min(_ROUGHER * told[0], _THAN_OTHERS * told[-2] ** 2 / told[0])
    even = [i for i, one in zip(sum(_SIDES, ()), rough, strict=True) if one <= least]
    return len(even) < len(rough) and not any(are_apart(drive, fit, *pair) for pair in combinations(even, 2))


def _grows(drive: Drive, fit: Fit) -> bool:
    """Whether radii differ by wheels alone that show the square of their speed: of such a course it is a part."""
    return differ_by(drive, fit, wheel_squares(drive, fit))


def differ_by(drive: Drive, fit: Fit, wheels: Collection[str]) -> bool:
    """Whether radii differ by these wheels (`fl`, ...) alone, which are said to be off by something else."""
    if "wheel_radius" not in fit.effects or not wheels:
        return False
    others = [i for wheel, i in zip(WHEELS, sum(_SIDES, ()), strict=True) if wheel not in wheels]
    return not any(are_apart(drive, fit, *pair) for pair in combinations(others, 2))


def _rolls_otherwise(drive: Drive, fit: Fit) -> bool:
    """Whether beside a slip whose resistance stands at an end radii differ from axle to axle alone."""
    if "wheel_slip" not in fit.effects or "wheel_radius" not in fit.effects:
        return False
    resistance = drive.vocabulary.columns[_RESISTANCE][1]
    if resistance.low < fit.x[_RESISTANCE] < resistance.high:
        return False
    return not any(are_apart(drive, fit, *pair) for pair in _SIDES)
