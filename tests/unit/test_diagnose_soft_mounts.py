"""diagnose: an IMU that swings on its mount has no name, and gives none to a delay, a low-pass or a tyre."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lsim
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, N, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.instruments import swung
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.simulation.slow_sensors import smoothed
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.said import Diagnosis
from dsz_daemon.diagnose.verdict.unnamed import not_named

HZ, DAMPING = 1.9, 0.08
# A hand that trembles: what turns slowly alone swings nothing.
LIVELY = (
    CITY_STEER + 0.004 * np.sin(2.0 * np.pi * 1.6 * T) * np.sin(0.7 * T) + 0.003 * np.sin(13.0 * T + 2.0 * np.sin(T))
)
BUMPY_V = CITY_V + 0.03 * np.sin(11.0 * T) * np.sin(0.4 * T)


def on_rubber(channels: list[int], left_out: dict[str, float] | None = None, carried: float = 1.0) -> Drive:
    """A drive whose IMU stands on springs and dampers: the closed form, by another's hand."""
    rate = 2.0 * math.pi * HZ
    moved = [2.0 * DAMPING * rate * carried, rate**2] if carried else [rate**2]
    system = (moved, [1.0, 2.0 * DAMPING * rate, rate**2])

    def swings(one: Drive) -> None:
        still = predicted(one, nothing(), flat(N))
        for c in channels:
            one.measured[:, c] += lsim(system, still[:, c] - still[0, c], T)[1] + still[0, c] - still[:, c]

    return drive(left_out or {}, BUMPY_V, LIVELY, change=swings)


@pytest.mark.parametrize(("hz", "damping"), [(1.0, 0.05), (1.9, 0.2), (3.5, 0.35)])
@pytest.mark.parametrize("of_rate", [0.3, 1.0, 1.4])
@pytest.mark.parametrize("carried", [1.0, 0.4, 0.0])
def test_a_mass_on_springs_and_dampers_moves_as_its_transmissibility_says(
    hz: float, damping: float, of_rate: float, carried: float
) -> None:
    rate = 2.0 * math.pi * hz
    shakes = np.sin(of_rate * rate * T)
    moves = swung(shakes[:, np.newaxis], rate, damping, DT_S, carried)[:, 0]
    drag = 2.0j * damping * of_rate
    response = (1.0 + carried * drag) / (1.0 - of_rate**2 + drag)
    expected = np.abs(response) * np.sin(of_rate * rate * T + np.angle(response))
    settled = slice(N // 2, N)
    np.testing.assert_allclose(moves[settled], expected[settled], atol=0.02 * np.abs(response))


def test_it_begins_at_rest_and_what_it_shows_of_that_is_a_share() -> None:
    level = np.full((300, 6), 9.81)
    x = nothing()
    x[INDEX["soft_mount.per_w2_s2"]], x[INDEX["soft_mount.damping"]] = 0.007, 0.1
    x[INDEX["soft_mount.gyros"]], x[INDEX["soft_mount.accel_x"]], x[INDEX["soft_mount.accel_z"]] = 0.25, 1.0, 0.5
    x[INDEX["soft_mount.carried"]] = 0.6
    np.testing.assert_allclose(smoothed(level, x), level, rtol=1e-12)
    step = level.copy()
    step[100:] += 1.0
    shown = smoothed(step, x) - 9.81
    swings = swung(step, 0.007**-0.5, 0.1, DT_S, 0.6) - 9.81
    shares = np.array([0.25, 0.25, 0.25, 1.0, 0.0, 0.5])
    np.testing.assert_allclose(shown, shares * swings + (1.0 - shares) * (step - 9.81), atol=1e-12)


@pytest.mark.parametrize(
    ("channels", "shown"),
    [
        ([0, 1, 2, 3, 4, 5], ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y"]),
        ([3, 4, 5], ["accel_x", "accel_y"]),
        ([4], ["accel_y"]),
        ([3], ["accel_x"]),
    ],
)
@pytest.mark.parametrize("carried", [1.0, 0.0])
def test_an_imu_on_rubber_is_told_as_that(channels: list[int], shown: list[str], carried: float) -> None:
    """In what shows it: nothing swings upwards here, and of gyros as of the one that yaws."""
    said = told(on_rubber(channels, carried=carried))
    assert said.causes == []
    assert said.parameter_errors == []
    assert [(shape.channel, shape.shape) for shape in said.unlisted] == [(channel, "swings") for channel in shown]
    for shape in said.unlisted:
        assert shape.coefficient.unit == "Hz"
        assert abs(shape.coefficient.value - HZ) < 2.0 * shape.coefficient.std < 0.1 * HZ


def told(one: Drive) -> Diagnosis:
    return answered(found(one))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("imu_delay.delay_s", 0.08),
        ("sensor_bandwidth.time_constant_s", 0.08),
        ("tyre_relaxation.relaxation_length_m", 0.8),
        ("suspension_roll.roll_gradient_rad_per_mps2", 0.01),
    ],
)
def test_what_is_late_slow_or_leans_swings_on_no_mount(key: str, value: float) -> None:
    one = drive({key: value}, BUMPY_V, LIVELY)
    rows = rows_of(one)
    assert "soft_mount" not in dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))
    said = told(one)
    assert [cause.effect for cause in said.causes] == [key.split(".", maxsplit=1)[0]]
    assert said.unlisted == []


def test_where_nothing_is_left_nothing_swings() -> None:
    one = drive({}, BUMPY_V, LIVELY)
    rows = rows_of(one)
    assert guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)) == []


@pytest.mark.parametrize(("scale", "is_guessed"), [(0.0, True), (0.2, True), (0.4, False)])
def test_a_mount_is_guessed_where_it_halves_what_a_channel_has_left(scale: float, is_guessed: bool) -> None:
    """What is wrong by more comes first."""
    one = on_rubber([2, 3, 4], {"gyro_scale.z": scale, "accel_scale.x": scale, "accel_scale.y": scale})
    rows = rows_of(one)
    names = [name for name, _ in guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE))]
    assert ("soft_mount" in names) is is_guessed


@pytest.mark.parametrize(
    ("effect", "share", "is_named"),
    [("suspension_roll", 1.0, False), ("suspension_roll", 0.5, True), ("suspension_pitch", 1.0, False)],
)
def test_a_body_that_swings_as_fast_as_any_may_is_the_mount(effect: str, share: float, is_named: bool) -> None:
    one = drive({}, CITY_V, CITY_STEER)
    fit = fitted(one, rows_of(one), nothing(), (), TOLERANCE)
    x = fit.x.copy()
    x[INDEX[f"{effect}.frequency_share"]] = share
    alone, beside = fit._replace(x=x, effects=(effect,)), fit._replace(x=x, effects=("soft_mount", effect))
    assert effect not in not_named(one, alone, set())
    assert (effect not in not_named(one, beside, set())) is is_named


def smoothly(columns: np.ndarray, time_constant_s: float) -> np.ndarray:
    """Each column by a first order, of scipy's."""
    system = ([1.0], [time_constant_s, 1.0])
    return np.column_stack([lsim(system, one - one[0], T)[1] + one[0] for one in columns.T])


def test_wheels_that_follow_smoothly_are_not_late_by_a_time() -> None:
    """And it is not the IMU that swings."""
    one = drive({}, BUMPY_V, CITY_STEER)
    measured = one.measured.copy()
    measured[:, 6:9] = smoothly(measured[:, 6:9], 0.15)
    told = answered(found(one._replace(wheels=smoothly(one.wheels, 0.15), measured=measured)))
    assert told.causes == []
    assert [(shape.channel, shape.shape) for shape in told.unlisted] == [
        (f"wheel_speed_{wheel}", "k*ax") for wheel in ("fl", "fr", "rl", "rr")
    ]
    assert told.unlisted[0].coefficient.value == pytest.approx(-0.15, rel=0.1)


@pytest.mark.parametrize(
    ("shows", "is_late"), [(("accel_x",), False), (("accel_x", "accel_z"), True), (("gyros",), True)]
)
def test_wheels_follow_smoothly_where_something_swings_along_the_car_alone(
    shows: tuple[str, ...], is_late: bool
) -> None:
    one = drive({}, BUMPY_V, LIVELY)
    x = nothing()
    x[INDEX["soft_mount.per_w2_s2"]], x[INDEX["wheel_speed_delay.delay_s"]] = 0.007, 0.1
    fit = fitted(one, rows_of(one), x, ("wheel_speed_delay", "soft_mount"), TOLERANCE)
    shares = [INDEX[f"soft_mount.{name}"] for name in ("gyros", "accel_x", "accel_y", "accel_z")]
    there = fit.x.copy()
    there[shares] = 0.0
    there[[INDEX[f"soft_mount.{name}"] for name in shows]] = 1.0
    columns = (*(i for i in fit.columns if i not in shares), *shares)
    fit = fit._replace(x=there, columns=columns, std=np.full(len(columns), 0.01), told=None)
    assert ("wheel_speed_delay" not in not_named(one, fit, set())) is is_late
    assert ("wheel_speed_delay" in not_named(one, fit._replace(effects=("wheel_speed_delay",)), set())) is False
