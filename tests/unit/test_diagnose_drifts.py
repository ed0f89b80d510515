"""diagnose: offsets that fade in or jump, sensors that stick, and cars that are pulled aside by what drives them."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import values_of
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.plausible import is_implausible
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.starts import _drifting
from dsz_daemon.diagnose.shapes.jumps import jump_in
from dsz_daemon.diagnose.shapes.unlisted import best_shape, pull_shapes, unlisted
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.instruments import drifted_s
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

FADES, YAW, ACROSS, UP = INDEX["bias_drift.fades_per_s"], 2, 4, 5


def warmed_up(total: float, time_constant_s: float) -> np.ndarray:
    """An offset that has gone by `total` at the end."""
    return total * (1.0 - np.exp(-T / time_constant_s)) / (1.0 - np.exp(-T[-1] / time_constant_s))


@pytest.mark.parametrize("fades_per_s", [-0.02, 1e-9, 0.01, 0.07])
def test_a_drift_that_fades_has_gone_as_far_as_an_even_one(fades_per_s: float) -> None:
    """Against its rate, summed up: exp(-f t), by the end as far as at its mean rate."""
    times = np.linspace(0.0, 150.0, 15001)
    rate = np.exp(-fades_per_s * times)
    gone = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * 0.01)])
    told = [drifted_s(float(t), 150.0, fades_per_s) for t in times[::1500]]
    np.testing.assert_allclose(told, 150.0 * gone[::1500] / gone[-1], atol=1e-3)


def test_the_imu_shows_a_drift_that_fades() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    x = nothing()
    x[INDEX["bias_drift.gyro_z"]], x[FADES] = 2e-5, 0.05
    shown = (predicted(one, x, flat(N)) - predicted(one, nothing(), flat(N)))[:, YAW]
    expected = warmed_up(2e-5 * T[-1], 20.0)
    np.testing.assert_allclose(shown - shown[0], expected, atol=1e-3 * expected[-1])


@pytest.mark.parametrize("time_constant_s", [15.0, 40.0])
def test_a_sensor_that_warms_up_drifts(time_constant_s: float) -> None:
    """A drift that were even would leave what no sensor's noise is, and be none."""
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, UP] += warmed_up(0.12, time_constant_s)
    one.measured[:, YAW] -= warmed_up(0.003, time_constant_s)
    found = searched(one, rows_of(one), TOLERANCE).best
    assert found.effects == ("bias_drift",)
    told = values_of(one, found, "bias_drift")
    assert told["accel_z"][0] == pytest.approx(0.12 / T[-1], rel=0.05)
    assert told["gyro_z"][0] == pytest.approx(-0.003 / T[-1], rel=0.1)
    assert 1.0 / found.x[FADES] == pytest.approx(time_constant_s, rel=0.3)
    assert not is_implausible(one, rows_of(one), found, "bias_drift")


def test_where_a_drift_has_faded_a_sensor_may_wander() -> None:
    """In the last third it has a tenth of its mean rate: what wanders there by as much tells nothing."""
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, UP] += warmed_up(0.12, 15.0) - 0.008 * np.clip((T - 40.0) / 20.0, 0.0, 1.0)
    rows = rows_of(one)
    start = _drifting(rows, fitted(one, rows, nothing(), (), TOLERANCE))
    fit = fitted(one, rows, start, ("bias_drift",), TOLERANCE)
    assert not is_implausible(one, rows, fit, "bias_drift")
    # Twice that in the first third, where it drifts, is no drift.
    one.measured[:, UP] += 0.12 * np.clip(T / 20.0, 0.0, 1.0) - 1.2 * warmed_up(0.12, 15.0)
    rows = rows_of(one)
    assert is_implausible(one, rows, fitted(one, rows, nothing(), ("bias_drift",), TOLERANCE), "bias_drift")


def test_an_even_drift_begins_as_one() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, UP] += 1e-3 * T
    rows = rows_of(one)
    nominal = fitted(one, rows, nothing(), (), TOLERANCE)
    np.testing.assert_array_equal(_drifting(rows, nominal), nominal.x)
    one.measured[:, UP] += warmed_up(0.1, 15.0) - 1e-3 * T
    begun = _drifting(rows_of(one), fitted(one, rows_of(one), nothing(), (), TOLERANCE))
    assert begun[FADES] > 0.0
    assert begun[INDEX["bias_drift.accel_z"]] > 1e-3


@pytest.mark.parametrize(
    ("name", "when", "size", "told"),
    [
        ("brake_steer", "k*ax where ax < 0", -1.2e-3, True),
        ("drive_steer", "k*ax where ax > 0", 1.2e-3, True),
        ("brake_steer", "k*ax where ax < 0", 2.5e-4, False),
    ],
)
def test_a_car_that_is_pulled_aside_by_much_is_told_so(name: str, when: str, size: float, told: bool) -> None:
    one = drive({name: size}, CITY_V, CITY_STEER)
    found = searched(one, rows_of(one), TOLERANCE).best
    assert found.effects == ()
    shapes = pull_shapes(one, found)
    assert [(shape.channel, shape.shape) for shape in shapes] == ([("gyro_z", when)] if told else [])
    for shape in shapes:
        assert shape.coefficient.value == pytest.approx(size, rel=0.1)


def test_beside_a_pull_a_steering_offset_is_less_sure() -> None:
    """At even speed a car is driven, too, by what slows it: so much of the pull is there all the way."""
    spreads = []
    for pull in (0.0, 2e-3):
        one = drive({"steering_offset.offset_rad": 0.005, "drive_steer": pull}, CITY_V, CITY_STEER)
        fit = fitted(one, rows_of(one), nothing(), ("steering_offset",), TOLERANCE)
        spreads.append(values_of(one, fit, "steering_offset")["offset_rad"][1])
    assert spreads[1] == pytest.approx(np.hypot(spreads[0], 0.3 * 2e-3), rel=0.15)


def test_an_offset_that_jumps_is_told_with_its_moment() -> None:
    one = drive({}, CITY_V, CITY_STEER)
    one.measured[:, UP] += 0.3 * (T > 25.0)
    rows = rows_of(one)
    found = searched(one, rows, TOLERANCE)
    assert not any(effect in found.best.effects for effect in ("bias_drift", "imu_misalignment", "road_grade"))
    [shape] = unlisted(found.drive, rows, found.best, found.shapes)
    assert (shape.channel, shape.shape) == ("accel_z", "k*(t > 25.0 s)")
    assert shape.coefficient.value == pytest.approx(0.3, rel=0.02)
    assert shape.coefficient.unit == "m/s2"


def test_what_moves_slowly_or_close_to_an_end_is_no_jump() -> None:
    rng, block = np.random.default_rng(2), np.arange(1500) // 125
    at, noise = 4 * np.arange(1500), 0.01 * np.random.default_rng(1).normal(size=1500)
    assert jump_in(noise + (np.arange(1500) > 700), at, block) == 4 * 701
    assert jump_in(noise, at, block) is None
    assert jump_in(noise + np.linspace(0.0, 1.0, 1500), at, block) is None
    assert jump_in(noise + (np.arange(1500) > 1400), at, block) is None
    hertz = np.fft.rfftfreq(6000, 0.04)
    hertz[0] = np.inf
    for _ in range(20):
        flicker = np.fft.irfft(hertz**-0.5 * (rng.normal(size=len(hertz)) + 1j * rng.normal(size=len(hertz))))[:1500]
        assert jump_in(flicker, at, block) is None


def test_a_sensor_that_sticks_about_nothing_is_told_so() -> None:
    """A dead zone of 0.15 m/s2: the reading is less by that, to either side."""
    one = drive({}, CITY_V, CITY_STEER)
    side = one.measured[:, ACROSS]
    one.measured[:, ACROSS] = np.sign(side) * np.maximum(np.abs(side) - 0.15, 0.0)
    rows = rows_of(one)
    shape = best_shape(one, rows, fitted(one, rows, nothing(), (), TOLERANCE))
    assert shape is not None
    # With how wide it is, since decision 0094: until then it was its sign's.
    assert (shape.channel, shape.shape) in {("accel_y", f"k*sat(ay/{width:.2g})") for width in (0.14, 0.15, 0.16)}
    assert shape.value == pytest.approx(-0.15, rel=0.1)
    assert shape.effect.parameters[0].unit == "m/s2"
