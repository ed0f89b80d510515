"""Journeys: road and speeds fit together, the driver keeps to the lane, and each scenario is what it says."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from dsz_daemon.sim.catalogue import SCENARIOS
from dsz_daemon.sim.drive import Columns, drive
from dsz_daemon.sim.journey import EASED_OVER_M, Leg, programme_along, road_along
from dsz_daemon.sim.road import road_bend_per_m, road_point
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling

JOURNEYS = sorted(SCENARIOS.keys() - {"sine_steer", "bank_and_incline"})


@cache
def driven(name: str) -> Columns:
    scenario = SCENARIOS[name]
    start = rolling(scenario.car, scenario.start_mps)
    return drive(TwoTrackCar(scenario.car, scenario.road), scenario.programme, start=start)


def test_a_leg_has_its_length_its_speed_and_its_stop() -> None:
    legs = [Leg(200.0, 10.0, stop_s=7.0), Leg(300.0, 15.0, 0.01, 0.05, -0.02)]
    programme = programme_along(legs, stand_s=3.0)
    t = np.arange(0.0, programme.duration_s, 0.001)
    speed, _ = programme.wanted(t)
    way = np.cumsum(speed) * 0.001
    assert way[-1] == pytest.approx(500.0, abs=0.1)
    assert speed.max() == pytest.approx(15.0)
    standing = speed < 1e-9
    assert standing[t < 3.0].all()
    # In the middle it stands for 7 s, 200 m from the start.
    middle = standing & (way > 100.0) & (way < 400.0)
    assert np.count_nonzero(middle) * 0.001 == pytest.approx(7.0, abs=0.05)
    assert way[middle] == pytest.approx(200.0, abs=0.05)
    road = road_along(legs)
    before, after = 200.0 - 0.51 * EASED_OVER_M, 200.0 + 0.51 * EASED_OVER_M
    assert road_point(road, before) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-9)
    assert road_point(road, after) == pytest.approx((-0.02, 0.05, 0.0, 0.0), abs=1e-9)
    assert road_bend_per_m(road, after) == pytest.approx(0.01)


def test_a_short_leg_is_there_in_full_in_its_middle() -> None:
    """Easing takes no more than half of either leg."""
    road = road_along([Leg(200.0, 10.0), Leg(20.0, 10.0, 0.01, 0.05, -0.02), Leg(200.0, 10.0)])
    assert road_point(road, 210.0) == pytest.approx((-0.02, 0.05, 0.0, 0.0), abs=1e-9)
    assert road_bend_per_m(road, 210.0) == pytest.approx(0.01)
    for before_or_after in (194.9, 225.1):
        assert road_bend_per_m(road, before_or_after) == pytest.approx(0.0, abs=1e-12)


def test_a_leg_too_short_for_its_changes_is_refused() -> None:
    with pytest.raises(ValueError, match="leg 1: 20 m are too short"):
        programme_along([Leg(200.0, 15.0), Leg(20.0, 5.0), Leg(100.0, 5.0)])


@pytest.mark.parametrize("name", JOURNEYS)
def test_the_driver_stays_in_the_lane_at_the_wanted_speed_and_stops(name: str) -> None:
    columns, scenario = driven(name), SCENARIOS[name]
    assert all(np.isfinite(column).all() for column in columns.values())
    assert np.abs(columns["off_middle_m"]).max() < 1.0
    wanted, _ = scenario.programme.wanted(columns["time_s"])
    assert np.abs(columns["speed_mps"] - wanted).max() < 0.7
    assert columns["speed_mps"][-1] == pytest.approx(0.0, abs=0.01)
    # The road's table goes on to the end of the way.
    assert columns["distance_m"][-1] < (len(scenario.road.tilt) - 1) * scenario.road.step_m


def moving(columns: Columns) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return columns["speed_mps"] > 1.0


def test_scenarios_are_what_they_say() -> None:
    helix = driven("car_park")
    down = (helix["road_grade_up_rad"] < -0.099) & moving(helix)
    assert np.count_nonzero(down) * 0.002 > 60.0
    assert helix["gyro_z_radps"][down].mean() == pytest.approx(3.0 / 9.0, rel=0.05)
    assert abs(helix["gyro_x_radps"][down].mean()) > 0.02
    assert driven("off_ramp")["speed_mps"][:90_000].min() > 8.0
    assert np.all(driven("constant_bank")["road_bank_rad"] == pytest.approx(math.radians(2.0)))
    parked = driven("parking_slope")
    waiting = parked["time_s"] < 60.0
    assert parked["speed_mps"][waiting][1000:] == pytest.approx(0.0, abs=1e-3)
    assert parked["accel_x_mps2"][waiting][-1] == pytest.approx(9.80665 * math.sin(0.12), rel=0.1)
    mountain = driven("mountain")
    assert np.ptp(np.cumsum(mountain["speed_mps"] * np.sin(mountain["road_grade_up_rad"])) * 0.002) > 100.0
    assert driven("highway")["speed_mps"].max() > 34.0
    assert np.count_nonzero(driven("city")["speed_mps"] < 0.01) * 0.002 > 40.0
    assert np.abs(driven("roundabouts")["accel_y_mps2"]).max() > 2.0
    straight = moving(driven("crowned_road")) & (np.abs(driven("crowned_road")["gyro_z_radps"]) < 0.005)
    assert np.median(driven("crowned_road")["road_bank_rad"][straight]) == pytest.approx(0.025, abs=1e-3)
    ground = driven("handling")
    first = ground["time_s"] < 150.0
    assert 5.0 < np.abs(ground["accel_y_mps2"][first]).max() < 7.0
    assert ground["accel_x_mps2"][first].min() < -3.5
    snow = driven("snow")
    assert np.all(snow["friction"] == pytest.approx(0.3))
    assert 1.4 < np.hypot(snow["accel_x_mps2"], snow["accel_y_mps2"]).max() < 0.3 * 9.80665 * 1.2
