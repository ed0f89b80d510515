"""diagnose: wheels that spin or slide are said, with when and by how much, and no slip is fitted to that."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON
from test_diagnose_choices import N, T

from dsz_daemon.diagnose import Diagnosed, diagnose
from dsz_daemon.diagnose.effects.vocabulary import vocabulary
from dsz_daemon.diagnose.faults.spinning import rolling_rows, spinning
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.recordings.recording import Recording
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import Floats, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.answer import answered
from dsz_daemon.diagnose.verdict.said import Diagnosis
from dsz_daemon.pipeline.grid import Signal

RATIO = 16.0
STAMPS = (1e7 * np.arange(N)).astype(np.int64)
# Up and down between 5 and 15 m/s in 20 s: up to 1.6 m/s2 either way, and steered a little.
V = 10.0 - 5.0 * np.cos(2.0 * np.pi * T / 20.0)
HAND = 0.3 * np.sin(2.0 * np.pi * T / 7.0)
# In the middle of each time it gains speed, and loses it.
GAINS, LOSES = (np.abs(T % 20.0 - middle_s) < 0.5 for middle_s in (5.0, 15.0))


def said_of(share: Floats, slip_per_force: float = 0.0) -> Diagnosed:
    """A front-driven car whose front wheels turn by a `share` faster than they roll."""
    rng = np.random.default_rng(1)
    recording = Recording(T, HAND / RATIO, np.tile(V[:, None], (1, 4)), np.zeros((N, 6)), np.full(10, 1e-3))
    words = vocabulary()
    x = nothing(words)
    x[words.columns_of("wheel_slip")[0]] = slip_per_force
    shown = predicted(drive_of(recording, TUCSON, RATIO), x, flat(N))
    names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    signals = {name: Signal(STAMPS, shown[:, c] + rng.normal(0.0, 0.004, N)) for c, name in enumerate(names)}
    fronts = {"fl": shown[:, 6] + share * V, "fr": shown[:, 7] + share * V}
    wheels = fronts | {"rl": V - 0.5 * shown[:, 8], "rr": V + 0.5 * shown[:, 8]}
    signals |= {f"wheel_speed_{which}": Signal(STAMPS, v + rng.normal(0.0, 0.01, N)) for which, v in wheels.items()}
    return diagnose(signals | {"steering_wheel_angle": Signal(STAMPS, HAND)}, TUCSON, RATIO)


@pytest.mark.parametrize(("share", "middle_s"), [(0.2, 5.0), (-0.3, 15.0)])
def test_wheels_that_spin_or_slide_are_said_and_nothing_else(share: float, middle_s: float) -> None:
    found = said_of(share * (GAINS if share > 0.0 else LOSES))
    assert (found.said.verdict, found.said.causes, found.said.parameter_errors) == ("unexplained", [], [])
    times = np.arange(middle_s, T[-1], 20.0)
    for wheel in ("fl", "fr"):
        mine = [shape for shape in found.said.unlisted if shape.channel == f"wheel_speed_{wheel}"]
        assert len(mine) == len(times)
        for shape, time_s in zip(mine, times, strict=True):
            start_s, end_s = (float(word) for word in shape.shape.removeprefix("k*vx from ").split()[::2])
            assert (start_s, end_s) == (pytest.approx(time_s - 0.5, abs=0.15), pytest.approx(time_s + 0.5, abs=0.15))
            assert shape.coefficient.value == pytest.approx(share, abs=0.02)
    assert len(found.said.unlisted) == 2 * len(times)
    # What they show then is compared with nothing; all else is.
    rows = found.search.rows
    spun = (GAINS if share > 0.0 else LOSES)[rows.at]
    assert not rows.used[spun, 6:8].any()
    assert rows.used[spun, :6].all()
    assert rows.used[~spun, 6:8].mean() > 0.8


def test_wheels_that_are_faster_while_a_car_slows_or_a_little_or_for_a_moment_do_not_spin() -> None:
    for share in (0.2 * LOSES, 0.08 * GAINS, 0.2 * (np.abs(T % 20.0 - 5.0) < 0.05)):
        found = said_of(np.asarray(share))
        assert not any(" from " in shape.shape for shape in found.said.unlisted)
        assert found.search.rows.used[:, 6:8].mean() > 0.9


def test_what_is_missing_while_a_wheel_spins_is_no_number() -> None:
    recording = Recording(T, HAND / RATIO, np.tile(V[:, None], (1, 4)), np.zeros((N, 6)), np.full(10, 1e-3))
    drive = drive_of(recording, TUCSON, RATIO)
    shown = predicted(drive, nothing(), flat(N))
    shown[:, 6] += 0.2 * V * GAINS
    shown[(np.abs(T - 5.0) < 0.1), 6] = np.nan
    drive = drive._replace(measured=shown)
    rows = rows_of(drive)
    shapes = spinning(drive, rows, fitted(drive, rolling_rows(drive, rows), nothing(), (), {}))
    assert {shape.channel for shape in shapes} == {"wheel_speed_fl"}
    assert all(shape.coefficient.value == pytest.approx(0.2, abs=0.02) for shape in shapes)


def test_a_slip_that_goes_with_the_force_is_one_however_large() -> None:
    found = said_of(np.zeros(N), slip_per_force=0.5)
    assert [cause.effect for cause in found.said.causes] == ["wheel_slip"]
    assert found.said.causes[0].parameters["slip_per_force"].value == pytest.approx(0.5, rel=0.1)
    assert found.said.unlisted == []
    # Though what was fitted had been without it.
    assert not found.search.rows.used[:, 6:8].all()


def test_what_is_fitted_and_not_said_improves_no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    said = said_of(np.zeros(N), slip_per_force=0.05).said
    [cause] = said.causes
    assert said.fit["wheel_speed_fl"].train.after < 0.5 * said.fit["wheel_speed_fl"].train.before

    def without_a_name(*given: Any) -> Diagnosis:
        return answered(*given)._replace(causes=[])

    monkeypatch.setattr("dsz_daemon.diagnose.answered", without_a_name)
    found = said_of(np.zeros(N), slip_per_force=0.05)
    assert cause.effect not in found.search.best.effects
    for channel, fit in found.said.fit.items():
        assert fit.train.after == fit.train.before == said.fit[channel].train.before
        assert fit.held_out.after == fit.held_out.before
