"""diagnose: what a steering that is told in steps leaves open, by hand and by what it does to a recording."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.recordings.recording import DT_S, Recording, filter_kernel, recorded
from dsz_daemon.diagnose.recordings.rounding import rounded_anew
from dsz_daemon.diagnose.residuals.comparison import noises, rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import WHEEL_SPEEDS

N = 6000
T = DT_S * np.arange(N)
T_NS = (1e9 * T).astype(np.int64)
V_MPS = 25.0


def test_a_hand_that_moves_through_many_steps_is_off_evenly() -> None:
    ways = rounded_anew(Signal(T_NS, np.round(7.3 * T)), 1.0)
    assert len(ways) > 1
    inside = slice(100, -100)
    for one in ways:
        assert np.std(one.values[inside]) == pytest.approx(1.0 / math.sqrt(12.0), rel=0.03)
        assert np.max(np.abs(one.values[inside])) <= 0.51


def test_where_zero_is_is_no_matter_of_rounding() -> None:
    for one in rounded_anew(Signal(T_NS, np.full(N, 3.0)), 1.0):
        assert not one.values.any()


@pytest.mark.parametrize(("white", "more"), [(0.0, 0.0), (0.28, 0.0), (0.5, 0.41), (2.0, 1.98), (math.nan, 0.0)])
def test_noise_beyond_what_rounding_makes_of_one_comes_on_top(white: float, more: float) -> None:
    """Each time another, by the whole deviation less the rounding's twelfth of a step's square."""
    ways = rounded_anew(Signal(T_NS, np.full(N, 3.0)), 1.0, white)
    for one in ways:
        assert np.std(one.values) == pytest.approx(more, rel=0.05, abs=1e-12)
    assert more == 0.0 or abs(np.corrcoef(ways[0].values, ways[1].values)[0, 1]) < 0.1


def test_a_hand_that_stays_between_two_steps_is_off_for_as_long() -> None:
    """A bend to each side of half a minute: the same for all of it."""
    held = np.where(T < 30.0, 0.4, -0.4)
    ways = rounded_anew(Signal(T_NS, held), 1.0)
    assert max(float(np.std(one.values)) for one in ways) > 0.3
    for one in ways:
        assert np.ptp(one.values[100:2900]) < 1e-9


def rounded_drive(rounding_rad: np.ndarray | None) -> Drive:
    """25 m/s straight ahead."""
    recording = Recording(
        T, np.zeros(N), np.full((N, 4), V_MPS), np.zeros((N, 6)), np.full(10, 1e-3), rounding_rad=rounding_rad
    )
    return drive_of(recording, TUCSON, 16.0)


def test_what_rounding_leaves_is_what_the_car_makes_of_it() -> None:
    """Slowly, a_y = v^2 e / (L + K v^2), r = a_y / v; for a quarter of a slow wave rows hang together."""
    e = 2e-4 * np.sin(2.0 * np.pi * T / 20.0)
    one = rounded_drive(np.array([e, -e]))
    lf, lr = TUCSON.cg_to_front_axle_m, TUCSON.cg_to_rear_axle_m
    softness = lr / TUCSON.front_cornering_stiffness_n_per_rad - lf / TUCSON.rear_cornering_stiffness_n_per_rad
    across = V_MPS**2 * 2e-4 / math.sqrt(2.0)
    across /= lf + lr + 0.5 * TUCSON.mass_kg * softness / (lf + lr) * V_MPS**2
    assert one.steps[4] == pytest.approx(across, rel=0.03)
    assert one.steps[2] == pytest.approx(across / V_MPS, rel=0.03)
    assert one.steps_rows[4] > 50.0
    # And nothing of what does not turn.
    assert not one.steps[[0, 1]].any()
    np.testing.assert_allclose(noises(one)[4], math.hypot(1e-3, one.steps[4]))


def test_a_hand_that_is_never_still_leaves_what_averages_out() -> None:
    e = 2e-4 * np.random.default_rng(2).choice([-1.0, 1.0], N)
    quick = rounded_drive(np.array([np.convolve(e, np.ones(10) / 10.0, "same")]))
    assert 0.0 < quick.steps_rows[4] < 10.0


def test_a_steering_without_steps_leaves_nothing() -> None:
    one = rounded_drive(None)
    assert not one.steps.any()
    assert not one.steps_rows.any()


@pytest.mark.parametrize("role", ["steering_wheel_angle", "road_wheel_angle"])
def test_a_recordings_steps_are_those_of_the_road_wheels(role: str) -> None:
    """Half a degree of either, on a hand that moves through several a second."""
    step = math.radians(0.5)
    told = Signal(T_NS, step * np.round(0.1 * np.sin(0.7 * T) / step))
    signals = {role: told, "gyro_z": Signal(T_NS, 0.01 * np.sin(T))}
    signals |= {wheel: Signal(T_NS, np.full(N, 10.0)) for wheel in WHEEL_SPEEDS}
    found = recorded(signals, 16.0)
    assert found.rounding_rad is not None
    per = 16.0 if role == "steering_wheel_angle" else 1.0
    rms = float(np.sqrt(np.mean(np.nan_to_num(found.rounding_rad) ** 2)))
    # Evenly spread, of which the low-pass leaves a part.
    assert 0.3 * step / math.sqrt(12.0) / per < rms < step / math.sqrt(12.0) / per


def test_rounding_is_as_much_as_a_rounded_steering_does() -> None:
    """A car that is steered finely and recorded in half degrees: what the simulation is off by is what was expected."""
    step, ratio = math.radians(0.5), 16.0
    wander = np.convolve(np.random.default_rng(5).normal(size=N), np.hanning(120) / 8.0, "same")
    hand = 0.3 * np.sin(0.4 * T) + 0.015 * wander
    signals = {"gyro_z": Signal(T_NS, np.zeros(N))}
    signals |= {wheel: Signal(T_NS, np.full(N, V_MPS)) for wheel in WHEEL_SPEEDS}
    fine = drive_of(recorded(signals | {"steering_wheel_angle": Signal(T_NS, hand)}, ratio), TUCSON, ratio)
    coarsely = Signal(T_NS, step * np.round(hand / step))
    coarse = drive_of(recorded(signals | {"steering_wheel_angle": coarsely}, ratio), TUCSON, ratio)
    off = predicted(coarse, nothing(), flat(N)) - predicted(fine, nothing(), flat(N))
    inside = slice(200, -200)
    for c in (2, 4):
        assert coarse.steps[c] == pytest.approx(float(np.std(off[inside, c])), rel=0.3)


def test_a_profile_may_take_what_rounding_does_and_a_formula_does_not() -> None:
    one = drive({"accel_scale.y": 0.03}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    plain = fitted(one, rows, nothing(), (), TOLERANCE)
    scaled = fitted(one, rows, plain.x, ("accel_scale",), TOLERANCE)
    blown = scaled._replace(effects=("side_wind",))
    steps = np.zeros(13)
    steps[2], steps[4] = 0.002, 0.02
    coarse = one._replace(steps=steps, steps_rows=np.full(13, 50.0))
    assert gained(coarse, plain, scaled) == pytest.approx(gained(one, plain, scaled), rel=0.01)
    # Of the yaw rate, which judges a wind: from ten times its noise of 0.0008 rad/s to that, and to the steps.
    off = plain._replace(unseen=100.0 * blown.unseen)
    share = math.log(math.hypot(0.008, 0.002) / math.hypot(0.0008, 0.002)) / math.log(10.0)
    assert gained(coarse, off, blown) == pytest.approx(share * gained(one, off, blown), rel=0.05)


def test_a_car_that_spins_as_it_is_configured_tells_nothing_of_rounding() -> None:
    spins = TUCSON._replace(rear_cornering_stiffness_n_per_rad=6000.0)
    e = 2e-4 * np.sin(2.0 * np.pi * T / 20.0)
    recording = Recording(
        T, np.zeros(N), np.full((N, 4), V_MPS), np.zeros((N, 6)), np.full(10, 1e-3), rounding_rad=np.array([e])
    )
    one = drive_of(recording, spins, 16.0)
    assert not one.steps.any()
    assert not one.steps_rows.any()


def test_a_recordings_noise_is_in_what_its_steering_may_be_off_by() -> None:
    """A hand that goes through a step a second, and a sensor with the noise of two steps."""
    step = math.radians(0.1)
    noise = 2.0 * step * np.random.default_rng(4).normal(size=N)
    course = np.asarray(0.1 * np.sin(0.2 * T))

    def rms(hand: np.ndarray) -> float:
        signals = {"road_wheel_angle": Signal(T_NS, step * np.round(hand / step)), "gyro_z": Signal(T_NS, 0.01 * T)}
        signals |= {wheel: Signal(T_NS, np.full(N, 10.0)) for wheel in WHEEL_SPEEDS}
        found = recorded(signals, 16.0)
        assert found.rounding_rad is not None
        return float(np.sqrt(np.mean(np.nan_to_num(found.rounding_rad) ** 2)))

    low_pass = math.sqrt(float(np.sum(filter_kernel() ** 2)))
    assert rms(course + noise) == pytest.approx(2.0 * step * low_pass, rel=0.15)
    assert rms(course) < step / math.sqrt(12.0)
