"""What has no name is called by where it enters and its course: `gyro_z: k*vx^2`, `steering: k*ay*|ay|`."""

from __future__ import annotations

from collections.abc import Collection

SHAPE, STEERING, REAR, MOMENT, TYRES = ": k*", "steering", "rear steering", "yaw moment", "tyres"
# What is left of a channel, of which nothing better can be said.
NO_SHAPE = "k rms, of no known shape"
# Where what a car does may enter, and what that shows in.
_OF_THE_CAR, _SHOWN_BY_IT = frozenset({STEERING, REAR, MOMENT, TYRES}), {"gyro_z", "accel_y"}


def is_shape(effect: str) -> bool:
    """Whether an effect of a search is one without a name."""
    return SHAPE in effect


def with_shapes(effects: Collection[str]) -> set[str]:
    """The channels of which something without a name is in the model."""
    places = {effect.partition(SHAPE)[0] for effect in effects if is_shape(effect)}
    return (places - _OF_THE_CAR) | (_SHOWN_BY_IT if places & _OF_THE_CAR else set())


def is_of_the_car(effect: str) -> bool:
    """Whether it is one without a name that a car does, and no sensor."""
    return is_shape(effect) and effect.partition(SHAPE)[0] in _OF_THE_CAR


def steers_by_speed(effect: str) -> bool:
    """Whether it is one by which wheels turn with the steering, more or less by the speed."""
    return is_of_the_car(effect) and effect.partition(SHAPE)[2].endswith("*delta")
