"""core/doubt: a leap at a standstill is held, said, bounded and, if it stays, believed. Expected values by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_cases import DEFAULTS, drive, law, straight

from dsz_daemon.core import doubt, zeroing
from dsz_daemon.core.outputs import ChannelState, Reason, StepOutput
from dsz_daemon.core.parameters import DoubtTuning, ZeroingTuning
from dsz_daemon.core.state import EstimatorState
from dsz_daemon.core.zeroing import ZeroingState

DEG = math.pi / 180.0
# P = 0.06 and S/(2 look) = 0.1 / (2 * 1.25) = 0.04: sigma sqrt(0.1), and three of them are sqrt(0.9).
TUNING = DoubtTuning(sigmas=3.0, look_s=1.25, wait_s=8.0, memory_s=50.0)
KNOWN = ZeroingState(2.0, 0.06)
LIMIT = math.sqrt(0.9)


def looks(state: ZeroingState, target: float, seconds: float, tuning: ZeroingTuning, steps: int = 1) -> doubt.Look:
    look = doubt.Look(state, True)
    for _ in range(steps):
        look = doubt.looked(look.state, target, tuning, TUNING, seconds / steps)
    return look


def test_the_look_is_a_first_order_lag_of_what_the_reading_is_off() -> None:
    """d = (target - e)(1 - exp(-t / look)), in one step and in many."""
    for steps in (1, 40):
        state = looks(KNOWN, 2.5, 2.0, law(), steps).state
        assert state.departure == pytest.approx(0.5 * (1.0 - math.exp(-2.0 / 1.25)), rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limit_is_so_many_spreads_of_the_look(sign: float) -> None:
    settled = KNOWN._replace(departure=sign * LIMIT * 0.999)
    assert looks(settled, 2.0 + sign * LIMIT * 0.999, 0.1, law()).believed
    beyond = KNOWN._replace(departure=sign * LIMIT * 1.001)
    assert not looks(beyond, 2.0 + sign * LIMIT * 1.001, 0.1, law()).believed
    # Less sure of the offset, more is believed: P = 0.16 has sqrt(1.8).
    assert looks(beyond._replace(variance=0.16), 2.0 + sign * 1.3, 0.1, law()).believed
    # What was neglected is in the spread as well, as its square: 0.06 + 0.1 the same.
    assert looks(beyond._replace(neglected=-math.sqrt(0.1)), 2.0 + sign * 1.3, 0.1, law()).believed


def test_a_doubted_reading_widens_the_published_spread_to_cover_it() -> None:
    look = looks(KNOWN._replace(departure=3.0), 5.0, 1.0, law())
    assert not look.believed
    assert (look.state.correction, look.state.variance) == (2.0, 0.06)
    assert zeroing.offset_std(look.state, law()) == pytest.approx(math.sqrt(0.06 + 9.0), rel=1e-12)
    # Back where it was, nothing of it is left once the look has seen that.
    calm = looks(look.state, 2.0, 20.0, law())
    assert calm.believed
    assert zeroing.offset_std(calm.state, law()) == pytest.approx(math.sqrt(0.06), rel=1e-12)


def test_what_lasts_is_believed_but_stays_contradicted_for_a_while() -> None:
    far = KNOWN._replace(departure=3.0)
    waiting = looks(far, 5.0, 7.9, law(), 79)
    assert not waiting.believed
    patient = looks(waiting.state, 5.0, 0.1, law(), 1)
    assert patient.believed
    assert patient.state.variance == pytest.approx(0.06 + 9.0, rel=1e-9)
    assert patient.state.contradiction == pytest.approx(9.0, rel=1e-9)
    later = looks(patient.state._replace(correction=5.0, variance=0.01), 5.0, 25.0, law(), 250)
    # The spread of two readings that contradict each other: 3, after half the memory 3 exp(-1/2).
    assert math.sqrt(later.state.contradiction) == pytest.approx(3.0 * math.exp(-0.5), rel=1e-9)
    assert zeroing.offset_std(later.state, law()) == pytest.approx(math.sqrt(0.01 + 9.0 * math.exp(-1.0)), rel=1e-9)


def test_a_doubt_that_comes_and_goes_waits_for_as_long_as_it_was_there() -> None:
    there = looks(KNOWN._replace(departure=3.0), 5.0, 5.0, law(), 50).state
    gone = looks(there._replace(departure=0.0), 2.0, 2.0, law(), 20).state
    assert (there.doubted_s, gone.doubted_s) == (pytest.approx(5.0), pytest.approx(3.0))


def test_the_variance_grows_to_the_largest_offset_at_most() -> None:
    narrow = law(prior_std=1.0, largest_offset=4.0)
    state = looks(KNOWN._replace(departure=7.0, doubted_s=7.95), 9.0, 0.1, narrow).state
    assert state.variance == 16.0


def test_nothing_to_look_at_is_no_doubt() -> None:
    state = looks(KNOWN._replace(departure=3.0), 5.0, 1.0, law()).state
    assert doubt.unlooked(state._replace(contradiction=1.0)) == KNOWN._replace(contradiction=1.0)


# --- in the estimator ---------------------------------------------------------------------------


def stood(seconds: float, bias: float, state: EstimatorState | None = None) -> tuple[EstimatorState, list[StepOutput]]:
    """Stands with gyros that read `bias` deg/s and the noise of Table 1 at 50 Hz, 0.03 deg/s/sqrt(Hz)."""
    noise = np.random.default_rng(5).normal(0.0, 0.03 * math.sqrt(25.0), (round(seconds / 0.02) + 1, 3))

    def reading(t_s: float) -> object:
        x, y, z = (bias + noise[round(t_s / 0.02)]) * DEG
        return straight(0.0, gyro_x=x, gyro_y=y, gyro_z=z)

    return drive(reading, seconds, state=state)  # type: ignore[arg-type]


@pytest.mark.parametrize("leap", [1.0, -5.0, 20.0])
def test_half_a_minute_of_a_false_reading_moves_no_offset_beyond_its_spread(leap: float) -> None:
    state, learnt = stood(60.0, 1.0)
    before = learnt[-1].gyro_z
    assert before.state is ChannelState.CONVERGED
    state, faulty = stood(30.0, 1.0 + leap, state)
    for output in faulty:
        channel = output.gyro_z
        assert abs(channel.offset - before.offset) <= 2.0 * before.offset_std
    assert {output.gyro_z.reason for output in faulty[50:]} == {Reason.DOUBTED}
    assert faulty[-1].gyro_z.state is ChannelState.HOLDING
    assert faulty[-1].gyro_z.offset_std > 0.9 * abs(leap) * DEG
    _, after = stood(10.0, 1.0, state)
    assert after[-1].gyro_z.state is ChannelState.CONVERGED


def test_an_offset_that_really_moved_is_zeroed_after_the_wait() -> None:
    state, _ = stood(60.0, 1.0)
    _, moved = stood(DEFAULTS.doubt.wait_s + 10.0, -3.0, state)
    last = moved[-1].gyro_x
    assert last.offset == pytest.approx(-3.0 * DEG, abs=0.1 * DEG)
    assert last.offset_std > 3.0 * DEG  # for nothing tells which was false


def test_honest_noise_raises_no_doubt() -> None:
    """S is ten times the noise of Table 1: five sigma of it are some 16 of the noise's own."""
    _, outputs = stood(300.0, -2.0)
    assert {o.gyro_x.reason for o in outputs[100:]} == {Reason.NONE}


def test_as_printed_believes_everything() -> None:
    tuning = DEFAULTS._replace(as_printed=True)
    state, _ = drive(straight(0.0, gyro_x=1.0 * DEG), 60.0, tuning=tuning)
    _, outputs = drive(straight(0.0, gyro_x=9.0 * DEG), 10.0, tuning=tuning, state=state)
    assert outputs[-1].gyro_x.reason is Reason.NONE
