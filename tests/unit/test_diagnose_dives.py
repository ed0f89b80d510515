"""diagnose: a body that dives, driven by a speed that is noisy, pitches where the car does not."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim
from test_diagnose_choices import TOLERANCE, N, T, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting import judgement
from dsz_daemon.diagnose.fitting.dives import noise_of_a_dive
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.selection import screening as screening_module
from dsz_daemon.diagnose.selection import starts as starts_module
from dsz_daemon.diagnose.selection.plausible import are_one_turn
from dsz_daemon.diagnose.selection.search import searched
from dsz_daemon.diagnose.selection.trials import Step, rank_by
from dsz_daemon.diagnose.simulation.drive import Drive, nothing

GRADIENT = "suspension_pitch.pitch_gradient_rad_per_mps2"
# Brakes for two seconds at 3 m/s2 every twenty, and picks up speed again at 0.5.
SPEED = 14.0 + np.cumsum(np.where(T % 20.0 < 2.0, -3.0, np.where(T % 20.0 < 14.0, 0.5, 0.0))) * DT_S
STEER = 0.01 * np.sin(0.5 * T)


def with_noisy_wheels(one: Drive, std_mps: float, seed: int = 3) -> Drive:
    """The same drive, of which the wheels tell the speed with white noise, as the recording's low-pass leaves it."""
    noise = np.random.default_rng(seed).normal(size=(N, 4)) * std_mps
    kernel = filter_kernel()
    smooth = np.column_stack([np.convolve(noise[:, c], kernel, mode="same") for c in range(4)])
    floor = one.recording.floor.copy()
    floor[6:] = std_mps * math.sqrt(float(np.sum(kernel**2)))
    recording = one.recording._replace(wheels_mps=one.recording.wheels_mps + smooth, floor=floor)
    noisy = drive_of(recording, one.car, one.steering_ratio)
    assert not noisy.front_gives_speed
    noisy.measured[:, :9] = one.measured[:, :9]
    noisy.measured[:, 6:8] += smooth[:, :2]
    noisy.measured[:, 8] += smooth[:, 3] - smooth[:, 2]
    return noisy


@pytest.mark.parametrize(("more_hz", "damped"), [(0.0, 0.35), (0.5, 0.2)])
def test_what_noise_pitches_is_what_a_body_on_springs_makes_of_it(more_hz: float, damped: float) -> None:
    """Against the same body solved as a differential equation, of noise that is drawn."""
    level = drive({}, SPEED, STEER)
    one = with_noisy_wheels(level, 0.05)
    x, radps = nothing(), 2.0 * math.pi * (1.5 + more_hz)
    x[INDEX[GRADIENT]] = -0.01
    x[INDEX["suspension_pitch.frequency_share"]], x[INDEX["suspension_pitch.damping"]] = more_hz / 1.5, damped - 0.35
    rate = np.gradient(np.mean(one.recording.wheels_mps[:, 2:], axis=1) - SPEED, DT_S)
    _, pitch, _ = lsim(([0.01 * radps**2], [1.0, 2.0 * damped * radps, radps**2]), rate, T)
    expected = float(np.std(np.gradient(pitch, DT_S)))
    found = noise_of_a_dive(one, x)
    assert found[1] == pytest.approx(expected, rel=0.1)
    assert not np.delete(found, 1).any()
    assert not noise_of_a_dive(one, nothing()).any()


def test_it_is_the_noise_of_the_axle_that_gives_the_speed() -> None:
    x = nothing()
    x[INDEX[GRADIENT]] = 0.01
    rear = with_noisy_wheels(drive({}, SPEED, STEER), 0.05)
    floor = rear.recording.floor.copy()
    floor[6:8] *= 3.0
    uneven = rear._replace(recording=rear.recording._replace(floor=floor))
    of_one = noise_of_a_dive(rear, x)[1]
    assert noise_of_a_dive(uneven, x)[1] == pytest.approx(of_one)
    by_front = uneven._replace(front_gives_speed=True)
    assert noise_of_a_dive(by_front, x)[1] == pytest.approx(3.0 * of_one)


def test_what_noise_pitches_is_the_simulations_own_coarseness() -> None:
    one = with_noisy_wheels(drive({GRADIENT: 0.01}, SPEED, STEER), 0.05)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("suspension_pitch",), TOLERANCE)
    noise = noise_of_a_dive(one, fit.x)[1]
    assert noise > 3.0 * rows.form[1]
    assert noise < fit.form[1] < 1.5 * noise


def test_a_dive_is_told_where_the_noise_of_the_wheels_pitches_the_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pitch gyro that is quiet as the car goes evenly is no witness against a dive: the simulation is driven.

    With less noise than 0.07 m/s a dive is told anyway, with more than 0.1 m/s not at all.
    """
    one = with_noisy_wheels(drive({GRADIENT: 0.01}, SPEED, STEER), 0.075)
    rows = rows_of(one)
    found = searched(one, rows, TOLERANCE)
    assert found.best.effects == ("suspension_pitch",)
    assert found.best.x[INDEX[GRADIENT]] == pytest.approx(0.01, abs=0.001)

    def none(_one: Drive, _x: object) -> np.ndarray:
        return np.zeros(13)

    for module in (judgement, screening_module):
        monkeypatch.setattr(module, "noise_of_a_dive", none)
    # Nor is it tried because an accelerometer's scale is.
    monkeypatch.setattr(starts_module, "LEANS", frozenset())
    assert "suspension_pitch" not in searched(one, rows, TOLERANCE).best.effects


def leaking(xy: float, yx: float, std: float = 0.01) -> Any:
    x = nothing()
    columns = (0, INDEX["accel_cross_axis.xy"], INDEX["accel_cross_axis.yx"])
    x[list(columns[1:])] = xy, yx
    std_of_all = np.array([1.0, std, std])
    return SimpleNamespace(x=x, std=std_of_all, columns=columns, effects=("accel_cross_axis",), per_row=np.ones(13))


@pytest.mark.parametrize(
    ("xy", "yx", "is_one"),
    [
        (0.07, -0.07, True),
        (-0.07, 0.05, True),
        (0.07, 0.07, False),
        (0.07, -0.04, False),
        (0.029, -0.029, False),
        (0.035, -0.025, False),
    ],
)
def test_two_leaks_that_are_as_large_the_other_way_are_one_turn(xy: float, yx: float, is_one: bool) -> None:
    assert are_one_turn(leaking(xy, yx)) is is_one


def test_what_has_no_leaks_is_no_turn_of_theirs() -> None:
    other: Any = SimpleNamespace(x=nothing(), std=np.ones(1), columns=(0,), effects=("gyro_scale",))
    assert not are_one_turn(other)


@pytest.mark.parametrize(("yx", "first"), [(-0.07, "imu_misalignment"), (0.07, "accel_cross_axis")])
def test_a_turned_mount_comes_before_two_leaks_that_happen_to_be_one(
    monkeypatch: pytest.MonkeyPatch, yx: float, first: str
) -> None:
    gains = {"accel_cross_axis": 502.0, "imu_misalignment": 500.0}
    monkeypatch.setattr("dsz_daemon.diagnose.selection.trials.gained", lambda *given: gains[given[2].effects[-1]])
    mount = leaking(0.0, 0.0)
    mount.effects = ("imu_misalignment",)
    steps = [Step("accel_cross_axis", 502.0, leaking(0.07, yx)), Step("imu_misalignment", 500.0, mount)]
    assert max(steps, key=rank_by(None, None, steps)).effect == first  # type: ignore[arg-type]
