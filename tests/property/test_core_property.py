"""The core under any input: bad input never moves an offset, resuming never shows, numbers stay numbers."""

from __future__ import annotations

import json
import math
from functools import cache

from hypothesis import given, settings
from hypothesis import strategies as st

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.core.parameters import Car, Inputs
from dsz_daemon.core.state import EstimatorState, as_plain, from_plain, initial_state
from dsz_daemon.core.step import step
from dsz_daemon.signals import IMU_CHANNELS

CAR = Car(1673.0, 2850.0, 1.149, 1.491, 1.585, 1.586, 62000.0, 68000.0, True, False, 0.008, 0.004)
TUNINGS = {printed: EstimatorSettings(as_printed=printed).tuning() for printed in (False, True)}
NAN = math.nan


def value(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


# What the decoder lets through: the ranges of `signals.py`.
READINGS = st.builds(
    Inputs,
    *[value(-35.0, 35.0)] * 3,
    *[value(-160.0, 160.0)] * 3,
    *[value(-30.0, 120.0)] * 4,
    value(-1.2, 1.2),
    *[st.sampled_from([0.0, 1.0])] * 3,
)
# A drive that opens gates, so that there is something to learn.
CALM = st.builds(
    Inputs,
    *[value(-0.05, 0.05)] * 3,
    *[value(-0.5, 0.5)] * 2,
    value(9.3, 10.3),
    *[value(19.9, 20.1)] * 4,
    value(-0.005, 0.005),
    *[st.just(0.0)] * 3,
)
MASKS = st.lists(st.booleans(), min_size=14, max_size=14)
ROWS = st.lists(st.tuples(st.one_of(CALM, CALM, READINGS), MASKS, st.sampled_from([0.002, 0.01, 0.05])), max_size=30)


def masked(inputs: Inputs, mask: list[bool]) -> Inputs:
    return Inputs(*[NAN if hidden else x for x, hidden in zip(inputs, mask, strict=True)])


@cache
def warm(printed: bool) -> EstimatorState:
    """After 40 s of straight road with offsets: gates are open, everything has moved."""
    tuning, state = TUNINGS[printed], initial_state(TUNINGS[printed])
    row = Inputs(0.01, -0.02, 0.005, 0.1, -0.2, 9.9, 20.0, 20.0, 20.0, 20.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(800):
        state, _ = step(CAR, tuning, state, row, 0.05)
    return state


def test_the_warm_state_has_open_gates() -> None:
    """Or the properties below would hold for want of anything to break."""
    row = Inputs(0.01, -0.02, 0.005, 0.1, -0.2, 9.9, 20.0, 20.0, 20.0, 20.0, 0.0, 0.0, 0.0, 0.0)
    for printed in (False, True):
        _, output = step(CAR, TUNINGS[printed], warm(printed), row, 0.01)
        assert all(channel.gate for channel in output.channels)
        assert all(channel.offset != 0.0 for channel in output.channels)


@settings(max_examples=120, deadline=None, derandomize=True)
@given(ROWS, st.booleans())
def test_an_offset_moves_only_where_its_channel_has_a_reading(rows, printed: bool) -> None:
    tuning, state = TUNINGS[printed], warm(printed)
    for readings, mask, dt_s in rows:
        inputs = masked(readings, mask)
        after, output = step(CAR, tuning, state, inputs, dt_s)
        for k, name in enumerate(IMU_CHANNELS):
            old, new = state[k], after[k]
            assert all(math.isfinite(x) for x in new)
            if math.isnan(inputs[k]):
                assert new == old._replace(variance=new.variance), name
                assert new.variance >= old.variance
                assert not output[k].gate
            if not output[k].gate:
                assert new.correction == old.correction
            assert output[k].offset == -new.correction
        state = after


@settings(max_examples=80, deadline=None, derandomize=True)
@given(ROWS)
def test_no_input_leaves_anything_but_numbers_in_the_memory(rows) -> None:
    """NaN stands only where it means "nothing yet": in the windows and the smoothed yaw rate."""
    tuning, state = TUNINGS[False], initial_state(TUNINGS[False])
    for readings, mask, dt_s in rows:
        state, output = step(CAR, tuning, state, masked(readings, mask), dt_s)
        for part in (state.speed, state.observer, state.attitude, state.stiffness[:9]):
            assert all(math.isfinite(x) for x in part)
        assert all(math.isfinite(x) for x in (*state.transient.mean, *state.transient.square))
        assert all(channel.offset_std > 0.0 for channel in output.channels)
        assert output.tau >= 0.0


@settings(max_examples=60, deadline=None, derandomize=True)
@given(ROWS, st.integers(0, 30), st.booleans())
def test_saving_and_resuming_anywhere_equals_never_stopping(rows, stop: int, printed: bool) -> None:
    tuning = TUNINGS[printed]
    never = stopped = warm(printed)
    for k, (readings, mask, dt_s) in enumerate(rows):
        if k == stop:
            stopped = from_plain(json.loads(json.dumps(as_plain(stopped))))
        inputs = masked(readings, mask)
        never, said = step(CAR, tuning, never, inputs, dt_s)
        stopped, again = step(CAR, tuning, stopped, inputs, dt_s)
        assert repr(again) == repr(said)
    assert repr(stopped) == repr(never)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(CALM, st.floats(0.002, 0.025))
def test_one_step_of_2_dt_is_two_of_dt(inputs: Inputs, dt_s: float) -> None:
    """A calm tick from a warm state. Gyros: to the fading of their start's density.

    Accelerometers' targets hold derivatives (v' over 0.2 s, the observer's over 1/5 s) that change within
    the tick; taken at its end they differ by their change times 2 dt / 0.2 s, of which the law takes a
    share below 2 dt / 10 s. CALM changes v' by at most 0.2 / 0.2 = 1 m/s^2, and a_y's reference by some 5:
    readings up to 0.7 m/s^2 and 0.06 rad/s * 20 m/s through gains of order 1.
    """
    tuning, start = TUNINGS[False], warm(False)
    once, _ = step(CAR, tuning, start, inputs, 2.0 * dt_s)
    half, _ = step(CAR, tuning, start, inputs, dt_s)
    twice, _ = step(CAR, tuning, half, inputs, dt_s)
    off = [abs(twice[k].correction - once[k].correction) for k in range(6)]
    one_order = 2.0 * dt_s / 10.0 * 2.0 * dt_s / 0.2
    assert max(off[:3]) <= 1e-8
    assert off[3] <= 1e-6 + 1.0 * one_order
    assert off[4] <= 1e-6 + 5.0 * one_order
    assert off[5] <= 1e-6 + 1.0 * one_order
    for k in range(6):
        assert abs(twice[k].driven_s - once[k].driven_s) <= 1e-9
        assert abs(twice[k].variance / once[k].variance - 1.0) <= 1e-5
    assert abs(twice.observer.sideslip_rad - once.observer.sideslip_rad) <= 1e-3
