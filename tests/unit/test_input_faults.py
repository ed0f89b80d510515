"""Steering and wheels that are mapped wrongly: each mistake found and mended, none where it is the IMU or physics."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dsz_daemon import diagnose as api
from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose import diagnose
from dsz_daemon.diagnose.faults.input_faults import (
    AT_THE_ROAD,
    BY_HAND,
    InputWiring,
    _cost,
    _Slopes,
    _View,
    found_input_faults,
)
from dsz_daemon.diagnose.recordings.recording import recorded
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.runs.diagnose import signals_of
from dsz_daemon.runs.setup import set_up
from dsz_daemon.runs.simulate import simulate
from tests.real.recordings import ABSENT, CARS, DATA, FUSION_LOGS

DEG, RATIO, TRACK_M, BASE_M = math.pi / 180.0, 15.0, 1.5, 2.7
# Of a neutral car that turns as its wheels point, r = v delta / L.
CAR = Car(1500.0, 2500.0, 1.35, 1.35, TRACK_M, TRACK_M, 6e4, 6e4, False, True, 0.0, 0.0)
T_S = np.arange(0.0, 90.0, 0.02)
WHEELS = ("fl", "fr", "rl", "rr")


def waves(rms: float, seed: int) -> np.ndarray:
    """What moves up and down within 4 to 12 s."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi / rng.uniform(4.0, 12.0, 12)
    one = np.sum(np.sin(np.outer(T_S, rates) + rng.uniform(0.0, 6.28, 12)), axis=1)
    return rms * one / np.std(one)


def driven(role: str = BY_HAND, noise: float = 1.0, turn_rad: float = 0.015) -> dict[str, Signal]:
    """A drive at 7 to 17 m/s of a car that does as its wheels point, with the noise of its sensors."""
    rng = np.random.default_rng(4)
    v, delta = 12.0 + waves(2.0, 1), waves(turn_rad, 2)
    r = v * delta / BASE_M
    half = 0.5 * TRACK_M * r
    found = {
        role: delta * (RATIO if role == BY_HAND else 1.0),
        "gyro_z": r + 0.03 + noise * rng.normal(0.0, 0.004, len(v)),
        "accel_x": np.gradient(v, T_S) - 0.2 + noise * rng.normal(0.0, 0.1, len(v)),
        "accel_y": v * r + 0.4 + noise * rng.normal(0.0, 0.1, len(v)),
        "accel_z": 9.81 + noise * rng.normal(0.0, 0.1, len(v)),
    }
    for name, sign in zip(WHEELS, (-1.0, 1.0, -1.0, 1.0), strict=True):
        found[f"wheel_speed_{name}"] = v + sign * half + noise * rng.normal(0.0, 0.02, len(v))
    t_ns = (T_S * 1e9).astype(np.int64)
    return {name: Signal(t_ns, np.asarray(values)) for name, values in found.items()}


def times(signals: dict[str, Signal], factors: dict[str, float]) -> dict[str, Signal]:
    return {n: s._replace(values=s.values * factors[n]) if n in factors else s for n, s in signals.items()}


def swapped(signals: dict[str, Signal], *axles: str) -> dict[str, Signal]:
    other = {f"wheel_speed_{a}{s}": f"wheel_speed_{a}{o}" for a in axles for s, o in ("lr", "rl")}
    return {name: signals[other.get(name, name)] for name in signals}


def said(signals: dict[str, Signal], role: str = BY_HAND) -> tuple[list[tuple[str, str]], InputWiring]:
    faults, wiring = found_input_faults(recorded(signals, RATIO), CAR, RATIO, role)
    assert all(fault.gain >= 4.0 and fault.evidence for fault in faults)
    return [(fault.channel, fault.kind) for fault in faults], wiring


def test_each_slope_is_one_as_mapped_and_none_where_nothing_is_seen() -> None:
    """Whatever offsets sensors have; of a gyro that shows noise alone there is none."""
    right = driven()
    slopes = _View(recorded(right, RATIO), CAR).slopes(1.0)
    assert None not in slopes
    assert slopes[:7] == pytest.approx([1.0] * 7, rel=0.03)
    # A rate of change from one half of a second to the next one but one is a bit less.
    assert slopes.along == pytest.approx(1.0, rel=0.06)
    noise = np.random.default_rng(1).normal(0.0, 0.1, len(T_S))
    seen = _View(recorded({**right, "gyro_z": right["gyro_z"]._replace(values=noise)}, RATIO), CAR).slopes(1.0)
    assert (seen.turn, seen.front, seen.rear, seen.across) == (None,) * 4
    assert seen.along == slopes.along


@pytest.mark.parametrize("role", [BY_HAND, AT_THE_ROAD])
def test_as_mapped_nothing_is_said(role: str) -> None:
    assert said(driven(role), role) == ([], InputWiring())


@pytest.mark.parametrize(
    ("role", "factor", "kinds"),
    [
        (BY_HAND, -1.0, ["reversed"]),
        (AT_THE_ROAD, -1.0, ["reversed"]),
        (BY_HAND, 1.0 / DEG, ["deg_for_rad"]),
        (AT_THE_ROAD, DEG, ["rad_for_deg"]),
        (BY_HAND, -1.0 / DEG, ["reversed", "deg_for_rad"]),
        (BY_HAND, 1.0 / RATIO, ["road_wheel_for_steering_wheel"]),
        (AT_THE_ROAD, RATIO, ["steering_wheel_for_road_wheel"]),
    ],
)
def test_steering_is_found_and_mended(role: str, factor: float, kinds: list[str]) -> None:
    right = driven(role)
    wrong = times(right, {role: factor})
    faults, wiring = said(wrong, role)
    assert faults == [(role, kind) for kind in kinds]
    mended = wiring.mended_signals(wrong)
    assert mended[role].values == pytest.approx(right[role].values)
    assert all(mended[name] is wrong[name] for name in ("gyro_z", "accel_x"))
    assert said(mended, role) == ([], InputWiring())


@pytest.mark.parametrize(
    ("factor", "kind"),
    [
        (3.6, "kmh_for_mps"),
        (1.0 / 3.6, "mps_for_kmh"),
        (2.236936, "mph_for_mps"),
        (30.0 / math.pi, "rpm_for_radps"),
        (math.pi / 30.0, "radps_for_rpm"),
    ],
)
def test_all_wheels_in_another_unit_are(factor: float, kind: str) -> None:
    names = [f"wheel_speed_{wheel}" for wheel in WHEELS]
    right = driven()
    wrong = times(right, dict.fromkeys(names, factor))
    faults, wiring = said(wrong)
    assert faults == [(name, kind) for name in names]
    for name in names:
        assert wiring.mended_signals(wrong)[name].values == pytest.approx(right[name].values)


@pytest.mark.parametrize("axles", ["f", "r", "fr"])
def test_sides_that_are_each_other_are(axles: str) -> None:
    right = driven()
    faults, wiring = said(swapped(right, *axles))
    assert faults == [(f"wheel_speed_{axle}l", f"swapped_with_{axle}r") for axle in axles]
    mended = wiring.mended_signals(swapped(right, *axles))
    assert all(np.array_equal(mended[name].values, right[name].values) for name in right)


@pytest.mark.parametrize(
    "factors",
    [
        {"gyro_z": -1.0},
        {"accel_y": -1.0},
        {"accel_x": -1.0},
        # An IMU upside down: as steering and all wheels' sides would be, but for where gravity is.
        {"gyro_z": -1.0, "accel_y": -1.0, "accel_z": -1.0},
        {"gyro_z": 1.0 / DEG},
        {"gyro_z": DEG},
        dict.fromkeys(("accel_x", "accel_y", "accel_z"), 9.80665),
        dict.fromkeys(("accel_x", "accel_y", "accel_z"), 1.0 / 9.80665),
        {"gyro_z": -DEG, "accel_x": -1.0},
    ],
)
def test_what_is_the_imus_is_not_the_inputs(factors: dict[str, float]) -> None:
    assert said(times(driven(), factors)) == ([], InputWiring())


def test_what_no_unit_is_stays_as_it_is() -> None:
    assert said(times(driven(), {BY_HAND: 300.0})) == ([], InputWiring())
    assert said(times(driven(), {"gyro_z": 1e4})) == ([], InputWiring())
    assert said(times(driven(), {f"wheel_speed_{wheel}": 1.6 for wheel in WHEELS})) == ([], InputWiring())


@pytest.mark.parametrize("factor", [-1.0, DEG, 1.0 / DEG])
def test_a_gyros_own_mistake_is_one_and_of_accelerometers_each_one(factor: float) -> None:
    """Whatever else is told by it: 6 for a mistake, and nothing for what it explains."""
    by_gyro = _Slopes(factor, 1.0 / factor, 1.0 / factor, 1.0, 1.0, 1.0 / factor, 1.0, 1.0)
    assert _cost(by_gyro, InputWiring()) == pytest.approx(6.0)
    front = by_gyro._replace(front=-1.0 / factor, front_by_steering=-1.0)
    assert _cost(front, InputWiring(front_swapped=True)) == pytest.approx(6.0)
    rear = by_gyro._replace(rear=-1.0 / factor, rear_by_steering=-1.0)
    assert _cost(rear, InputWiring(rear_swapped=True)) == pytest.approx(6.0)
    unit = -1.0 if factor < 0.0 else 9.80665
    both = _Slopes(1.0, 1.0, 1.0, 1.0, 1.0, unit, unit, unit)
    assert _cost(both, InputWiring()) == pytest.approx(12.0)
    steered = _Slopes(1.0 / factor, 1.0, 1.0, 1.0 / factor, 1.0 / factor, 1.0, 1.0 / factor, 1.0)
    assert _cost(steered, InputWiring(steering=factor)) == 0.0


@pytest.mark.parametrize("factors", [{BY_HAND: 1.3}, {BY_HAND: 0.6}, {"gyro_z": 0.7}, {"accel_y": 1.4}, {BY_HAND: 0.0}])
def test_what_physics_does_is_no_unit(factors: dict[str, float]) -> None:
    assert said(times(driven(), factors)) == ([], InputWiring())


def test_a_wheel_that_is_braked_for_moments_is_not_on_the_other_side() -> None:
    signals = driven()
    r = np.interp(T_S, T_S, signals["gyro_z"].values - 0.03)
    # For most of each second of a hard bend.
    outer = (np.abs(r) > 0.06) & (np.sin(2.0 * np.pi * T_S) > -0.7)
    for name, sign in (("wheel_speed_fl", -1.0), ("wheel_speed_fr", 1.0)):
        values = signals[name].values
        signals[name] = signals[name]._replace(values=np.where(outer & (sign * r > 0.0), 0.9 * values, values))
    front = signals["wheel_speed_fr"].values - signals["wheel_speed_fl"].values
    # By the mean it would be, and by most of what the car turns.
    assert float(front @ r) / float(r @ r) < 0.0
    by_ratio = np.argsort(front / r)
    weight = np.cumsum(np.abs(r)[by_ratio])
    assert (front / r)[by_ratio][np.searchsorted(weight, 0.5 * weight[-1])] < 0.0
    assert said(signals) == ([], InputWiring())


def test_what_is_not_driven_long_enough_says_nothing() -> None:
    wrong = times(driven(), {BY_HAND: -1.0})
    short = {name: Signal(one.t_ns[:600], one.values[:600]) for name, one in wrong.items()}
    assert said(short) == ([], InputWiring())
    straight = times(driven(turn_rad=1e-5), {BY_HAND: -1.0})
    assert said(straight) == ([], InputWiring())
    parked = {n: s._replace(values=0.0 * s.values) if "wheel" in n else s for n, s in wrong.items()}
    assert said(parked) == ([], InputWiring())


def test_without_a_yaw_gyro_wheels_tell_of_the_steering() -> None:
    wrong = times(driven(), {BY_HAND: -1.0})
    del wrong["gyro_z"]
    assert said(wrong)[0] == [(BY_HAND, "reversed")]


def test_a_diagnosis_goes_on_as_if_all_were_mapped_right(tmp_path: Path) -> None:
    simulate("sine_steer", tmp_path, 5, None, [], from_nominal=True)
    setup = set_up(tmp_path / "config.yaml")
    signals = signals_of(setup, [tmp_path / "recording.log"], LogReport())
    vehicle = setup.settings.vehicle
    wrong = times(swapped(signals, "f"), {BY_HAND: 1.0 / DEG})
    found = diagnose(wrong, vehicle.car(), vehicle.steering_ratio).said
    assert [(c.effect, c.parameters["channel"].value, c.parameters["kind"].value) for c in found.causes] == [
        ("axis_fault", BY_HAND, "deg_for_rad"),
        ("axis_fault", "wheel_speed_fl", "swapped_with_fr"),
    ]
    assert found.verdict == "explained"
    assert found.unlisted == []
    assert "deg instead of rad (the yaw gyro shows 0.017" in found.causes[0].statement
    # No more than three of all that is off.
    assert found.causes[0].statement.count(";") == 2


@pytest.mark.parametrize(
    ("factors", "is_said"), [({}, True), ({BY_HAND: -1.0}, False), ({f"wheel_speed_{w}": 3.6 for w in WHEELS}, True)]
)
def test_in_another_unit_a_steerings_last_reading_is_not_its_end(
    monkeypatch: pytest.MonkeyPatch, factors: dict[str, float], is_said: bool
) -> None:
    said_of = []
    monkeypatch.setattr(api, "_where_steered", lambda drive, *_: (drive, ["its end"]))
    monkeypatch.setattr(api, "searched", lambda *_: None)
    monkeypatch.setattr(api, "spinning", lambda *_: ["a spin"])
    found = SimpleNamespace(drive=None, rows=None, best=SimpleNamespace(effects=()))
    monkeypatch.setattr(api, "with_own_numbers", lambda *_: (found, 0.0))
    said = SimpleNamespace(causes=["something"])
    monkeypatch.setattr(api, "answered", lambda *given: said_of.append(given[-1]) or said)
    diagnose(times(driven(), factors), CAR, RATIO)
    assert said_of == [["its end", "a spin"] if is_said else ["a spin"]]


def test_where_nothing_can_be_fitted_a_user_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(api, "searched", fails)
    with pytest.raises(InputError, match="expected steering, wheel speeds and IMU in the units"):
        diagnose(driven(), CAR, RATIO)


@pytest.mark.skipif(ABSENT is not None, reason=str(ABSENT))
@pytest.mark.parametrize("car", ["rav4", "fusion", "mustang"])
def test_real_cars_are_mapped_as_they_are(car: str) -> None:
    logs = {"rav4": ["rav4_highway/recording.log"], "mustang": ["mustang/recording.log"]}.get(car)
    for log in logs or [f"fusion/{name}.log" for name in FUSION_LOGS]:
        setup = set_up(next(CARS.glob(f"*{car}*.yaml")))
        signals = signals_of(setup, [DATA / log], LogReport())
        vehicle = setup.settings.vehicle
        role = BY_HAND if BY_HAND in signals else AT_THE_ROAD
        recording = recorded(signals, vehicle.steering_ratio)
        of_car = (vehicle.car(), vehicle.steering_ratio, role)
        assert found_input_faults(recording, *of_car) == ([], InputWiring())
        if car == "rav4":
            # Which says so since it is seen, not since nothing is.
            wrong = recorded(times(signals, {role: -1.0}), vehicle.steering_ratio)
            assert found_input_faults(wrong, *of_car)[1] == InputWiring(steering=-1.0)
