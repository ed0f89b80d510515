"""diagnose: a sensor's number that is another one for slow motion is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from test_diagnose_choices import TOLERANCE, T, drive, found

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.shapes.unlisted import Coefficient, Shape
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.instruments import low_passed
from dsz_daemon.diagnose.verdict import answer
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.paces import differs_by_pace

ACROSS = 4
# As much of what lasts for seconds as of what does not, of the steering and of the speed.
SPEED = 12.0 + 3.0 * np.sin(2.0 * np.pi * T / 28.0) + 0.3 * np.sin(2.0 * np.pi * T / 3.1)
STEER = 0.025 * np.sin(2.0 * np.pi * T / 30.0) + 0.015 * np.sin(2.0 * np.pi * T / 4.0)


def shown(slow: float, quick: float) -> Drive:
    """A lateral accelerometer that shows so much more of what lasts for seconds, and of what does not."""

    def more(one: Drive) -> None:
        course = one.measured[:, ACROSS].copy()
        lasts = low_passed(course, filter_kernel(4.0))
        one.measured[:, ACROSS] += slow * lasts + quick * (course - lasts)

    return drive({}, SPEED, STEER, change=more)


@pytest.mark.parametrize(
    ("slow", "quick", "is_none"),
    [
        (0.05, 0.05, False),
        (-0.05, -0.05, False),
        # Noise and what a tolerance hides make a little difference.
        (0.045, 0.055, False),
        # A filter that takes what lasts for a tilt, one that has what lasts alone, and one that has more of it.
        (-0.05, 0.0, True),
        (0.05, 0.0, True),
        (0.0, 0.05, True),
        (0.1, 0.02, True),
    ],
)
def test_a_scale_is_one_for_what_lasts_and_what_does_not(slow: float, quick: float, is_none: bool) -> None:
    one = shown(slow, quick)
    rows = rows_of(one)
    fit = fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE)
    told = differs_by_pace(one, rows, fit)
    assert set(told) == ({"accel_scale"} if is_none else set())
    for shape in told.values():
        assert (shape.channel, shape.shape, shape.coefficient.unit) == (
            "accel_y",
            "k*ay where that changes slowly",
            "1",
        )
        # The sign says which of the two there is more of.
        assert np.sign(shape.coefficient.value) == np.sign(slow - quick)
        assert shape.coefficient.value == pytest.approx(slow - quick, rel=0.3)


@pytest.mark.parametrize(
    ("little", "much", "is_none"),
    [
        (0.05, 0.05, False),
        (0.045, 0.055, False),
        # A bracket that tips in hard bends, either way, and one that only bends up to there.
        (0.0, 0.05, True),
        (0.0, -0.05, True),
        (0.05, 0.0, True),
    ],
)
def test_a_scale_is_one_for_much_and_for_little(little: float, much: float, is_none: bool) -> None:
    def more(one: Drive) -> None:
        course = one.measured[:, ACROSS].copy()
        is_much = np.abs(course) > 0.5 * np.quantile(np.abs(course), 0.98)
        one.measured[:, ACROSS] += np.where(is_much, much, little) * course

    one = drive({}, SPEED, STEER, change=more)
    rows = rows_of(one)
    told = differs_by_pace(one, rows, fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE))
    assert set(told) == ({"accel_scale"} if is_none else set())
    for shape in told.values():
        assert (shape.channel, shape.shape) == ("accel_y", "k*ay where that is much")
        assert np.sign(shape.coefficient.value) == np.sign(much - little)


@pytest.mark.parametrize(
    ("coasts", "driven", "braked", "told"),
    [
        (0.05, 0.05, 0.05, None),
        (0.0, 0.05, 0.0, "k*ay where the car is driven"),
        (0.05, 0.05, 0.0, "k*ay where it is braked"),
    ],
)
def test_a_scale_is_one_for_a_car_that_is_driven_and_braked(
    coasts: float, driven: float, braked: float, told: str | None
) -> None:
    # Three phases of a second and a half each, so that none of them is slow, early or hard.
    v_rate = 1.5 * np.sign(np.sin(2.0 * np.pi * T / 4.7)) * (np.abs(np.sin(2.0 * np.pi * T / 4.7)) > 0.5)
    speed = 14.0 + np.cumsum(v_rate) * DT_S

    def more(one: Drive) -> None:
        one.measured[:, ACROSS] *= 1.0 + np.where(v_rate > 0.2, driven, np.where(v_rate < -0.2, braked, coasts))

    one = drive({}, speed, STEER, change=more)
    rows = rows_of(one)
    shapes = differs_by_pace(one, rows, fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE))
    assert [shape.shape for shape in shapes.values()] == ([] if told is None else [told])


@pytest.mark.parametrize(("before", "after", "is_none"), [(0.05, 0.05, False), (0.0, 0.05, True), (0.05, 0.0, True)])
def test_a_scale_is_one_before_and_later(before: float, after: float, is_none: bool) -> None:
    """A load that slides once leans a body from then on, and what it shows of a turn is a leak from then on."""

    def more(one: Drive) -> None:
        one.measured[:, ACROSS] *= 1.0 + np.where(0.6 * T[-1] < T, after, before)

    one = drive({}, SPEED, STEER, change=more)
    rows = rows_of(one)
    told = differs_by_pace(one, rows, fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE))
    assert set(told) == ({"accel_scale"} if is_none else set())
    for shape in told.values():
        # The first of the quarters that tells.
        assert shape.shape in {f"k*ay from {rows.at[len(rows.at) * k // 4] * DT_S:.1f} s on" for k in (1, 2, 3)}
        assert np.sign(shape.coefficient.value) == np.sign(after - before)


def test_noise_makes_no_difference_and_other_effects_have_none() -> None:
    """Of a scale that is next to nothing any noise is a good part."""
    one = shown(1e-4, 1e-4)
    rows = rows_of(one)
    assert differs_by_pace(one, rows, fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE)) == {}
    one = shown(-0.05, 0.0)
    for effects in ((), ("suspension_roll",), ("gyro_scale",)):
        assert differs_by_pace(one, rows, fitted(one, rows, nothing(), effects, TOLERANCE)) == {}


@pytest.mark.parametrize(
    ("effect", "leaks", "told"),
    [
        ("gyro_scale", [(2, 2, 1.0)], ("gyro_z", "k*r where that changes slowly")),
        ("accel_scale", [(3, 3, 1.0)], ("accel_x", "k*ax where that changes slowly")),
        ("accel_cross_axis", [(3, 4, 1.0)], ("accel_x", "k*ay where that changes slowly")),
        ("gyro_cross_axis", [(1, 2, 1.0)], ("gyro_y", "k*r where that changes slowly")),
        ("imu_misalignment", [(3, 4, 1.0), (4, 3, -1.0)], ("accel_x", "k*ay where that changes slowly")),
    ],
)
def test_it_is_told_of_the_channel_that_shows_it(
    effect: str, leaks: list[tuple[int, int, float]], told: tuple[str, str]
) -> None:
    for lasting in (False, True):

        def more(one: Drive, lasting: bool = lasting) -> None:
            shown = one.measured.copy()
            for channel, other, sign in leaks:
                course = shown[:, other].copy()
                course = low_passed(course, filter_kernel(4.0)) if lasting else course
                one.measured[:, channel] += 0.05 * sign * course

        one = drive({}, SPEED, STEER, change=more)
        rows = rows_of(one)
        fit = fitted(one, rows, nothing(), (effect,), TOLERANCE)
        shapes = [(shape.channel, shape.shape) for shape in differs_by_pace(one, rows, fit).values()]
        assert shapes == ([told] if lasting else [])


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_that_hangs_together_is_no_difference(seed: int) -> None:
    """It lasts for a second and a half; counted by rows it would be ten spreads, and five times the number."""
    one = shown(0.01, 0.01)
    slow = lfilter([1.0], [1.0, -np.exp(-DT_S / 1.5)], np.random.default_rng(seed).standard_normal(len(T)))
    one.measured[:, ACROSS] += 0.03 * slow / np.std(slow)
    rows = rows_of(one)
    assert differs_by_pace(one, rows, fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE)) == {}


def test_how_sure_a_difference_is_is_told_by_what_it_leaves() -> None:
    """What is left has the difference in it, which hangs together: by that it would be told half as well."""
    one = shown(0.0, 0.01)
    rows = rows_of(one)
    told = differs_by_pace(one, rows, fitted(one, rows, nothing(), ("accel_scale",), TOLERANCE))["accel_scale"]
    assert abs(told.coefficient.value) > 10.0 * told.coefficient.std


def test_what_is_another_number_for_slow_motion_is_said_without_the_name(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(shown(-0.05, -0.05))
    assert [cause.effect for cause in answered(search).causes] == ["accel_scale"]
    shape = Shape("accel_y", "k*ay where that changes slowly", Coefficient(-0.04, 0.002, "1"), 1.0)
    monkeypatch.setattr(answer, "differs_by_pace", lambda *_: {"accel_scale": shape})
    told = answered(search)
    assert (told.verdict, told.causes, told.unlisted) == ("unexplained", [], [shape])


@pytest.mark.parametrize("is_one_sided", [False, True])
def test_wheel_speeds_are_as_late_driven_as_braked(is_one_sided: bool) -> None:
    """A filter that lets what rises through at once, and what falls by a first order, is no delay."""
    v_rate = 1.5 * np.sign(np.sin(2.0 * np.pi * T / 4.7)) * (np.abs(np.sin(2.0 * np.pi * T / 4.7)) > 0.5)
    one, late_s = drive({}, 14.0 + np.cumsum(v_rate) * DT_S, STEER), 0.04

    def late(column: np.ndarray) -> np.ndarray:
        if not is_one_sided:
            return np.interp(T - late_s, T, column)
        followed, taken = column.copy(), 1.0 - np.exp(-DT_S / late_s)
        for i in range(1, len(column)):
            more = column[i] - followed[i - 1]
            followed[i] = followed[i - 1] + more * (1.0 if more > 0.0 else taken)
        return followed

    measured = one.measured.copy()
    measured[:, 6:9] = np.column_stack([late(column) for column in measured[:, 6:9].T])
    one = one._replace(wheels=np.column_stack([late(column) for column in one.wheels.T]), measured=measured)
    rows = rows_of(one)
    told = differs_by_pace(one, rows, fitted(one, rows, nothing(), ("wheel_speed_delay",), TOLERANCE))
    if not is_one_sided:
        assert told == {}
        return
    shape = told["wheel_speed_delay"]
    assert (shape.channel, shape.coefficient.unit) == ("wheel_speed_fl", "s")
    by_force = {"where the car is driven": -1.0, "where it is braked": 1.0}
    words = shape.shape.removeprefix("later by k, all four, ")
    assert by_force[words] * shape.coefficient.value == pytest.approx(late_s, rel=0.5)


def test_when_a_time_is_another_one_is_said_once(monkeypatch: pytest.MonkeyPatch) -> None:
    search = found(drive({"wheel_speed_delay.delay_s": 0.08}, SPEED, STEER))
    shape = Shape("wheel_speed_fl", "later by k, all four, where it is braked", Coefficient(0.04, 0.002, "s"), 1.0)
    monkeypatch.setattr(answer, "changes_all_the_way", lambda *_: True)
    assert len(answered(search).unlisted) == 4
    monkeypatch.setattr(answer, "differs_by_pace", lambda *_: {"wheel_speed_delay": shape})
    assert answered(search).unlisted == [shape]
