"""What has no name is called by where it enters and its course: `gyro_z: k*vx^2`, `steering: k*ay*|ay|`."""

from __future__ import annotations

from collections.abc import Collection

SHAPE, STEERING = ": k*", "steering"
# What a turn of the front wheels shows in.
_SHOWN_BY_STEERING = {"gyro_z", "accel_y"}


def is_shape(effect: str) -> bool:
    """Whether an effect of a search is one without a name."""
    return SHAPE in effect


def with_shapes(effects: Collection[str]) -> set[str]:
    """The channels of which something without a name is in the model."""
    places = {effect.partition(SHAPE)[0] for effect in effects if is_shape(effect)}
    return (places - {STEERING}) | (_SHOWN_BY_STEERING if STEERING in places else set())
