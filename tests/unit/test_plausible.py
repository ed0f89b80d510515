"""diagnose: what an effect can't be is judged by what the drive tells of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.simulation.drive import nothing

# A cross axis is at most 0.2, a scale error 0.25.
CROSS = ("xy", "xz", "yx", "yz", "zx", "zy")


def judged(effect: str, values: dict[str, float], stds: dict[str, float]) -> bool:
    """Of an effect whose parameters are these, and 0 with a spread of 0.01 else."""
    columns = BUILT_IN.columns_of(effect)
    x, std = nothing(), np.full(len(columns), 0.01)
    for name, value in values.items():
        x[INDEX[f"{effect}.{name}"]] = value
    for name, value in stds.items():
        std[columns.index(INDEX[f"{effect}.{name}"])] = value
    drive: Any = SimpleNamespace(vocabulary=BUILT_IN)
    fit: Any = SimpleNamespace(x=x, std=std, columns=columns, effects=(effect,))
    rows: Any = None
    return is_implausible(drive, rows, fit, effect)


@pytest.mark.parametrize("end", [-0.2, 0.2])
def test_a_parameter_that_is_told_to_be_at_its_end_is_implausible(end: float) -> None:
    assert judged("accel_cross_axis", {"xz": end, "xy": 0.03}, {"xz": 0.09})
    assert not judged("accel_cross_axis", {"xz": 0.99 * end, "xy": 0.03}, {"xz": 0.09})


def test_one_that_is_hardly_told_may_stand_at_its_end_beside_one_that_is() -> None:
    assert not judged("accel_cross_axis", {"xz": -0.2, "xy": 0.03}, {"xz": 0.11})
    assert judged("accel_cross_axis", {"xz": -0.2, "xy": 0.03}, {"xz": 0.11, "xy": 0.016})
    assert judged("accel_cross_axis", {"xz": -0.2}, {"xz": 0.11})


def test_nothing_is_no_end_and_what_only_shapes_an_effect_may_have_any() -> None:
    assert not judged("suspension_roll", {"roll_gradient_rad_per_mps2": 0.0}, {})
    body = next(p for p in BUILT_IN.described("wheel_slip").parameters if p.name == "front_brakes_more")
    assert not judged("wheel_slip", {"slip_per_force": 0.05, "front_brakes_more": body.high}, {})
    assert judged("wheel_slip", {"slip_per_force": 0.5}, {})
