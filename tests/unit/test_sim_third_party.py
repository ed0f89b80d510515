"""The simulated car and CommonRoad's multi-body car, on the same manoeuvres with the same parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest

commonroad_car = pytest.importorskip("commonroad_car", reason="commonroad-vehicle-models is not installed (extra: dev)")


@cache
def found(number: int, stiffer: float = 1.0) -> dict[str, tuple[float, float]]:
    result: dict[str, tuple[float, float]] = commonroad_car.compared(commonroad_car.MANOEUVRES[number], stiffer)
    return result


@pytest.mark.parametrize("number", [1, 3, 4, 5])
def test_yaw_rates_agree(number: int) -> None:
    assert found(number)["yaw_rate"][0] > 0.05
    assert found(number)["yaw_rate"][1] < 0.05


@pytest.mark.parametrize("number", [4, 5])
def test_in_a_turn_that_lasts_lateral_acceleration_and_roll_agree(number: int) -> None:
    assert found(number)["ay"][0] > 2.0
    assert found(number)["ay"][1] < 0.05
    assert found(number)["roll"][1] < 0.07


@pytest.mark.parametrize("number", [1, 3])
def test_most_of_what_is_left_in_a_swerve_comes_with_roll(number: int) -> None:
    """Theirs takes the tyres' slip from the sprung mass's C.G., ours from the road: they part by the roll's speed."""
    assert found(number, 30.0)["ay"][1] < 0.5 * found(number)["ay"][1]


def test_another_stiffness_would_be_seen() -> None:
    manoeuvre = commonroad_car.MANOEUVRES[5]
    p = commonroad_car.parameters_vehicle2()
    car = commonroad_car.like(p)
    softer = replace(car, front_cornering_stiffness_n_per_rad=0.85 * car.front_cornering_stiffness_n_per_rad)
    theirs, ours = commonroad_car.theirs(p, manoeuvre), commonroad_car.ours(softer, manoeuvre)
    apart = float(abs(theirs["yaw_rate"][-1] - ours["yaw_rate"][-1]))
    assert apart / abs(theirs["yaw_rate"][-1]) > 0.05
    assert math.isfinite(apart)
