"""diagnose: an IMU that is turned, as small angles or wholly, in whatever order; and what gravity alone shows of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_diagnose_choices import CITY_STEER, CITY_V, N, drive, found

from dsz_daemon.diagnose.effects.row import Parameter
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.mounts import as_drawn_rad, as_offsets_else, untold_turns
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import gyros_of, predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.answer import answered

TURNS = {"roll_rad": -0.047, "pitch_rad": -0.045, "yaw_rad": 0.055}
THREE = (0, 1, 5)


def by_small_angles() -> np.ndarray:
    """The contract's formula."""
    roll, pitch, yaw = TURNS.values()
    return np.array([[1.0, yaw, -pitch], [-yaw, 1.0, roll], [pitch, -roll, 1.0]])


def one_after_another(order: str) -> np.ndarray:
    """What turned axes see of a vector: by the transposed matrix, of intrinsic turns in this order."""
    angles = [TURNS[f"{ {'X': 'roll', 'Y': 'pitch', 'Z': 'yaw'}[axis] }_rad"] for axis in order]
    return np.asarray(Rotation.from_euler(order, angles).as_matrix().T)


def turned(matrix: np.ndarray, without: tuple[int, ...] = ()) -> Drive:
    """A noisy drive in a town, all of whose readings are turned; offsets are as they were."""

    def change(one: Drive) -> None:
        course = predicted(one, nothing(), flat(N))[:, :6]
        for first in (0, 3):
            axes = slice(first, first + 3)
            one.measured[:, axes] += course[:, axes] @ (matrix - np.eye(3)).T
        one.measured[:, without] = np.nan

    return drive({}, CITY_V, CITY_STEER, change=change)


@pytest.mark.parametrize(
    "matrix",
    [by_small_angles(), *(one_after_another(order) for order in ("XYZ", "ZYX", "YXZ"))],
    ids=["small angles", "XYZ", "ZYX", "YXZ"],
)
@pytest.mark.parametrize("without", [(), THREE], ids=["six channels", "three channels"])
def test_a_turned_mount_is_all_that_is_said(matrix: np.ndarray, without: tuple[int, ...]) -> None:
    """Whole turns have squares and products of angles in them, which looked like leaks and scales of 0.2 %."""
    said = answered(found(turned(matrix, without)))
    assert [cause.effect for cause in said.causes] == ["imu_misalignment"]
    for name, value in said.causes[0].parameters.items():
        assert abs(value.value - TURNS[name]) < 3.0 * value.std
    assert list(said.causes[0].parameters) == ["roll_rad", "pitch_rad", "yaw_rad"]


def test_nothing_is_said_of_turns_that_gravity_alone_would_show() -> None:
    said = answered(found(turned(one_after_another("XYZ"), THREE)))
    for name in ("roll_rad", "pitch_rad"):
        assert (said.causes[0].parameters[name].value, said.causes[0].parameters[name].std) == (0.0, 0.3)


def test_the_whole_turn_is_one_to_second_order() -> None:
    x = nothing()
    for name, value in TURNS.items():
        x[INDEX[f"imu_misalignment.{name}"]] = value
    whole = Rotation.from_rotvec(list(TURNS.values())).as_matrix().T
    assert np.abs(gyros_of(x)[0] - whole).max() < 1e-4
    assert np.abs(by_small_angles() - whole).max() > 2e-3
    x[INDEX["small_turns"]] = 1.0
    assert np.allclose(gyros_of(x)[0], by_small_angles(), atol=1e-15)


@pytest.mark.parametrize(
    ("without", "untold"),
    [((), ""), ((0,), ""), ((0, 1), ""), ((0, 5), "pitch"), ((1, 5), "roll"), (THREE, "roll pitch"), ((5,), "")],
)
def test_what_shows_a_turn(without: tuple[int, ...], untold: str) -> None:
    """A rolled mount shows yaw to the pitch gyro, and lateral forces to a_z; a pitched one, to the roll gyro."""
    one = turned(np.eye(3), without)
    assert untold_turns(one, ("imu_misalignment",)) == {
        INDEX[f"imu_misalignment.{axis}_rad"] for axis in untold.split()
    }


def test_on_a_road_without_their_gyros_the_yaw_gyro_shows_a_turn() -> None:
    """What is rolled leaks how a climbing road pitches the car, what is pitched how a bank rolls it."""
    one = turned(np.eye(3), THREE)
    roll, pitch = (INDEX[f"imu_misalignment.{axis}_rad"] for axis in ("roll", "pitch"))
    assert untold_turns(one, ("imu_misalignment", "road_grade")) == {pitch}
    assert untold_turns(one, ("imu_misalignment", "road_bank")) == {roll}
    assert untold_turns(one, ("imu_misalignment", "suspension_roll")) == {roll, pitch}


def test_what_any_value_would_explain_is_nothing() -> None:
    parameters = [Parameter(name, "1", 0.03, -0.2, 0.2, 0.004) for name in ("xy", "xz", "yz")]
    assert as_offsets_else(parameters, {"xy": (0.03, 0.001), "xz": (-0.2, 0.31)}) == {
        "xy": (0.03, 0.001), "xz": (0.0, 0.31), "yz": (0.0, 0.2),
    }  # fmt: skip


def test_an_order_of_turns_is_half_a_product_of_the_other_two() -> None:
    x = nothing()
    for name, value in TURNS.items():
        x[INDEX[f"imu_misalignment.{name}"]] = value
    roll, pitch, yaw = (INDEX[f"imu_misalignment.{name}"] for name in TURNS)
    assert as_drawn_rad(x) == pytest.approx(
        {roll: 0.5 * 0.045 * 0.055, pitch: 0.5 * 0.047 * 0.055, yaw: 0.5 * 0.047 * 0.045}
    )
