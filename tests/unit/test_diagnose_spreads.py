"""diagnose: how sure a number is, as it is judged by and as it is told."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.row import SENSORS, Effect, Parameter
from dsz_daemon.diagnose.effects.vocabulary import BUILT_IN, INDEX, vocabulary
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import Fit, values_of
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.verdict import causes

LIMITED = {"tyre_saturation.inverse_square": 1.6, "steering_ratio.scale": 0.02}


def fit_of(one: Drive, *effects: str) -> Fit:
    x = nothing(one.vocabulary)
    for name, value in LIMITED.items():
        x[INDEX[name]] = value if name.split(".")[0] in effects else 0.0
    return fitted(one, rows_of(one), x, effects, TOLERANCE)


def spreads_of(one: Drive, fit: Fit, key: str) -> tuple[float, float, float, float]:
    """Value, the data's own variance of it, and the variances that form adds: as judged by, as told."""
    effect, name = key.split(".")
    at = fit.columns.index(INDEX[key])
    value, judged = values_of(one, fit, effect, as_fitted=True)[name]
    told_value, told = values_of(one, fit, effect)[name]
    assert told_value == value
    assert judged == fit.std[at]
    own = float(fit.covariance[at, at])
    return value, own, judged**2 - own, told**2 - own


@pytest.mark.parametrize(
    ("key", "true", "of_itself", "of_the_least"),
    [
        ("accel_scale.y", 0.04, 0.005, 0.05),
        ("gyro_scale.z", 0.05, 0.005, 0.05),
        ("wheel_radius.rl", 0.01, 0.01, 0.15),
        ("steering_backlash.width_rad", 0.01, 0.01, 0.1),
        ("steering_ratio.scale", 0.08, 0.01, 0.1),
    ],
)
def test_what_form_does_to_a_number_is_told_by_where_it_acts(
    key: str, true: float, of_itself: float, of_the_least: float
) -> None:
    """Judged by 2 % of itself and a quarter of what is worth a name; told by as much as came true."""
    one = drive({key: true}, CITY_V, CITY_STEER)
    value, own, judged, told = spreads_of(one, fit_of(one, key.split(".", maxsplit=1)[0]), key)
    least = BUILT_IN.columns[INDEX[key]][1].least
    assert judged == pytest.approx((0.02 * value) ** 2 + (0.25 * least) ** 2, rel=0.01, abs=1e-3 * own)
    assert told == pytest.approx((of_itself * value) ** 2 + (of_the_least * least) ** 2, rel=0.01, abs=1e-3 * own)
    assert abs(value - true) < 1.96 * math.sqrt(own + told)


@pytest.mark.parametrize(
    ("key", "true", "least"),
    [
        # A millisecond, and what a car goes in one.
        ("sensor_bandwidth.time_constant_s", 0.08, 0.001),
        ("steering_delay.delay_s", 0.05, 0.001),
        ("tyre_relaxation.relaxation_length_m", 0.6, 0.001 * math.sqrt(float(np.mean(CITY_V**2)))),
    ],
)
def test_no_time_is_surer_than_a_step_of_a_simulation(key: str, true: float, least: float) -> None:
    one = drive({key: true}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (key.partition(".")[0],), TOLERANCE)
    at = fit.columns.index(INDEX[key])
    own = math.sqrt(float(fit.covariance[at, at]))
    for std in (float(fit.std[at]), float(fit.told[1][at])):
        assert std > math.hypot(own, least)
        assert std < 3.0 * math.hypot(own, least, 0.02 * true, 0.25 * BUILT_IN.columns[INDEX[key]][1].least)


def test_beside_a_limit_of_grip_a_cars_number_is_told_no_surer_than_it_is_judged() -> None:
    """A tyre's own curve is a matter of the tyre, whoever asks."""
    one = drive(LIMITED, CITY_V, 1.3 * CITY_STEER)
    fit = fit_of(one, "tyre_saturation", "steering_ratio")
    value, _, judged, told = spreads_of(one, fit, "steering_ratio.scale")
    least = BUILT_IN.columns[INDEX["steering_ratio.scale"]][1].least
    assert judged == pytest.approx((0.02 * value) ** 2 + (1.25 * least) ** 2, rel=0.01)
    assert told == pytest.approx((0.01 * value) ** 2 + (1.25 * least) ** 2, rel=0.01)


def test_what_has_no_name_and_what_is_refitted_first_is_told_as_it_is_judged() -> None:
    """What came true is known of rows that have been planted often."""
    one = drive({"steering_lag.time_constant_s": 0.1}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), ("steering_lag",), TOLERANCE)
    for effect in ("", "steering_lag"):
        assert values_of(one, fit, effect) == values_of(one, fit, effect, as_fitted=True)


def test_a_row_of_ones_own_is_told_by_where_it_acts() -> None:
    parameter = Parameter("share", "1", 0.01, -1.0, 1.0, 0.01)
    own = Effect(
        "echo",
        "the yaw gyro has {share:.3f} of a_y in it",
        "r + k a_y",
        SENSORS,
        (parameter,),
        shows=lambda motion, values: {"gyro_z": values["share"] * motion.lateral_mps2},
    )
    one = drive({}, CITY_V, CITY_STEER)._replace(vocabulary=vocabulary((own,)))
    fit = fitted(one, rows_of(one), nothing(one.vocabulary), ("echo",), TOLERANCE)
    at = fit.columns.index(len(one.vocabulary.columns) - 1)
    value, told = values_of(one, fit, "echo")["share"]
    assert told**2 - fit.covariance[at, at] == pytest.approx((0.005 * value) ** 2 + (0.05 * 0.01) ** 2, rel=0.01)


@pytest.mark.parametrize(("judged", "is_named"), [(0.019, True), (0.021, False)])
def test_whether_there_is_a_cause_is_not_judged_by_what_is_told(
    monkeypatch: pytest.MonkeyPatch, judged: float, is_named: bool
) -> None:
    """A delay of 40 ms is two spreads of 20 ms or fewer, however sure of its figure an answer is."""
    told = {"delay_s": (0.04, 0.005)}
    monkeypatch.setattr(
        causes, "values_told", lambda *_, as_fitted=False: {"delay_s": (0.04, judged)} if as_fitted else dict(told)
    )
    for name, stand_in in (("on_the_clock", lambda _, values: values), ("alternatives", lambda *_: ([], []))):
        monkeypatch.setattr(causes, name, stand_in)
    monkeypatch.setattr(causes, "_to_drive_next", lambda *_: None)
    monkeypatch.setattr(causes, "wheels_differ", lambda *_: False)
    monkeypatch.setattr(causes, "told_from", lambda *_: 12.0)
    best: Any = SimpleNamespace(effects=("imu_delay", "accel_scale"), x=nothing())
    search: Any = SimpleNamespace(
        drive=SimpleNamespace(vocabulary=BUILT_IN), best=best, gains={"imu_delay": 20.0}, elsewhere={"imu_delay": {}}
    )
    cause = causes.cause_of(search, "imu_delay")
    assert (cause is not None) is is_named
    if cause is not None:
        assert (cause.parameters["delay_s"].value, cause.parameters["delay_s"].std) == (0.04, 0.005)
