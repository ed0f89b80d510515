"""The loop's promises: live equals replay row for row, and a resumed loop goes on as if never stopped."""

from __future__ import annotations

import copy
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.core.parameters import Car
from dsz_daemon.core.state import as_plain, from_plain
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.loop import Loop, LoopSettings
from dsz_daemon.pipeline.mapping import Sample
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

CAR = Car(1673, 2850, 1.149, 1.491, 1.585, 1.586, 62000, 68000, True, False, 0.008, 0.004)
TUNING = EstimatorSettings().tuning()
ROLES = (*IMU_CHANNELS, *WHEEL_SPEEDS, "road_wheel_angle", "brake")
START_NS = 1_700_000_000_000_000_000


class RoleDecoder:
    """A stand-in for the DBC: the frame's id is the role's number, its 8 bytes a float; NaN is refused."""

    rejected = 0

    def decode(self, frame: Frame) -> list[Sample]:
        if frame.can_id >= len(ROLES):
            return []
        value = float(np.frombuffer(frame.data, dtype="<f8")[0])
        self.rejected += math.isnan(value)
        return [] if math.isnan(value) else [Sample(frame.t_ns, ROLES[frame.can_id], value)]


def new_loop(decoder: RoleDecoder | None = None) -> Loop:
    return Loop(CAR, TUNING, LoopSettings(), decoder or RoleDecoder(), frozenset(ROLES))


@st.composite
def recordings(draw: st.DrawFn) -> list[Frame]:
    """Half a second to some seconds of frames: jittery, late ones, gaps, unwanted ids."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(50, 400))
    steps_ms = rng.exponential(2.0, count)
    if draw(st.booleans()):
        steps_ms[rng.integers(0, count)] = draw(st.sampled_from([300.0, 999.0, 1001.0, 2500.0, 60000.0]))
    stamps = START_NS + np.cumsum(steps_ms * 1e6).astype(np.int64)
    if draw(st.booleans()):  # a little disorder
        stamps[1::7] -= 3_000_000
    if draw(st.booleans()):  # a clock that is set back
        stamps[count // 2 :] -= 5_000_000_000
    truth = {"accel_z": 9.8, **dict.fromkeys(WHEEL_SPEEDS, 15.0)}
    frames = []
    for t_ns in stamps:
        can_id = int(rng.integers(0, len(ROLES) + 3))
        value = truth.get(ROLES[can_id] if can_id < len(ROLES) else "", 0.0) + rng.normal(0.0, 0.05)
        value = math.nan if rng.random() < 0.1 else value
        frames.append(Frame(int(t_ns), "can0", can_id, np.float64(value).tobytes()))
    return frames


def replayed(frames: list[Frame]) -> list[object]:
    loop = new_loop()
    rows = [row for frame in frames for row in loop.frame(frame)]
    return [*rows, *loop.finish()]


def same(a: object, b: object) -> bool:
    return repr(a) == repr(b)  # NaN equals itself, and every bit of a float shows


@given(recordings(), st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_a_clock_that_ticks_in_between_changes_no_row(frames: list[Frame], seed: int) -> None:
    """Live: the clock brings ticks due before the next frame is there. Replay: the next frame does."""
    loop, rows, rng = new_loop(), [], np.random.default_rng(seed)
    for index, frame in enumerate(frames):
        rows += loop.frame(frame)
        later = frames[index + 1].t_ns if index + 1 < len(frames) else frame.t_ns
        # The clock can't be ahead of a frame still to come (that one would be late, which is another matter).
        now_ns = frame.t_ns + int(rng.integers(0, 11)) * (later - 1 - frame.t_ns) // 10
        stamps_to_come = [other.t_ns for other in frames[index + 1 :]]
        if stamps_to_come and min(stamps_to_come) > now_ns >= frame.t_ns:
            rows += loop.advance(now_ns)
    rows += loop.finish()
    expected = replayed(frames)
    # At the end the clock may have gone on past the last sample; a replay stops there.
    assert same(rows[: len(expected)], expected)
    assert all(row.t_ns > loop.memory.last_sample_ns for row in rows[len(expected) :])


@given(recordings(), st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_saving_and_resuming_equals_never_stopping(frames: list[Frame], where: float) -> None:
    cut = int(where * len(frames))
    decoder = RoleDecoder()  # its counters are saved and resumed by itself
    loop = new_loop(decoder)
    rows = [row for frame in frames[:cut] for row in loop.frame(frame)]
    memory = copy.deepcopy(loop.memory)
    memory.estimator = from_plain(json.loads(json.dumps(as_plain(memory.estimator))))
    resumed = new_loop(decoder)
    resumed.memory = memory
    rows += [row for frame in frames[cut:] for row in resumed.frame(frame)]
    assert same([*rows, *resumed.finish()], replayed(frames))


@given(recordings())
@settings(max_examples=25, deadline=None)
def test_ticks_lie_on_the_grid_once_and_in_order(frames: list[Frame]) -> None:
    rows = replayed(frames)
    stamps = [row.t_ns for row in rows]
    assert all(t_ns % 10_000_000 == 0 for t_ns in stamps)
    for row, before in zip(rows[1:], rows, strict=False):
        assert row.t_ns == before.t_ns + 10_000_000 or row.event in {"gap", "clock_step"}


@pytest.mark.parametrize("rate_hz", [20.0, 30.0, 100.0, 333.0, 500.0])
def test_any_rate_covers_the_recording(rate_hz: float) -> None:
    frames = [Frame(START_NS + i * 5_000_000, "can0", i % len(ROLES), np.float64(1.0).tobytes()) for i in range(401)]
    loop = Loop(CAR, TUNING, LoopSettings(rate_hz=rate_hz), RoleDecoder(), frozenset(ROLES))
    rows = [row for frame in frames for row in loop.frame(frame)]
    rows += loop.finish()
    assert abs(len(rows) - 2.0 * rate_hz) <= 1.0


def test_bad_plain_states_are_refused_by_name() -> None:
    plain = as_plain(new_loop().memory.estimator)
    del plain["gyro_x"]["correction"]
    with pytest.raises(ValueError, match=r"state\.gyro_x: expected the fields correction"):
        from_plain(plain)
    plain = as_plain(new_loop().memory.estimator)
    plain["speed"]["rest_s"] = "no"
    with pytest.raises(ValueError, match=r"state\.speed\.rest_s: 'no' is not a number"):
        from_plain(plain)
