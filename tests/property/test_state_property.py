"""The state file under any bytes and any values: loaded exactly, or not at all, and never out of range."""

from __future__ import annotations

import json
import math
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from dsz_daemon.core.outputs import ChannelState
from dsz_daemon.core.parameters import Inputs
from dsz_daemon.core.reachable import unreachable_stiffness, unreachable_zeroing
from dsz_daemon.core.state import EstimatorState, as_plain, from_plain, initial_state, resumed
from dsz_daemon.core.step import step
from dsz_daemon.edge.boot import Boot
from dsz_daemon.edge.state_file import MAX_BYTES, decoded, encoded, load, save
from dsz_daemon.runs.memory import recalled, remembered
from dsz_daemon.runs.setup import Setup, set_up
from dsz_daemon.signals import GYRO_CHANNELS, IMU_CHANNELS

CONFIG = Path(__file__).parents[1] / "golden" / "sine_steer" / "config.yaml"
NOW_NS = 1_772_323_200_000_000_000
BOOT = Boot("one", 1_000_000_000_000)

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | NUMBERS | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=20,
)
BODIES = st.dictionaries(st.text(max_size=8), PLAIN, max_size=5)
# What a forger may put in a number's place.
ANYTHING = st.one_of(
    NUMBERS,
    st.sampled_from([0.0, -0.0, 5e-324, 1e-300, 1e300, sys.float_info.max, math.nan, math.inf, -math.inf]),
    st.sampled_from([10**400, -(10**5000), 2**63, True, None, "", "1.0", [], {}, [[[]]], [1.0] * 8]),
)


@cache
def setup() -> Setup:
    return set_up(CONFIG)


@cache
def learnt() -> EstimatorState:
    """After half a minute of straight road."""
    tuning, car = setup().settings.estimator.tuning(), setup().settings.vehicle.car()
    state = initial_state(tuning)
    row = Inputs(0.01, -0.02, 0.005, 0.1, -0.2, 9.9, 20.0, 20.0, 20.0, 20.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(640):
        state, _ = step(car, tuning, state, row, 0.05)
    return state


@cache
def whole_file() -> bytes:
    return encoded(remembered(setup(), learnt(), NOW_NS, 21.0, BOOT))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(BODIES)
def test_any_body_comes_back_to_the_last_bit(body: dict[str, Any]) -> None:
    data = encoded(body)
    again = decoded(data)
    assert json.dumps(again, sort_keys=True) == json.dumps(body, sort_keys=True)
    assert encoded(again) == data


@settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(BODIES, min_size=1, max_size=4))
def test_the_last_body_that_was_saved_is_loaded(tmp_path: Path, bodies: list[dict[str, Any]]) -> None:
    path = tmp_path / "offsets.json"
    for body in bodies:
        save(path, encoded(body))
    assert load(path) == (bodies[-1], (), "current")


def spoilt(data: bytes, edits: list[tuple[str, int, bytes]]) -> bytes:
    for kind, place, piece in edits:
        at = place % (len(data) + 1)
        if kind == "cut":
            data = data[:at]
        elif kind == "insert":
            data = data[:at] + piece + data[at:]
        elif kind == "overwrite":
            data = data[:at] + piece + data[at + len(piece) :]
        elif kind == "remove":
            data = data[:at] + data[at + len(piece) :]
        else:
            data = data[:at] + data[: len(data) - at]
    return data


EDITS = st.lists(
    st.tuples(
        st.sampled_from(["cut", "insert", "overwrite", "remove", "shuffle"]),
        st.integers(0, 10_000),
        st.binary(min_size=1, max_size=8)
        | st.sampled_from(
            [b"0", b"-", b"e9", b"NaN", b"1e999", b'"', b"}", b"[", b"[" * 3000, b'{"body":', b"\0" * 512]
        ),
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=800, deadline=None, derandomize=True)
@given(EDITS)
def test_whatever_is_done_to_a_file_is_noticed(edits: list[tuple[str, int, bytes]]) -> None:
    data = spoilt(whole_file(), edits)
    assume(data != whole_file())
    with pytest.raises(ValueError, match=r"^(is|has|does) .{5,200}$"):
        decoded(data)


@settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.binary(max_size=300) | EDITS.map(lambda edits: spoilt(whole_file(), edits)[: 2 * MAX_BYTES]))
def test_whatever_lies_in_its_place_is_set_aside_and_the_rest_goes_on(tmp_path: Path, data: bytes) -> None:
    assume(data != whole_file())
    path = tmp_path / "offsets.json"
    for other in tmp_path.iterdir():
        other.unlink()
    save(path, encoded({"n": 1}))
    save(path, encoded({"n": 2}))
    path.write_bytes(data)
    loaded = load(path)
    assert loaded.body == {"n": 1}
    assert len(loaded.said) == 2
    assert (tmp_path / "offsets.json.bad1").read_bytes() == data


def places(plain: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Where something stands in a body, at any depth."""
    inner = (
        [place for key, item in plain.items() for place in places(item, (*path, key))]
        if isinstance(plain, dict)
        else []
    )
    return [path, *inner] if path else inner


PLACES = places(remembered(setup(), initial_state(setup().settings.estimator.tuning()), NOW_NS, 21.0, BOOT))


@settings(max_examples=500, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(PLACES), ANYTHING | PLAIN), min_size=1, max_size=4), st.integers(0, 2**62))
def test_a_forged_body_never_raises_and_stays_in_range(
    forgeries: list[tuple[tuple[str, ...], Any]], since_ns: int
) -> None:
    body = remembered(setup(), learnt(), NOW_NS, 21.0, BOOT)
    for place, value in forgeries:
        inner: Any = body
        for key in place[:-1]:
            inner = inner.get(key) if isinstance(inner, dict) else None
        if isinstance(inner, dict):
            inner[place[-1]] = value
    recall = recalled(setup(), body, NOW_NS + since_ns, Boot("two", 1))
    assert all(len(words) < 600 for words in recall.said)
    assert math.isfinite(recall.age_s)
    assert recall.age_s >= 0.0
    if recall.estimator is not None:
        is_in_range(recall.estimator)


def is_in_range(state: EstimatorState) -> None:
    """What is taken over is believable, and the estimator can go on with it."""
    tuning, car = setup().settings.estimator.tuning(), setup().settings.vehicle.car()
    for name in IMU_CHANNELS:
        law = getattr(tuning, name)
        assert unreachable_zeroing(getattr(state, name), law, 1.0, tuning.block_s) == ""
        assert abs(getattr(state, name).correction) <= law.largest_offset
    assert unreachable_stiffness(state.stiffness, tuning) == ""
    row = Inputs(0.01, -0.02, 0.005, 0.1, -0.2, 9.9, 20.0, 20.0, 20.0, 20.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(3):
        state, output = step(car, tuning, state, row, 0.01)
    assert all(channel.state != ChannelState.INVALID for channel in output.channels)
    assert all(math.isfinite(channel.offset) and channel.offset_std > 0.0 for channel in output.channels)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(st.floats(-30.0, 30.0), st.floats(0.02, 0.7)), min_size=3, max_size=3),
    st.lists(st.tuples(st.floats(-6.0, 6.0), st.floats(0.06, 0.99)), min_size=3, max_size=3),
    st.floats(0.0, 1e7),
)
def test_what_is_recalled_is_what_was_remembered_and_less_sure_by_its_age(
    gyros: list[tuple[float, float]], accels: list[tuple[float, float]], away_s: float
) -> None:
    """The offset to the last bit; P by hand: + (parked (1 - e^-t/T))^2, + Q t, up to the prior's."""
    state, tuning, service = learnt(), setup().settings.estimator.tuning(), setup().settings.service
    degree = math.pi / 180.0
    given_values = [(x * degree, std * degree) for x, std in gyros] + accels
    for name, (offset, std) in zip(IMU_CHANNELS, given_values, strict=True):
        state = state._replace(**{name: getattr(state, name)._replace(correction=offset, variance=std * std)})
    body = decoded(encoded(remembered(setup(), state, NOW_NS, None, BOOT)))
    away_ns = round(away_s * 1e9)
    recall = recalled(setup(), body, NOW_NS + away_ns, BOOT._replace(elapsed_ns=BOOT.elapsed_ns + away_ns))
    assert recall.taken == IMU_CHANNELS
    assert recall.estimator is not None
    plain = resumed(state, tuning, away_s)
    for name in IMU_CHANNELS:
        law, channel, before = getattr(tuning, name), getattr(recall.estimator, name), getattr(state, name)
        std = service.parked_gyro_std_degps * degree if name in GYRO_CHANNELS else service.parked_accel_std_mps2
        moved = std * (1.0 - math.exp(-away_s / service.parked_cooling_s))
        expected = min(before.variance + moved**2 + law.drift_density * away_s, law.prior_std**2)
        assert math.isclose(channel.variance, expected, rel_tol=1e-6)
        assert channel.variance >= getattr(plain, name).variance * (1.0 - 1e-9)
        assert repr(channel._replace(variance=0.0)) == repr(before._replace(variance=0.0))
    assert repr(recall.estimator.stiffness) == repr(plain.stiffness)


@settings(max_examples=500, deadline=None, derandomize=True)
@given(st.sampled_from(places(as_plain(initial_state(setup().settings.estimator.tuning())))), ANYTHING | PLAIN)
def test_a_plain_state_is_built_or_refused_and_nothing_else(place: tuple[str, ...], value: Any) -> None:
    plain = as_plain(learnt())
    inner: Any = plain
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    words, state = "", None
    try:
        state = from_plain(plain)
    except ValueError as error:
        words = str(error)
    assert len(words) < 400
    if state is not None:
        assert [type(x) for part in state for x in part] == [type(x) for part in learnt() for x in part]
