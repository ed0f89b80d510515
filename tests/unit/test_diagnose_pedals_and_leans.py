"""diagnose: what a pedal switches on, and bodies that lean as a scale would show it, or by small angles."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, N, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S, recorded
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.aliases import known_classes
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.pipeline.grid import Signal

ACROSS, UPRIGHT, PITCH_GYRO, ROLL_GYRO = 4, 5, 1, 0
BRAKES = (np.sin(0.3 * T + 1.5) < -0.6).astype(np.float64)


def test_what_a_pedal_switches_on_is_told_by_that() -> None:
    """A lamp's current, of which a supply goes down; not by how the car moves meanwhile."""

    def dims(one: Drive) -> None:
        one.measured[:, ACROSS] += 0.3 * BRAKES

    one = drive({}, CITY_V, CITY_STEER, change=dims)
    one = one._replace(recording=one.recording._replace(pressed=(("brake", BRAKES),)))
    told = answered(found(one))
    assert told.causes == []
    [shape] = told.unlisted
    assert (shape.channel, shape.shape, shape.coefficient.unit) == ("accel_y", "k*(brake pressed)", "m/s2")
    assert shape.coefficient.value == pytest.approx(0.3, rel=0.05)


def test_a_pedal_is_as_it_was_until_it_is_told_again() -> None:
    """Sent as it changes: pressed from 2 to 5 s; of any value but 0."""
    wheel = Signal((1e7 * np.arange(1000)).astype(np.int64), np.full(1000, 10.0))
    pedal = Signal(np.array([1e9, 2e9, 5e9]).astype(np.int64), np.array([0.0, 40.0, 0.0]))
    read = recorded({"wheel_speed_fl": wheel, "brake": pedal}, 16.0)
    [(name, pressed)] = read.pressed
    assert name == "brake"
    at = (np.array([0.5, 1.7, 2.3, 4.7, 5.3, 9.0]) / DT_S).astype(int)
    np.testing.assert_allclose(pressed[at], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0], atol=1e-3)
    assert pressed[round(2.0 / DT_S)] == pytest.approx(0.5, abs=0.1)
    never = Signal(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert recorded({"wheel_speed_fl": wheel, "brake": never}, 16.0).pressed == ()


@pytest.mark.parametrize("lean", ["suspension_roll.roll_gradient", "suspension_pitch.pitch_gradient"])
def test_a_lean_drawn_for_small_angles_leaves_no_shape_in_the_vertical(lean: str) -> None:
    """The contract's formula is a_y (1 + g k) and a_x (1 + g k): what a_z shows of a lean it does not say."""
    leans = {f"{lean}_rad_per_mps2": 0.011}
    x = nothing()
    x[INDEX[next(iter(leans))]] = 0.011

    def change(one: Drive) -> None:
        wholly = predicted(one, x, flat(N))[:, UPRIGHT]
        one.measured[:, UPRIGHT] -= wholly - np.mean(wholly)

    quick_v = 14.0 + 4.0 * np.sin(0.6 * T)
    told = answered(found(drive(leans, quick_v, 1.5 * CITY_STEER, change=change)))
    assert [cause.effect for cause in told.causes] == [lean.partition(".")[0]]
    assert told.unlisted == []


@pytest.mark.parametrize(
    ("effect", "missing", "scale", "classes"),
    [
        ("accel_scale", (), (0.1, 0.1), set()),
        ("accel_scale", (ROLL_GYRO,), (0.1, 0.1), {"suspension_roll"}),
        ("accel_scale", (ROLL_GYRO, PITCH_GYRO), (0.1, 0.1), {"suspension_roll", "suspension_pitch"}),
        # No body leans into a bend, or dives as it speeds up.
        ("accel_scale", (ROLL_GYRO, PITCH_GYRO), (0.1, -0.1), {"suspension_pitch"}),
        ("suspension_roll", (ROLL_GYRO,), (0.0, 0.0), {"accel_scale"}),
        ("suspension_roll", (PITCH_GYRO,), (0.0, 0.0), set()),
        ("suspension_pitch", (PITCH_GYRO,), (0.0, 0.0), {"accel_scale"}),
        ("gyro_scale", (ROLL_GYRO, PITCH_GYRO), (0.1, 0.1), set()),
    ],
)
def test_without_its_gyro_a_lean_is_a_scale(
    effect: str, missing: tuple[int, ...], scale: tuple[float, float], classes: set[str]
) -> None:
    def change(one: Drive) -> None:
        one.measured[:, missing] = np.nan

    one = drive({}, CITY_V, CITY_STEER, change=change)
    best = found(one).best
    x = best.x.copy()
    x[INDEX["accel_scale.x"]], x[INDEX["accel_scale.y"]] = scale
    assert known_classes(one, best._replace(x=x), effect) == classes
    assert known_classes(one, best, "mass_loading") > {"cornering_stiffness"}
