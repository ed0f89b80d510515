"""diagnose: a body that leans later than any on springs has no suspension's name, nor a road's."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from test_diagnose_choices import CITY_STEER, CITY_V, T, drive, found

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.late_leans import leans_late, with_their_roads

ACROSS, ROLLS = 4, 0
PER_MPS2 = 0.01


def leaning(by_s: float) -> Drive:
    """A body that follows the lateral acceleration by a first order."""

    def leans(one: Drive) -> None:
        side = one.measured[:, ACROSS].copy()
        kept = np.exp(-DT_S / by_s)
        roll = PER_MPS2 * np.asarray(lfilter([1.0 - kept], [1.0, -kept], side))
        one.measured[:, ACROSS] += 9.80665 * roll
        one.measured[:, ROLLS] += np.gradient(roll, DT_S)

    slow = CITY_STEER + 0.04 * np.sin(2.0 * np.pi * T / 17.0)
    return drive({}, CITY_V, slow, change=leans)


@pytest.mark.parametrize(("by_s", "is_named"), [(0.1, True), (1.0, False)])
def test_what_follows_by_a_second_is_no_suspension(by_s: float, is_named: bool) -> None:
    told = answered(found(leaning(by_s)))
    assert [cause.effect for cause in told.causes] == (["suspension_roll"] if is_named else [])
    if is_named:
        return
    assert told.verdict == "unexplained"
    shape = next(shape for shape in told.unlisted if shape.shape == "k*ay, slowly")
    assert (shape.channel, shape.coefficient.unit) == ("accel_y", "1")
    assert shape.coefficient.value == pytest.approx(9.80665 * PER_MPS2, rel=0.5)


@pytest.mark.parametrize(
    ("effect", "gradient", "channel", "course", "road"),
    [
        ("suspension_roll", "roll_gradient_rad_per_mps2", "accel_y", "ay", "road_bank"),
        ("suspension_pitch", "pitch_gradient_rad_per_mps2", "accel_x", "ax", "road_grade"),
    ],
)
def test_it_has_to_be_slow_for_sure(effect: str, gradient: str, channel: str, course: str, road: str) -> None:
    number, share = INDEX[f"{effect}.{gradient}"], INDEX[f"{effect}.frequency_share"]

    def late(value: float, std: float, effects: tuple[str, ...] = (effect,), columns: Any = (number, share)) -> Any:
        x = nothing()
        x[[number, share]] = 0.01, value
        return leans_late(SimpleNamespace(effects=effects, columns=columns, x=x, std=np.array([0.001, std])))  # type: ignore[arg-type]

    (shape,) = late(-0.6, 0.04).values()
    assert (shape.channel, shape.shape) == (channel, f"k*{course}, slowly")
    assert shape.coefficient.value == pytest.approx(0.0980665)
    assert shape.coefficient.std == pytest.approx(0.00980665)
    assert with_their_roads(late(-0.6, 0.04)) == {effect, road}
    # Hardly told, or as slow as a soft car, or faster than any.
    assert late(-0.6, 0.06) == late(-0.45, 0.01) == late(0.9, 0.1) == {}
    assert late(-0.6, 0.04, effects=()) == late(-0.6, 0.04, columns=(number,)) == {}
