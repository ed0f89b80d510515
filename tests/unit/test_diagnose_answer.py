"""What is said of a search: verdict, probabilities, aliases, and the numbers as the contract has them."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX
from dsz_daemon.diagnose.fitting.gains import told_from
from dsz_daemon.diagnose.selection.trials import Step
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict import aliases, causes, configured, level, numbers, told_roads
from dsz_daemon.diagnose.verdict.said import Value

# A model without effects.
NOTHING = SimpleNamespace(effects=())


def found(rivals: dict[str, dict[str, float]], effects: tuple[str, ...]) -> Any:
    """A search that has tried these effects with these gains."""
    steps = {name: tuple(Step(n, g, SimpleNamespace()) for n, g in tried.items()) for name, tried in rivals.items()}
    drive = SimpleNamespace(measured=np.zeros((2, 13)))
    return SimpleNamespace(rivals=steps, best=SimpleNamespace(effects=effects, x=nothing()), drive=drive)


@pytest.mark.parametrize(
    ("explained", "left", "verdict"),
    [
        (False, False, "consistent"),
        (True, False, "explained"),
        (True, True, "partly_explained"),
        (False, True, "unexplained"),
    ],
)
def test_the_verdict_comes_from_causes_and_from_what_is_left(explained: bool, left: bool, verdict: str) -> None:
    assert level.verdict(explained, left) == verdict


def test_what_comes_near_is_in_the_group_and_what_does_not_shares_the_odds() -> None:
    tried = {"imu_delay": 40.0, "sensor_bandwidth": 38.0, "tyre_relaxation": 36.0, "gyro_scale": -5.0}
    group, others = aliases.alternatives(found({"imu_delay": tried}, ("imu_delay",)), "imu_delay")
    assert group == ["sensor_bandwidth"]
    total = 1.0 + math.exp(-2.0) + math.exp(-4.0)
    odds = {str(one["effect"]): one["probability"] for one in others}
    assert odds == {
        "sensor_bandwidth": pytest.approx(math.exp(-2.0) / total),
        "tyre_relaxation": pytest.approx(math.exp(-4.0) / total),
    }


def test_what_has_no_name_is_no_name_that_a_cause_can_not_be_told_from() -> None:
    """It has its odds: a cause that a shape would explain as well is none as likely as not."""
    tried = {"gyro_g_sensitivity": 212.8, "accel_x: k*ay*|ay|": 212.8}
    group, others = aliases.alternatives(
        found({"gyro_g_sensitivity": tried}, ("gyro_g_sensitivity",)), "gyro_g_sensitivity"
    )
    assert group == []
    assert others == [{"effect": "accel_x: k*ay*|ay|", "probability": pytest.approx(0.5)}]


def test_of_a_large_gain_a_share_is_near() -> None:
    tried = {"imu_delay": 1000.0, "sensor_bandwidth": 985.0}
    assert aliases.alternatives(found({"imu_delay": tried}, ("imu_delay",)), "imu_delay")[0] == ["sensor_bandwidth"]


def test_where_the_simulation_is_in_doubt_a_gain_says_so_much_less() -> None:
    tried = {"imu_delay": 1000.0, "sensor_bandwidth": 976.0, "tyre_relaxation": 940.0}
    search = found({"imu_delay": tried}, ("imu_delay",))
    group, others = aliases.alternatives(search, "imu_delay", 12.0)
    total = 1.0 + math.exp(-2.0) + math.exp(-5.0)
    assert group == ["sensor_bandwidth"]
    assert others[0]["probability"] == pytest.approx(math.exp(-2.0) / total)
    # Three nats, in doubt as many times more.
    tried = {"imu_delay": 100.0, "sensor_bandwidth": 95.0}
    search = found({"imu_delay": tried}, ("imu_delay",))
    assert aliases.alternatives(search, "imu_delay", 1.5)[0] == []
    assert aliases.alternatives(search, "imu_delay", 1.8)[0] == ["sensor_bandwidth"]


def test_what_was_not_taken_is_no_likelier_than_what_was() -> None:
    tried = {"imu_delay": 40.0, "sensor_bandwidth": 90.0}
    group, others = aliases.alternatives(found({"imu_delay": tried}, ("imu_delay",)), "imu_delay")
    assert group == ["sensor_bandwidth"]
    assert others == [{"effect": "sensor_bandwidth", "probability": pytest.approx(0.5)}]


def test_what_is_in_the_model_is_no_alternative() -> None:
    tried = {"imu_delay": 40.0, "gyro_scale": 39.0}
    assert aliases.alternatives(found({"imu_delay": tried}, ("imu_delay", "gyro_scale")), "imu_delay") == ([], [])


@pytest.mark.parametrize("effect", sorted(aliases.SAME_TURN))
def test_what_turns_the_car_alike_names_each_other(effect: str) -> None:
    group, _ = aliases.alternatives(found({effect: {effect: 100.0}}, (effect,)), effect)
    assert set(group) == {"mass_loading", "cornering_stiffness", "steering_compliance"} - {effect}


def test_friction_is_told_of_its_inverse_square() -> None:
    told, units = numbers.as_told("tyre_saturation", {"inverse_square": (4.0, 0.4)}, {})
    assert told == {"friction_coefficient": (pytest.approx(0.5), pytest.approx(0.025))}
    assert units["friction_coefficient"] == "1"


def test_a_bandwidth_is_told_in_hertz_too() -> None:
    told, _ = numbers.as_told("sensor_bandwidth", {"time_constant_s": (1.0 / (2.0 * math.pi * 5.0), 0.001)}, {})
    assert told["cutoff_hz"][0] == pytest.approx(5.0)


def test_ratios_are_told_as_true_over_configured() -> None:
    told, _ = numbers.as_told("steering_ratio", {"scale": (0.05, 0.01), "per_rad": (0.02, 0.01)}, {})
    assert told == {"scale": (pytest.approx(1.05), 0.01), "per_rad": (0.02, 0.01)}


def test_stiffnesses_are_told_where_they_are_off_by_more_than_their_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = {
        "front_cornering_stiffness_n_per_rad": (-0.08, 0.01),
        "rear_cornering_stiffness_n_per_rad": (0.06, 0.03),
        "mass_kg": (0.02, 0.003),
    }
    monkeypatch.setattr(configured.searching, "tolerance_gain", lambda *_: 100.0)
    monkeypatch.setattr(configured, "values_of", lambda *_: shares)
    car = SimpleNamespace(
        front_cornering_stiffness_n_per_rad=50_000.0, rear_cornering_stiffness_n_per_rad=60_000.0, mass_kg=1500.0
    )
    drive = SimpleNamespace(car=car, steering_ratio=16.0)
    search: Any = SimpleNamespace(drive=drive, best=SimpleNamespace(effects=()), gains={})
    error, mass = configured.parameter_errors(search, map)
    assert mass[:3] == ("mass_kg", 1500.0, pytest.approx(1530.0))
    assert error.parameter == "front_cornering_stiffness_n_per_rad"
    assert (error.configured, error.fitted, error.std) == pytest.approx((50_000.0, 46_000.0, 500.0))


def test_the_level_is_what_is_left_over_noise_and_coarseness(monkeypatch: pytest.MonkeyPatch) -> None:
    counts, left = np.zeros((2, 13)), np.zeros((2, 13))
    counts[:, 3], left[:, 3] = 50.0, 200.0  # twice the scatter of 0.1: 0.2
    monkeypatch.setattr(level, "noises", lambda _: np.full(13, 0.03))
    fit = SimpleNamespace(
        sums=SimpleNamespace(counts=counts, left=left), scatter=np.full((2, 13), 0.1), form=np.full(13, 0.04)
    )
    search: Any = SimpleNamespace(best=fit, drive=SimpleNamespace(front_gives_speed=False))
    assert level.level_of(search) == {"accel_x": pytest.approx(0.2 / 0.05)}


def test_a_turned_mount_is_the_same_as_an_offset() -> None:
    """reading_x = fx - pitch fz: 3.75 deg of pitch at rest read -g sin 3.75 deg."""
    x, y = aliases.same_as_offsets({"offset_accel_x": -0.6414, "offset_accel_y": 0.5, "offset_accel_z": 2.0})
    assert (x.effect, x.parameter) == ("imu_misalignment", "pitch_rad")
    assert math.degrees(x.value_rad) == pytest.approx(3.75, abs=0.01)
    assert (y.parameter, y.value_rad) == ("roll_rad", pytest.approx(0.5 / 9.80665))
    assert "+3.75 deg of pitch" in x.statement
    assert "-3.75 deg: on one drive" in x.statement
    assert aliases.same_as_offsets({"offset_accel_x": 0.2, "offset_accel_y": -0.2}) == []


def test_moments_are_told_on_the_clock_with_pauses_in_it() -> None:
    """Two recordings of 10 s with an hour between: 15 s of what was recorded are 5 s into the second."""
    time_s = np.concatenate([0.01 * np.arange(1000), 3600.0 + 0.01 * np.arange(1000)])
    search: Any = SimpleNamespace(drive=SimpleNamespace(recording=SimpleNamespace(time_s=time_s)))
    told = numbers.on_the_clock(search, {"start_s": (4.0, 0.1), "end_s": (15.0, 0.2), "delay_s": (15.0, None)})
    assert told == {"start_s": (4.0, 0.1), "end_s": (pytest.approx(3605.0), 0.2), "delay_s": (15.0, None)}


def test_a_road_that_climbs_evenly_is_told_as_an_offset(monkeypatch: pytest.MonkeyPatch) -> None:
    """reading_x = a_x + g grade: what is the same all the way is taken off the road and put onto the offset."""
    waves = 0.01 * np.sin(2.0 * np.pi * np.arange(1000) / 250.0)
    road = flat(1000)._replace(grade_rad=0.05 + waves, bank_rad=-0.02 + waves)
    best: Any = SimpleNamespace(road=road, x=nothing(), effects=("road_grade",))
    search: Any = SimpleNamespace(best=best, drive=None)
    untold = {"road_bank", "road_grade"}
    monkeypatch.setattr(told_roads, "_untold_evenly", lambda *_: untold)
    by_the_turn: int | None = None
    monkeypatch.setattr(told_roads, "evenly_by", lambda *_: by_the_turn)
    offsets = {"offset_accel_x": (0.1, 0.01), "offset_accel_y": (0.2, 0.01), "mass_kg": (0.0, 0.0)}
    monkeypatch.setattr(numbers, "values_of", lambda *_: offsets)
    told = numbers.offsets_of(search)
    assert told["offset_accel_x"] == (pytest.approx(0.1 + 9.80665 * 0.05, abs=1e-4), 0.01)
    assert told["offset_accel_y"] == (pytest.approx(0.2 - 9.80665 * 0.02, abs=1e-4), 0.01)
    grade = ["road_grade"]
    np.testing.assert_allclose(told_roads.told_road(search.drive, best, ["road_grade"])[0].grade_rad, waves, atol=1e-5)
    assert numbers.offsets_of(search, grade) == told
    # But for what is told of it, if it is said that there is one.
    untold = {"road_bank"}
    np.testing.assert_array_equal(told_roads.told_road(search.drive, best, ["road_grade"])[0].grade_rad, road.grade_rad)
    np.testing.assert_allclose(told_roads.told_road(search.drive, best, [])[0].grade_rad, waves, atol=1e-5)
    assert numbers.offsets_of(search, grade)["offset_accel_x"] == (0.1, 0.01)
    assert numbers.offsets_of(search, grade)["offset_accel_y"] == told["offset_accel_y"]
    assert numbers.offsets_of(search) == told
    # What the roll gyro alone shows of it is in no accelerometer's offset yet.
    by_the_turn = INDEX["gyro_cross_axis.xz"]
    best.x[by_the_turn] = 0.02
    climbs = told_roads.told_road(search.drive, best, ["road_grade"])[0].grade_rad
    np.testing.assert_allclose(climbs, road.grade_rad + 0.02)
    assert numbers.offsets_of(search, grade)["offset_accel_x"] == (pytest.approx(0.1 - 9.80665 * 0.02), 0.01)
    assert numbers.offsets_of(search) == told
    # Unless it is said to leak.
    best.effects = ("road_grade", "gyro_cross_axis")
    np.testing.assert_allclose(told_roads.told_road(search.drive, best, ["road_grade"])[0].grade_rad, road.grade_rad)
    by_the_turn = None
    untold = {"road_bank", "road_grade"}
    # So is a turned mount that is in the model and gains too little to be a cause: reading_x = fx - pitch g.
    best.effects = ("road_grade", "imu_misalignment")
    best.x[[INDEX["imu_misalignment.roll_rad"], INDEX["imu_misalignment.pitch_rad"]]] = 0.03, 0.04
    told = numbers.offsets_of(search)
    assert told["offset_accel_x"][0] == pytest.approx(0.1 + 9.80665 * (0.05 - 0.04), abs=1e-4)
    assert told["offset_accel_y"][0] == pytest.approx(0.2 + 9.80665 * (-0.02 + 0.03), abs=1e-4)
    named = ["imu_misalignment"]
    assert numbers.offsets_of(search, named)["offset_accel_x"][0] == pytest.approx(0.1 + 9.80665 * 0.05, abs=1e-4)


@pytest.mark.parametrize(
    ("gain", "std", "is_named"),
    [(30.0, 0.004, True), (30.0, 0.02, False), (300.0, 0.02, True), (300.0, 0.07, False), (19.0, 0.004, False)],
)
def test_a_small_gain_of_numbers_that_may_be_nothing_has_no_name(
    monkeypatch: pytest.MonkeyPatch, gain: float, std: float, is_named: bool
) -> None:
    values = {axis: (0.03 if axis == "z" else 0.0, std) for axis in "xyz"}
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: values)
    monkeypatch.setattr(causes, "on_the_clock", lambda _, there: there)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN),
        best=NOTHING,
        gains={"gyro_scale": gain},
        elsewhere={"gyro_scale": {}},
    )
    cause = causes.cause_of(search, "gyro_scale")
    assert (cause is not None) is is_named
    if cause is not None:
        # Of four causes that gain 30, three are true; of many that gain 300, all but one in 31.
        assert cause.probability == pytest.approx(0.75 if gain == 30.0 else 30.0 / 31.0)


@pytest.mark.parametrize(
    ("effect", "beside", "std", "is_named"),
    [
        # A ratio of -0.05 +- 0.06 is none beside what a car did without a name, whatever it gained before that came.
        ("steering_ratio", "steering: k*vx*vy", 0.06, False),
        ("steering_ratio", "steering: k*vx*vy", 0.02, True),
        ("steering_ratio", "gyro_z: k*vx^2", 0.06, True),
        ("gyro_scale", "steering: k*vx*vy", 0.06, True),
    ],
)
def test_what_a_shape_of_the_car_may_be_has_a_name_only_where_it_is_told(
    monkeypatch: pytest.MonkeyPatch, effect: str, beside: str, std: float, is_named: bool
) -> None:
    name = "scale" if effect == "steering_ratio" else "z"
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {name: (-0.05, std)})
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    monkeypatch.setattr(
        causes, "as_told", lambda _, values, units: ({**dict.fromkeys(units, (0.0, None)), **values}, units)
    )
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN),
        best=SimpleNamespace(effects=(effect, beside)),
        gains={effect: 500.0, beside: 200.0},
        elsewhere={effect: {}},
    )
    assert (causes.cause_of(search, effect) is not None) is is_named


@pytest.mark.parametrize(("radii", "is_named"), [((5e-4, -5e-4), True), ((3e-4, -3e-4), False), ((5e-4, 5e-4), False)])
def test_wheels_that_differ_by_what_is_worth_a_name_have_one(
    monkeypatch: pytest.MonkeyPatch, radii: tuple[float, float], is_named: bool
) -> None:
    """None is 0.08 % off by itself: what all of them share may be the scale of something else."""
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    search = radii_of([*radii, radii[1], radii[1]], 1e-10 * np.eye(4))
    search.rows, search.best.effects = None, ("wheel_radius",)
    search.best.std, search.best.told = np.full(4, 1e-5), None
    search.gains, search.elsewhere = {"wheel_radius": 600.0}, {"wheel_radius": {}}
    assert (causes.cause_of(search, "wheel_radius") is not None) is is_named


@pytest.mark.parametrize(("flat_roads", "is_said"), [(0.0, False), (0.5, False), (0.95, True)])
def test_of_a_climb_that_lifts_no_car_it_is_said(
    monkeypatch: pytest.MonkeyPatch, flat_roads: float, is_said: bool
) -> None:
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"rms_rad": (0.02, 0.001)})
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "told_from", lambda *_: 20.0)
    monkeypatch.setattr(causes, "unfelt_roads", lambda _: set())
    x = nothing()
    x[INDEX["flat_roads"]] = flat_roads
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN),
        best=SimpleNamespace(x=x, effects=("road_grade",)),
        gains={"road_grade": 500.0},
        elsewhere={"road_grade": {}},
    )
    cause = causes.cause_of(search, "road_grade")
    assert cause is not None
    assert ("accel_z shows nothing" in cause.statement) is is_said


# Of 62 000 N/rad a tyre 1e-4 rad are 12.4 N; 0.002 rad/(m/s2) at 1 m/s2 half of the time are 175 N, rms.
@pytest.mark.parametrize(
    ("rms_n", "rounding_rad", "pulls", "is_named"),
    [
        (20.0, 0.0, {}, False),
        (30.0, 0.0, {}, True),
        (36.0, 1e-4, {}, False),
        (39.0, 1e-4, {}, True),
        # A quarter of what pulls it aside as it is driven (175 N, rms); it brakes as often.
        (40.0, 0.0, {"drive_steer": 2e-3}, False),
        (48.0, 0.0, {"drive_steer": 2e-3}, True),
        (40.0, 0.0, {"brake_steer": -2e-3}, False),
        (48.0, 0.0, {"brake_steer": -2e-3}, True),
        # To one side as it is driven, to the other as it is braked: twice the power.
        (57.0, 0.0, {"drive_steer": 2e-3, "brake_steer": 2e-3}, False),
        (66.0, 0.0, {"drive_steer": 2e-3, "brake_steer": 2e-3}, True),
        (30.0, None, {}, True),
    ],
)
def test_a_breath_of_air_is_no_wind_nor_is_what_the_steerings_steps_push(
    monkeypatch: pytest.MonkeyPatch, rms_n: float, rounding_rad: float | None, pulls: dict[str, float], is_named: bool
) -> None:
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"rms_n": (rms_n, None)})
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    # It goes faster and slower by 1 m/s2, or stands half of the way, where rounding pushes nothing.
    speed = 10.0 + np.abs(np.mod(np.arange(8000) / 100.0, 8.0) - 4.0)
    speed[4000:] *= 0.0 if rounding_rad else 1.0
    steps = None if rounding_rad is None else np.array([rounding_rad * np.repeat([1.0, 9.0], 4000)])
    drive = SimpleNamespace(
        vocabulary=BUILT_IN,
        car=SimpleNamespace(front_cornering_stiffness_n_per_rad=62000.0),
        wheels=np.repeat(speed[:, np.newaxis], 4, axis=1),
        recording=SimpleNamespace(rounding_rad=steps),
    )
    x = nothing()
    for name, value in pulls.items():
        x[INDEX[name]] = value
    best = SimpleNamespace(**vars(NOTHING), x=x)
    search: Any = SimpleNamespace(drive=drive, best=best, gains={"side_wind": 1000.0}, elsewhere={"side_wind": {}})
    cause = causes.cause_of(search, "side_wind")
    assert (cause is not None) is is_named


def radii_of(radii: list[float], covariance: np.ndarray) -> Any:
    x = nothing()
    columns = BUILT_IN.columns_of("wheel_radius")
    x[list(columns)] = radii
    best = SimpleNamespace(x=x, columns=columns, covariance=covariance)
    return SimpleNamespace(best=best, drive=SimpleNamespace(vocabulary=BUILT_IN))


def test_radii_are_told_against_their_mean_where_their_factor_may_be_anything() -> None:
    """Each is sure to 0.001, all together to 0.05: the mean of four shares of 0.05 and of independent ones."""
    covariance = 0.05**2 * np.ones((4, 4)) + 0.001**2 * np.eye(4)
    search = radii_of([-0.06, -0.06, -0.056, -0.056], covariance)
    assert numbers.shares_a_factor(search)
    told = numbers._apart(search, dict.fromkeys(("fl", "fr", "rl", "rr"), (0.0, None)))
    assert [value for value, _ in told.values()] == pytest.approx([-0.002, -0.002, 0.002, 0.002])
    assert [std for _, std in told.values()] == pytest.approx([math.hypot(0.001 * 0.75**0.5, 0.02 * 0.002)] * 4)
    values = dict.fromkeys(("fl", "fr", "rl", "rr"), (-0.06, 0.05))
    search.rows = search.best.road = None
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(numbers, "values_of", lambda *_, **__: values)
        assert numbers.values_told(search, "wheel_radius")["rl"][0] == pytest.approx(0.002)
    # Sure to 0.001: that the factor is nearly 1 is told then.
    assert not numbers.shares_a_factor(radii_of([0.01, 0.0, -0.01, 0.0], 0.001**2 * np.eye(4)))
    assert not numbers.shares_a_factor(radii_of([-0.06] * 4, 0.02**2 * np.ones((4, 4))))


def test_what_gains_nothing_is_not_told_beside_wrong_tracks(monkeypatch: pytest.MonkeyPatch) -> None:
    stiffness, tracks = (
        {"front_cornering_stiffness_n_per_rad": (-0.08, 0.01)},
        {"front": (0.06, 0.01), "rear": (0.0, 0.01)},
    )
    monkeypatch.setattr(configured, "values_of", lambda _, __, effect: dict(tracks) if effect else dict(stiffness))
    car = SimpleNamespace(front_cornering_stiffness_n_per_rad=50_000.0, front_track_m=1.5, rear_track_m=1.5)
    drive = SimpleNamespace(car=car, steering_ratio=16.0)
    search: Any = SimpleNamespace(
        drive=drive, best=SimpleNamespace(effects=("track_width",)), gains={"track_width": 100.0}
    )
    for gain, expected in ((0.0, ["front_track_m"]), (50.0, ["front_cornering_stiffness_n_per_rad", "front_track_m"])):
        monkeypatch.setattr(configured.searching, "tolerance_gain", lambda *_, gain=gain: gain)
        assert [error.parameter for error in configured.parameter_errors(search, map)] == expected


def test_the_doubt_is_the_usual_level_of_the_channel_that_is_explained_the_least(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One block that is far off is no doubt of the others; one without any row is none at all."""
    scatter, counts = np.full((4, 13), 0.05), np.full((4, 13), 50.0)
    scatter[:, 4] = [0.2, 9.0, 0.45, 0.45]
    scatter[:, 2], counts[0, 2] = [7.0, 0.2, 0.2, 0.6], 0.0
    monkeypatch.setattr(level, "noises", lambda _: np.full(13, 0.03))
    fit = SimpleNamespace(sums=SimpleNamespace(counts=counts), scatter=scatter, form=np.full(13, 0.04))
    search: Any = SimpleNamespace(best=fit, drive=SimpleNamespace(front_gives_speed=False))
    assert level.doubt(search, []) == 1.0
    assert level.doubt(search, ["accel_x"]) == 1.0
    assert level.doubt(search, ["gyro_z"]) == pytest.approx(4.0)
    assert level.doubt(search, ["gyro_z", "accel_y"]) == pytest.approx(9.0)


@pytest.mark.parametrize(("front_gives_speed", "wheel"), [(False, "wheel_speed_fl"), (True, "wheel_speed_rr")])
def test_wheels_that_drive_no_simulation_are_a_doubt_of_wheels_alone(
    monkeypatch: pytest.MonkeyPatch, front_gives_speed: bool, wheel: str
) -> None:
    """The others' difference is one of everything: half of it is in the speed."""
    scatter, counts = np.full((4, 13), 0.05), np.full((4, 13), 50.0)
    scatter[:, 2], scatter[:, 6], scatter[:, 7], scatter[:, 8] = 0.2, 3.0, 3.0, 0.4
    monkeypatch.setattr(level, "noises", lambda _: np.full(13, 0.03))
    monkeypatch.setattr(level, "climbs_unfelt", lambda _: False)
    fit = SimpleNamespace(sums=SimpleNamespace(counts=counts), scatter=scatter, form=np.full(13, 0.04))
    drive = SimpleNamespace(front_gives_speed=front_gives_speed, vocabulary=BUILT_IN)
    search: Any = SimpleNamespace(best=fit, drive=drive)
    difference = "wheel_speed_fr" if front_gives_speed else "wheel_speed_rr"
    for effect in ("imu_delay", "steering_ratio"):
        assert level.doubt_of(search, effect, [wheel]) == 1.0
        assert level.doubt_of(search, effect, [wheel, "gyro_z"]) == pytest.approx(4.0)
        assert level.doubt_of(search, effect, [wheel, difference]) == pytest.approx(8.0)
    assert level.doubt_of(search, "wheel_radius", [wheel]) == pytest.approx(60.0)


@pytest.mark.parametrize(("yaw", "expected"), [(1.4, 4.0), (1.6, 60.0), (None, 60.0)])
def test_what_a_wind_leaves_across_is_no_doubt_of_it_where_the_yaw_rate_is_right(
    monkeypatch: pytest.MonkeyPatch, yaw: float | None, expected: float
) -> None:
    """It is what is quicker than its course is drawn; of all else, and where the car yaws otherwise, it is a doubt."""
    scatter, counts = np.full((4, 13), 0.05), np.full((4, 13), 50.0)
    scatter[:, 4], scatter[:, 3] = 3.0, 0.2
    monkeypatch.setattr(level, "noises", lambda _: np.full(13, 0.03))
    monkeypatch.setattr(level, "climbs_unfelt", lambda _: False)
    monkeypatch.setattr(level, "level_of", lambda _: {} if yaw is None else {"gyro_z": yaw})
    fit = SimpleNamespace(sums=SimpleNamespace(counts=counts), scatter=scatter, form=np.full(13, 0.04))
    search: Any = SimpleNamespace(best=fit, drive=SimpleNamespace(front_gives_speed=False, vocabulary=BUILT_IN))
    assert level.doubt_of(search, "side_wind", ["accel_y", "accel_x"]) == pytest.approx(expected)
    assert level.doubt_of(search, "imu_delay", ["accel_y", "accel_x"]) == pytest.approx(60.0)


@pytest.mark.parametrize("channel", ["gyro_x", "gyro_y", "accel_z"])
def test_how_a_body_shakes_is_no_doubt_of_wheels(monkeypatch: pytest.MonkeyPatch, channel: str) -> None:
    """A phone in its holder rolls, pitches and heaves; what it yaws by, and how it is pushed, is of wheels, too."""
    scatter, counts = np.full((4, 13), 0.05), np.full((4, 13), 50.0)
    scatter[:, [0, 1, 5]], scatter[:, 2] = 0.35, 0.2
    monkeypatch.setattr(level, "noises", lambda _: np.full(13, 0.03))
    monkeypatch.setattr(level, "climbs_unfelt", lambda _: False)
    fit = SimpleNamespace(sums=SimpleNamespace(counts=counts), scatter=scatter, form=np.full(13, 0.04))
    search: Any = SimpleNamespace(best=fit, drive=SimpleNamespace(front_gives_speed=False, vocabulary=BUILT_IN))
    for effect in ("wheel_radius", "wheel_slip", "track_width"):
        assert level.doubt_of(search, effect, [channel]) == 1.0
        assert level.doubt_of(search, effect, [channel, "gyro_z"]) == pytest.approx(4.0)
    assert level.doubt_of(search, "steering_ratio", [channel]) == pytest.approx(7.0)


def test_where_a_channel_is_not_explained_more_has_to_be_gained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"x": (0.1, 0.03), "y": (0.0, 0.03), "z": (0.0, 0.03)})
    doubts: list[float] = []

    def alternatives(_: Any, __: str, doubt: float = 1.0) -> tuple[list[str], list[Any]]:
        doubts.append(doubt)
        return ["gyro_scale"], []

    monkeypatch.setattr(causes, "alternatives", alternatives)
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)

    def told(gain: float, left: float, effect: str = "gyro_scale") -> Any:
        drive = SimpleNamespace(vocabulary=BUILT_IN, measured=np.zeros((2, 13)))
        search: Any = SimpleNamespace(drive=drive, best=NOTHING, gains={effect: gain}, elsewhere={effect: {}})
        return causes.cause_of(search, effect, left)

    assert told(19.0, 1.0) is None
    assert told(21.0, 1.0).parameters["x"] == Value(0.1, 0.03, "1")
    assert told(39.0, 2.0) is None
    # What it is wrong by is in the spreads of the fit already.
    doubts.clear()
    assert told(41.0, 2.0).parameters["x"] == Value(0.1, 0.03, "1")
    # The alternatives are weighed by it.
    assert doubts == [2.0]
    # What has no formula fits nearly anything.
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"rms_rad": (0.02, None)})
    assert told(79.0, 2.0, "road_bank") is None
    assert told(81.0, 2.0, "road_bank") is not None


def test_a_sensors_own_noise_is_explained_up_to_six_times_its_white_part(monkeypatch: pytest.MonkeyPatch) -> None:
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(front_gives_speed=False), rows=None, best=SimpleNamespace(left=np.zeros((5, 13)))
    )
    levels = {"accel_x": 2.9, "accel_y": 4.0, "accel_z": 6.1, "wheel_speed_fl": 4.0, "wheel_speed_fr": 2.9}
    monkeypatch.setattr(level, "is_its_own", lambda *_: True)
    monkeypatch.setattr(level, "is_shared", lambda *_: False)
    assert level.unexplained_of(search, levels) == ["accel_z", "wheel_speed_fl"]
    assert level.off_where_nothing_is_said(search, levels) == {"accel_x", "accel_y", "accel_z", "wheel_speed_fl"}
    assert level.off_where_nothing_is_said(search, levels | {"accel_y": 1.4}) == {"accel_z", "wheel_speed_fl"}
    # What two sensors have in common is no noise of either.
    monkeypatch.setattr(level, "is_shared", lambda _, __, c, ___: c == 4)
    assert level.unexplained_of(search, levels) == ["accel_y", "accel_z", "wheel_speed_fl"]
    monkeypatch.setattr(level, "is_shared", lambda *_: False)
    monkeypatch.setattr(level, "is_its_own", lambda *_: False)
    assert level.unexplained_of(search, levels) == ["accel_y", "accel_z", "wheel_speed_fl"]
    # Where nothing is said less is enough, of the IMU's channels.
    gone = {"accel_x": 1.6, "accel_y": 1.4, "gyro_x": 2.9, "wheel_speed_fl": 2.9}
    assert level.unexplained_of(search, gone) == []
    assert level.off_where_nothing_is_said(search, gone) == {"accel_x", "gyro_x"}


@pytest.mark.parametrize(("std", "is_named"), [(1.9, True), (2.3, False), (None, True)])
def test_a_stretch_of_less_grip_of_which_nobody_knows_how_much_is_none(
    monkeypatch: pytest.MonkeyPatch, std: float | None, is_named: bool
) -> None:
    """mu = s^-1/2: its spread is half of that of s, over s, times mu; 1.0 of itself at twice s."""
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"inverse_square": (1.1, std and 1.1 * std)})
    monkeypatch.setattr(causes, "spread_of", lambda *_: 0.1)
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    described = BUILT_IN.described("low_friction")._replace(words="")
    x = nothing()
    x[INDEX["low_friction.inverse_square"]] = 1.2
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=SimpleNamespace(described=lambda _: described)),
        best=SimpleNamespace(effects=(), x=x),
        gains={"low_friction": 66.0},
        elsewhere={"low_friction": {}},
    )
    assert (causes.cause_of(search, "low_friction") is not None) is is_named


@pytest.mark.parametrize(("std", "is_named"), [(0.3, True), (0.7, False)])
def test_a_limit_of_grip_is_told_however_its_curve_bends(
    monkeypatch: pytest.MonkeyPatch, std: float, is_named: bool
) -> None:
    """1.2 +- 0.3 is four spreads off none; over all curves it is +- 1.0."""
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"inverse_square": (1.1, 1.0)})
    monkeypatch.setattr(causes, "spread_of", lambda *_: std)
    monkeypatch.setattr(causes, "on_the_clock", lambda _, values: values)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    x = nothing()
    x[INDEX["tyre_saturation.inverse_square"]] = 1.2
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN),
        best=SimpleNamespace(effects=(), x=x),
        gains={"tyre_saturation": 66.0},
        elsewhere={},
    )
    search.elsewhere["tyre_saturation"] = {}
    cause = causes.cause_of(search, "tyre_saturation")
    assert (cause is not None) is is_named
    if cause is not None:
        # And it is told with the spread over all curves.
        friction = cause.parameters["friction_coefficient"]
        assert friction.value == pytest.approx(1.1**-0.5)
        assert friction.std == pytest.approx(0.5 * 1.1**-0.5 * 1.0 / 1.1)


@pytest.mark.parametrize(
    ("gain", "offset_mps2", "is_named"),
    [(60.0, 0.32, False), (60.0, 0.25, True), (60.0, -0.32, True), (300.0, 0.32, True)],
)
@pytest.mark.parametrize(("angle", "channel", "sign"), [("pitch", "accel_x", 1.0), ("roll", "accel_y", -1.0)])
def test_a_mount_that_an_offset_takes_back_is_none(
    monkeypatch: pytest.MonkeyPatch,
    gain: float,
    offset_mps2: float,
    is_named: bool,
    angle: str,
    channel: str,
    sign: float,
) -> None:
    """Nose down by 0.1 rad is -0.98 m/s2 of gravity in reading_x, the left side up by 0.1 rad +0.98 in reading_y."""
    x = nothing()
    x[INDEX[f"imu_misalignment.{angle}_rad"]] = 0.1
    values = {"roll_rad": (0.0, 0.01), "pitch_rad": (0.0, 0.01), "yaw_rad": (0.0, 0.01)}
    values[f"{angle}_rad"] = (0.1, 0.01)
    # Of the other axis, which is not turned, an offset is an offset.
    offsets = {"offset_accel_x": (0.5, 0.1), "offset_accel_y": (0.5, 0.1)}
    offsets[f"offset_{channel}"] = (sign * offset_mps2, 0.1)
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: values)
    monkeypatch.setattr(numbers, "values_of", lambda *_: offsets)
    monkeypatch.setattr(numbers, "told_road", lambda *_: (None, (0.0, 0.0)))
    monkeypatch.setattr(causes, "on_the_clock", lambda _, there: there)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN),
        best=SimpleNamespace(x=x, effects=("imu_misalignment",)),
        rows=None,
        gains={"imu_misalignment": gain},
        elsewhere={"imu_misalignment": {}},
    )
    assert (causes.cause_of(search, "imu_misalignment") is not None) is is_named


@pytest.mark.parametrize(
    ("effects", "effect", "asked"),
    [
        (("gyro_scale",), "gyro_scale", 10.0),
        (("gyro_scale", "imu_lever_arm"), "gyro_scale", 20.0),
        (("gyro_scale", "gyro_z: k*vx"), "gyro_scale", 20.0),
        # What a car or its wheels do is no instrument; and what flickers drifts a little.
        (("tyre_relaxation",), "tyre_relaxation", 20.0),
        (("wheel_radius",), "wheel_radius", 20.0),
        (("bias_drift",), "bias_drift", 20.0),
        (("side_wind",), "side_wind", 40.0),
    ],
)
def test_an_instrument_that_alone_is_wrong_is_told_from_half(
    effects: tuple[str, ...], effect: str, asked: float
) -> None:
    one: Any = SimpleNamespace(vocabulary=BUILT_IN)
    best: Any = SimpleNamespace(effects=effects)
    assert told_from(one, best, effect) == asked


@pytest.mark.parametrize(
    ("gain", "delay_s", "effects", "is_named"),
    [
        (150.0, 0.0045, ("wheel_speed_delay",), True),
        (150.0, 0.0035, ("wheel_speed_delay",), False),
        (90.0, 0.0045, ("wheel_speed_delay",), False),
        (150.0, 0.0045, ("wheel_speed_delay", "gyro_scale"), False),
        (150.0, 0.0085, ("wheel_speed_delay", "gyro_scale"), True),
    ],
)
def test_what_alone_surely_is_there_has_a_name_from_half_of_the_size(
    monkeypatch: pytest.MonkeyPatch, gain: float, delay_s: float, effects: tuple[str, ...], is_named: bool
) -> None:
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {"delay_s": (delay_s, 0.001)})
    monkeypatch.setattr(causes, "on_the_clock", lambda _, there: there)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN),
        best=SimpleNamespace(effects=effects),
        gains={"wheel_speed_delay": gain},
        elsewhere={"wheel_speed_delay": {}},
    )
    assert (causes.cause_of(search, "wheel_speed_delay") is not None) is is_named


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "is_named"),
    [
        ("wheel_slip", "slip_per_force", 0.0024, True),
        ("wheel_slip", "slip_per_force", 0.0018, False),
        # Wheels may all turn by the scale of something else.
        ("wheel_radius", "fl", 0.0006, False),
        ("wheel_radius", "fl", 0.0009, True),
        ("track_width", "front", 0.006, False),
    ],
)
def test_wheels_that_alone_slip_do_so_from_half_of_the_size(
    monkeypatch: pytest.MonkeyPatch, effect: str, parameter: str, value: float, is_named: bool
) -> None:
    monkeypatch.setattr(causes, "values_told", lambda *_, **__: {parameter: (value, 1e-4)})
    for nothing_else in ("wheels_differ", "shares_a_factor"):
        monkeypatch.setattr(causes, nothing_else, lambda *_: False)
    monkeypatch.setattr(causes, "on_the_clock", lambda _, there: there)
    monkeypatch.setattr(causes, "alternatives", lambda *_: ([], []))
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    described = BUILT_IN.described(effect)
    words = described._replace(words="")
    monkeypatch.setattr(causes, "told_from", lambda *_: 20.0)
    vocabulary = SimpleNamespace(described=lambda _: words)
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=vocabulary),
        best=SimpleNamespace(effects=(effect,)),
        gains={effect: 150.0},
        elsewhere={effect: {}},
    )
    assert (causes.cause_of(search, effect) is not None) is is_named
