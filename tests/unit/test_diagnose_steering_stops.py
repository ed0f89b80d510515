"""diagnose: a steering sensor that goes no further is said, and the car is not steered by it there."""

from __future__ import annotations

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_V, N, T

from dsz_daemon.diagnose import diagnose
from dsz_daemon.diagnose.faults.steering_stops import is_one, stop_of, without_it
from dsz_daemon.diagnose.recordings.recording import Recording
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.pipeline.grid import Signal

RATIO, LIMIT_RAD = 16.0, 0.6
STAMPS = (1e7 * np.arange(N)).astype(np.int64)
# To either side in four seconds each, by twice the limit every third time.
FAR = (T // 8.0) % 3.0 == 0.0
HAND = np.where(FAR, 1.2, 0.5) * np.sin(2.0 * np.pi * T / 8.0)
STEP_RAD = np.radians(0.1)


def signal(values: np.ndarray) -> Signal:
    return Signal(STAMPS, values)


def ending(noise_rad: float, ends: bool = True) -> np.ndarray:
    """What the sensor says of the hand: no further than its limit, with noise behind that, in steps."""
    said = np.clip(HAND, -LIMIT_RAD, LIMIT_RAD) if ends else HAND
    noisy = said + np.random.default_rng(2).normal(0.0, 1.0, N) * noise_rad
    return np.asarray(STEP_RAD * np.round(noisy / STEP_RAD))


@pytest.mark.parametrize("noise_rad", [0.0, 0.002])
@pytest.mark.parametrize("role", ["steering_wheel_angle", "road_wheel_angle"])
def test_readings_that_stop_and_stand_tell_where_they_end(noise_rad: float, role: str) -> None:
    stop = stop_of({role: signal(ending(noise_rad))})
    assert stop is not None
    assert (stop.role, stop.limit_rad) == (role, pytest.approx(LIMIT_RAD, abs=0.002))
    # Each half wave beyond it, from where it gets there to where it comes back.
    assert len(stop.stood_ns) == 6
    first_s, last_s = stop.stood_ns[1] * 1e-9
    assert first_s == pytest.approx(4.0 + 8.0 * np.arcsin(0.5) / (2.0 * np.pi), abs=0.05)
    assert last_s == pytest.approx(8.0 - 8.0 * np.arcsin(0.5) / (2.0 * np.pi), abs=0.05)
    assert stop.as_shape(0.3)[:2] == (role, f"|{role}| <= k")


def test_what_turns_round_or_is_held_once_ends_nowhere() -> None:
    assert stop_of({"steering_wheel_angle": signal(ending(0.0, ends=False))}) is None
    once = ending(0.0)
    once[400:] = 0.2 * HAND[400:]
    assert stop_of({"steering_wheel_angle": signal(once)}) is None
    assert stop_of({"steering_wheel_angle": signal(np.zeros(N))}) is None
    assert stop_of({"steering_wheel_angle": signal(np.where(T < 5.0, np.nan, HAND))}) is None
    assert stop_of({}) is None
    # A hand that comes to rest slowly stands, too, and as often.
    slowly = LIMIT_RAD * np.tanh(2.0 * HAND / LIMIT_RAD)
    coarse = STEP_RAD * np.round(slowly / STEP_RAD)
    assert np.count_nonzero(np.abs(coarse) == np.max(coarse)) > 200
    assert stop_of({"steering_wheel_angle": signal(coarse)}) is None


def made(turned_rad: np.ndarray, said_rad: np.ndarray) -> dict[str, Signal]:
    """All signals of a car whose wheels turn by the one, and whose sensor says the other."""
    rng = np.random.default_rng(1)
    floor = np.full(10, 1e-3)
    recording = Recording(T, turned_rad / RATIO, np.tile(CITY_V[:, None], (1, 4)), np.zeros((N, 6)), floor)
    car = drive_of(recording, TUCSON, RATIO)
    # Front-driven: the rear wheels' speed is the car's, and front ones and the rear's difference are what it makes.
    shown = predicted(car, nothing(), flat(N))
    names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    signals = {name: signal(shown[:, c] + rng.normal(0.0, 0.004, N)) for c, name in enumerate(names)}
    wheels = {"fl": shown[:, 6], "fr": shown[:, 7], "rl": CITY_V - 0.5 * shown[:, 8], "rr": CITY_V + 0.5 * shown[:, 8]}
    signals |= {f"wheel_speed_{which}": signal(v + rng.normal(0.0, 0.01, N)) for which, v in wheels.items()}
    return signals | {"steering_wheel_angle": signal(said_rad)}


@pytest.mark.parametrize("noise_rad", [0.0, 0.002])
def test_where_it_ends_is_said_and_nothing_else(noise_rad: float) -> None:
    found = diagnose(made(HAND, ending(noise_rad)), TUCSON, RATIO)
    assert (found.said.verdict, found.said.causes) == ("unexplained", [])
    [shape] = found.said.unlisted
    assert (shape.channel, shape.shape) == ("steering_wheel_angle", "|steering_wheel_angle| <= k")
    assert shape.coefficient.value == pytest.approx(LIMIT_RAD, abs=0.002)
    assert 0.3 < shape.share < 0.5
    # The rows in which it stood are not compared.
    stood = (np.abs(HAND) > LIMIT_RAD)[found.search.rows.at]
    assert not found.search.rows.used[stood].any()


def test_a_hand_that_holds_the_wheel_there_is_no_end() -> None:
    """A robot steers to the same angle again and again, and the car turns no further."""
    held = ending(0.0)
    signals = made(held, held)
    stop = stop_of(signals)
    assert stop is not None
    found = diagnose(signals, TUCSON, RATIO)
    assert (found.said.verdict, found.said.unlisted) == ("consistent", [])
    # Nor where another ratio turns it a little further everywhere.
    found = diagnose(made(1.15 * held, held), TUCSON, RATIO)
    assert [cause.effect for cause in found.said.causes] == ["steering_ratio"]
    assert found.said.unlisted == []


@pytest.mark.parametrize(("further", "ends"), [(1.15, False), (1.5, True)])
def test_a_car_that_turns_on_by_as_much_as_a_ratio_may_be_off_is_no_end(further: float, ends: bool) -> None:
    """Where it goes straight on but for that: nothing else tells that the ratio is another."""
    held = np.where(FAR, ending(0.0), 0.05 * HAND)
    signals = made(further * held, held)
    stop = stop_of(signals)
    assert stop is not None
    said = Recording(T, held / RATIO, np.tile(CITY_V[:, None], (1, 4)), np.zeros((N, 6)), np.full(10, 1e-3))
    one = drive_of(said, TUCSON, RATIO)
    turned = drive_of(said._replace(road_wheel_angle_rad=further * held / RATIO), TUCSON, RATIO)
    one.measured[:, :6] = predicted(turned, nothing(), flat(N))[:, :6]
    assert is_one(one, stop, 0) is ends


def test_what_stood_is_left_out_with_what_a_car_remembers() -> None:
    signals = made(HAND, ending(0.0))
    stop = stop_of(signals)
    assert stop is not None
    recording = Recording(T, HAND / RATIO, np.tile(CITY_V[:, None], (1, 4)), np.zeros((N, 6)), np.full(10, 1e-3))
    less, share = without_it(recording, stop, 0)
    gone = np.isnan(less.road_wheel_angle_rad)
    assert share == pytest.approx(np.mean(gone))
    (begin, _), (again, end) = (stop.stood_ns[:2] * 1e-7).astype(int).tolist()
    assert gone[begin - 25 : begin + 250].all()
    assert gone[again - 25 : end + 95].all()
    assert not gone[begin - 35]
    assert not gone[end + 105]
    # What goes through a play before the low-pass is no better known.
    for told_rad in (None, 1.1 * HAND / RATIO):
        before = without_it(recording._replace(told_rad=told_rad), stop, 0)[0].told_rad
        assert before is not None
        assert np.array_equal(np.isnan(before), gone)
        expected = HAND / RATIO if told_rad is None else told_rad
        assert np.array_equal(before[~gone], expected[~gone])


def test_too_little_beside_it_tells_nothing() -> None:
    signals = made(HAND, ending(0.0))
    stop = stop_of(signals)
    assert stop is not None
    one = drive_of(
        Recording(T, ending(0.0) / RATIO, np.zeros((N, 4)), np.zeros((N, 6)), np.full(10, 1e-3)), TUCSON, RATIO
    )
    assert not is_one(one, stop, 0)
