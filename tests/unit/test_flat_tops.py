"""diagnose: readings that stand at the end of what a sensor can say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_diagnose_choices import CITY_STEER, CITY_V, TOLERANCE, drive

from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.fit import exactly, fitted
from dsz_daemon.diagnose.fitting.gains import gained
from dsz_daemon.diagnose.fitting.limits import read_off
from dsz_daemon.diagnose.recordings.flat_tops import FlatTop, flat_top
from dsz_daemon.diagnose.recordings.recording import recorded, white_std
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.selection.guesses import guesses
from dsz_daemon.diagnose.selection.screening import screened
from dsz_daemon.diagnose.selection.smaller import share_of_all
from dsz_daemon.diagnose.selection.trials import Trial
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.pipeline.grid import Signal

STEP = 0.001
TIME_S = 0.01 * np.arange(6000)
LIMIT = INDEX["sensor_saturation.accel_limit_mps2"]


def reading(seed: int, noise: float = 0.01, limit: float = math.inf) -> np.ndarray:
    """A slow course with noise, clipped, as a converter with that resolution says it."""
    course = 3.2 * np.sin(0.3 * TIME_S) + np.random.default_rng(seed).normal(0.0, noise, len(TIME_S))
    return np.asarray(STEP * np.round(np.clip(course, -limit, limit) / STEP))


def held_back(values: np.ndarray) -> np.ndarray:
    held = values.copy()
    for i in np.flatnonzero(np.random.default_rng(3).random(len(values)) < 0.4)[1:]:
        held[i] = held[i - 1]
    return held


def top_of(values: np.ndarray, step: float = STEP) -> FlatTop | None:
    return flat_top(4, TIME_S[: len(values)], values, step, white_std(values))


def test_readings_that_stand_at_both_ends_are_seen_when_they_do() -> None:
    values = reading(1, limit=3.0)
    top = top_of(values)
    assert top is not None
    assert (top.channel, top.limit) == (4, pytest.approx(3.0))
    # By chance two readings are alike in about step / (2 sqrt(pi) sigma) of all cases.
    standing = np.count_nonzero(np.abs(values) > 2.9999)
    assert top.log_odds == pytest.approx(-standing * math.log(STEP / (2.0 * math.sqrt(math.pi) * 0.01)), rel=0.2)
    assert (np.abs(3.2 * np.sin(0.3 * top.at_s)) > 2.95).all()
    assert (np.sin(0.3 * top.at_s) < 0.0).any()
    assert (np.sin(0.3 * top.at_s) > 0.0).any()


@pytest.mark.parametrize("seed", range(20))
def test_what_nothing_clips_has_no_top(seed: int) -> None:
    assert top_of(reading(seed)) is None


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(1000),
        # Finer noise than the resolution: every gentle top stands still.
        reading(1, noise=0.0004),
        # Each reading is sent twice.
        np.repeat(reading(1)[::2], 2),
        np.where(TIME_S < 3.0, np.nan, reading(1, limit=3.0)),
        # The top of a slow course stands for 0.1 s where there is next to no noise, though all else hurries.
        reading(1, noise=0.0001),
        # Four of ten readings are the last one again.
        held_back(reading(1, limit=3.0)),
        # From one end to the other and back.
        np.where(np.arange(6000) % 50 < 10, 3.0 * (-1.0) ** np.arange(6000), 0.5 * reading(1)),
        # Three at the end, by chance.
        np.where(np.arange(6000) // 3 == 700, 3.3, reading(1)),
    ],
)
def test_where_readings_stand_still_anywhere_no_top_tells_anything(values: np.ndarray) -> None:
    assert top_of(values) is None


@pytest.mark.parametrize(
    ("channel", "reading_mps2", "limit"),
    [(5, 3.0, 3.0), (5, 9.2, 9.2), (5, 9.4, None), (5, 0.0, None), (5, -3.0, None), (4, 3.0, None)],
)
def test_less_of_gravity_than_there_is_all_the_way_is_a_limit(
    channel: int, reading_mps2: float, limit: float | None
) -> None:
    values = np.full(1000, reading_mps2)
    top = flat_top(channel, TIME_S[:1000], values, 0.0, 0.0)
    assert (None if top is None else top.limit) == limit
    values[500] += 0.1
    assert flat_top(channel, TIME_S[:1000], values, 0.0, 0.0) is None


def test_a_signal_without_a_resolution_has_no_top() -> None:
    assert top_of(reading(1, limit=3.0), 0.0) is None


def test_a_recording_knows_its_tops_with_their_channel() -> None:
    t_ns = np.round(TIME_S * 1e9).astype(np.int64) + 5_000_000_000
    steady = Signal(t_ns, np.full(len(t_ns), 10.0))
    one = {f"wheel_speed_{w}": steady for w in ("fl", "fr", "rl", "rr")}
    one |= {
        "steering_wheel_angle": steady,
        "gyro_z": Signal(t_ns, reading(2)),
        "accel_y": Signal(t_ns, reading(1, limit=3.0)),
    }
    tops = recorded(one, 16.0).tops
    assert tops[0].at_s[0] < 10.0
    assert [(top.channel, top.limit) for top in tops] == [(4, pytest.approx(3.0))]


def with_top(one: Drive, share: float, log_odds: float) -> Drive:
    """Readings of accel_y that stand when the simulation is furthest, at this share of where it is then."""
    course = np.abs(predicted(one, nothing(), flat(len(CITY_V)))[:, 4])
    at = np.argsort(course)[-30:]
    top = FlatTop(4, share * float(np.median(course[at])), log_odds, one.recording.time_s[at])
    return one._replace(recording=one.recording._replace(tops=(top,)))


@pytest.mark.parametrize(("share", "guessed"), [(0.97, True), (1.2, True), (1.3, False), (8.0, False)])
def test_a_limit_is_where_readings_stand_if_the_simulation_goes_near_it(share: float, guessed: bool) -> None:
    one = with_top(drive({}, CITY_V, CITY_STEER), share, 100.0)
    rows = rows_of(one)
    starts = dict(guesses(one, rows, fitted(one, rows, nothing(), (), TOLERANCE)))
    assert ("sensor_saturation" in starts) is guessed
    if guessed:
        assert starts["sensor_saturation"][LIMIT] == pytest.approx(one.recording.tops[0].limit)
        assert starts["sensor_saturation"][INDEX["sensor_saturation.gyro_limit_radps"]] == 0.0


def test_what_readings_tell_of_a_limit_is_gained_by_who_has_it_and_not_in_other_manoeuvres() -> None:
    plain = drive({}, CITY_V, CITY_STEER)
    told = with_top(plain, 1.0, 100.0)
    limit = told.recording.tops[0].limit
    rows = rows_of(plain)
    without = fitted(plain, rows, nothing(), (), TOLERANCE)
    clipped, elsewhere = without.x.copy(), without.x.copy()
    clipped[LIMIT], elsewhere[LIMIT] = 0.97 * limit, 1.1 * limit
    assert (read_off(told, clipped), read_off(told, elsewhere), read_off(told, without.x)) == (100.0, 0.0, 0.0)
    larger = without._replace(x=clipped)
    assert gained(told, without, larger) == pytest.approx(gained(plain, without, larger) + 100.0)
    assert gained(told, larger, without) == pytest.approx(gained(plain, larger, without) - 100.0)
    kind = next(iter(rows.together))
    assert gained(told, without, larger, kind=kind) == gained(plain, without, larger, kind=kind)


def test_what_was_guessed_is_judged_by_its_slopes_where_it_ends() -> None:
    one = drive({"sensor_saturation.accel_limit_mps2": 1.5, "accel_scale.y": 0.03}, CITY_V, CITY_STEER)
    rows = rows_of(one)
    best = fitted(one, rows, nothing(), (), TOLERANCE)
    trial = Trial(one, rows, best, TOLERANCE, screened(one, rows, best, TOLERANCE, map).known)
    start = dict(guesses(one, rows, best))["sensor_saturation"]
    step = trial.fit((("sensor_saturation",), start))
    np.testing.assert_array_equal(step.fit.unseen, exactly(one, rows, step.fit, TOLERANCE).unseen)
    other = trial.fit((("accel_scale",), best.x)).fit
    assert (other.unseen != exactly(one, rows, other, TOLERANCE).unseen).any()


def test_that_a_sensor_clips_asks_no_more_of_what_comes_beside_it() -> None:
    assert share_of_all({"sensor_saturation": 9e4, "wheel_slip": 2000.0}) == pytest.approx(30.0)


def test_a_limit_that_readings_tell_is_as_sure_as_they_are() -> None:
    """Where the simulation does not go, it does not tell the limit."""
    plain = drive({}, CITY_V, CITY_STEER)
    told = plain._replace(recording=plain.recording._replace(tops=(FlatTop(5, 7.0, 50.0, TIME_S),)))
    rows, start = rows_of(plain), nothing()
    start[LIMIT] = 7.0
    stds = []
    for one in (plain, told):
        fit = fitted(
            one, rows._replace(used=rows.used & (np.arange(13) != 5)), start, ("sensor_saturation",), TOLERANCE
        )
        assert fit.x[LIMIT] == pytest.approx(7.0)
        stds.append(fit.std[fit.columns.index(LIMIT)])
    assert stds[0] > 10.0
    assert stds[1] == pytest.approx(0.14)


def test_a_limit_stays_where_readings_stand() -> None:
    """They clip at 1.5, and are said to stand at 1.4: the fit would go to 1.5."""
    plain = drive({"sensor_saturation.accel_limit_mps2": 1.5}, CITY_V, CITY_STEER)
    told = plain._replace(recording=plain.recording._replace(tops=(FlatTop(4, 1.4, 50.0, TIME_S[:5]),)))
    rows, start = rows_of(plain), nothing()
    start[LIMIT] = 1.4
    free, held = (fitted(one, rows, start, ("sensor_saturation",), TOLERANCE) for one in (plain, told))
    assert free.x[LIMIT] == pytest.approx(1.5, rel=0.01)
    assert held.x[LIMIT] == pytest.approx(1.045 * 1.4, rel=1e-6)
    assert read_off(told, held.x) == 50.0


def test_where_a_gyro_stands_is_no_limit_of_an_accelerometer() -> None:
    plain = drive({}, CITY_V, CITY_STEER)
    one = plain._replace(recording=plain.recording._replace(tops=(FlatTop(2, 3.0, 50.0, TIME_S[:5]),)))
    x = nothing()
    x[LIMIT] = 3.0
    assert read_off(one, x) == 0.0
    x[INDEX["sensor_saturation.gyro_limit_radps"]] = 3.0
    assert read_off(one, x) == 50.0
