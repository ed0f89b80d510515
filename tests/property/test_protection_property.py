"""Protected input: every frame in one count, planted faults counted exactly, and the loop's promises with it."""

from __future__ import annotations

import copy
import random
from functools import cache
from pathlib import Path

import pytest
from cantools.database.can import Message, Signal
from hypothesis import given
from hypothesis import strategies as st

from dsz_daemon.config.check import check_configuration
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.decode_counters import DecodeCounters
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.loop import Loop, LoopSettings
from dsz_daemon.pipeline.mapping import Part, Source
from dsz_daemon.pipeline.protection import Checksum, Counter, E2e, Protection
from dsz_daemon.pipeline.rate_bound import RateBound
from tests.golden.golden import CONFIG, LOG
from tests.property.test_codec_property import unhurried

MS = 1_000_000
MESSAGE = Message(
    0x25, "M", 8, [Signal("VALUE", 16, 8), Signal("COUNTER", 8, 4), Signal("CHECKSUM", 63, 8, "big_endian")]
)
BOTH = Protection("M", Counter("COUNTER"), Checksum("toyota"))


def decoder(
    protection: Protection = BOTH, bound: RateBound | None = None, counters: DecodeCounters | None = None
) -> Decoder:
    source = Source("gyro_z", "M", (Part("VALUE"),), 1.0, 0.0, 200.0)
    return Decoder([source], {"M": MESSAGE}, (), counters, [protection], bound)


def payload(counter: int, value: int) -> bytes:
    body = bytes([0, counter, value, 0, 0, 0, 0])
    return body + bytes([(8 + 0x25 + sum(body)) % 256])


# Whole frames, cut ones, right and wrong sums, any counter; stamps that stand, run, leap and fall back.
any_frames = st.lists(
    st.builds(
        Frame,
        t_ns=st.sampled_from([0, 1, 10 * MS, 499 * MS, 501 * MS, -3_000 * MS, 4_000 * MS]),
        channel=st.sampled_from(["can0", "can0", "can1"]),
        can_id=st.sampled_from([0x25, 0x25, 0x25, 0x26]),
        data=st.one_of(
            st.builds(payload, st.integers(0, 15), st.integers(0, 255)),
            st.builds(payload, st.integers(0, 2), st.just(7)),
            st.binary(max_size=12),
        ),
        is_extended=st.just(False),
        is_remote=st.just(False),
        is_error=st.just(False),
    ),
    max_size=60,
)


def in_time(frames: list[Frame]) -> list[Frame]:
    """The drawn stamps are steps from one frame to the next."""
    t_ns, found = 10**18, []
    for frame in frames:
        t_ns += frame.t_ns
        found.append(frame._replace(t_ns=t_ns))
    return found


bounds = st.sampled_from([None, RateBound.of(100.0, 0.02, 1.0), RateBound.of(2000.0, 0.5, 1.0)])
protections = st.sampled_from([BOTH, Protection("M", BOTH.counter), Protection("M", e2e=E2e(2, (0,)))])


@unhurried
@given(any_frames, bounds, protections)
def test_every_frame_is_in_exactly_one_count(frames: list[Frame], bound: RateBound | None, kind: Protection) -> None:
    tested, samples = decoder(kind, bound), 0
    for frame in in_time(frames):
        samples += len(tested.decode(frame))
        assert tested.rejected == tested.counters.rejected
    seen = tested.counters
    message, role = seen.messages["M"], seen.roles["gyro_z"]
    assert message.frames + message.refused + seen.ambiguous + seen.unwanted == seen.frames == len(frames)
    assert samples == role.samples == message.frames - role.rejected
    assert seen.rejected == message.refused + role.rejected


@unhurried
@given(any_frames, st.integers(0, 60), bounds, protections)
def test_a_decoder_that_resumes_equals_one_that_never_stopped(
    frames: list[Frame], cut: int, bound: RateBound | None, kind: Protection
) -> None:
    stream = in_time(frames)
    whole, first = decoder(kind, bound), decoder(kind, bound)
    expected = [list(whole.decode(f)) for f in stream]
    got = [list(first.decode(f)) for f in stream[:cut]]
    second = decoder(kind, bound, first.counters)
    got += [list(second.decode(f)) for f in stream[cut:]]
    assert got == expected
    assert second.counters == whole.counters
    assert second.rejected == whole.rejected


@unhurried
@given(st.lists(st.sampled_from(["good"] * 6 + ["corrupt", "repeated", "lost"]), max_size=150), st.integers(1, 3))
def test_planted_faults_are_counted_exactly(plan: list[str], at_once: int) -> None:
    """A true sender, of whose frames some come corrupt, twice, or (up to three in a row) not at all."""
    counter, stamp, stream = 0, 10**18, [payload(0, 1)]
    planted = {"corrupt": 0, "repeated": 0, "lost": 0}
    away = 0  # frames in a row that can't be read: a fourth would look like another sender
    for drawn in plan:
        too_many = drawn != "repeated" and away + (at_once if drawn == "lost" else 1) > 3
        what = "good" if too_many else drawn
        if what == "repeated":
            stream.append(payload(counter - away & 15, 1))
            planted[what] += 1
        elif what == "lost":
            counter, away = counter + at_once & 15, away + at_once
            planted[what] += at_once
        elif what == "corrupt":
            counter, away = counter + 1 & 15, away + 1
            stream.append(bytes([payload(counter, 1)[0] ^ 0x40]) + payload(counter, 1)[1:])
            planted[what] += 1
        else:
            counter, away = counter + 1 & 15, 0
            stream.append(payload(counter, 1))
    tested = decoder()
    for n, data in enumerate([*stream, payload(counter + 1 & 15, 1)]):
        tested.decode(Frame(stamp + n * 10 * MS, "can0", 0x25, data))
    seen = tested.counters.messages["M"]
    assert (seen.wrong_checksum, seen.repeated, seen.lost) == tuple(planted.values())
    assert seen.wrong_sequence == 0
    assert seen.frames == len(stream) + 1 - planted["corrupt"] - planted["repeated"]


# --- in the loop, over a recording whose messages count ---

COUNTERS = {"IMU_RATE": "RATE_COUNTER", "IMU_ACCEL": "ACCEL_COUNTER", "STEERING": "STEER_COUNTER",
            "WHEEL_SPEEDS": "WHEEL_COUNTER"}  # fmt: skip
IMU_RATE_ID = 0x500


@pytest.fixture(scope="module")
def protected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The golden drive's configuration, with the counters that its messages carry."""
    lines = "".join(f"  {message}: {{counter: {{signal: {name}}}}}\n" for message, name in COUNTERS.items())
    folder = tmp_path_factory.mktemp("protected")
    for dbc in CONFIG.parent.glob("*.dbc"):
        (folder / dbc.name).write_text(dbc.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "config.yaml").write_text(f"{CONFIG.read_text(encoding='utf-8')}\nprotection:\n{lines}", encoding="utf-8")
    return folder / "config.yaml"


@cache
def golden_frames() -> tuple[Frame, ...]:
    """Three seconds out of the middle."""
    frames = list(read_frames([LOG], LogReport()))
    first_ns = frames[0].t_ns + 10 * 10**9
    return tuple(frame for frame in frames if first_ns <= frame.t_ns < first_ns + 3 * 10**9)


def faulty(seed: int) -> list[Frame]:
    """Frames doubled, dropped, sent again later, and one id babbling for half a second."""
    chance, frames = random.Random(seed), []
    for frame in golden_frames():
        kind = chance.random()
        frames += [frame] * (2 if kind < 0.02 else 0 if kind < 0.04 else 1)
        if kind > 0.98:
            frames.append(golden_frames()[0]._replace(t_ns=frame.t_ns))
    middle = next(frame for frame in frames[len(frames) // 2 :] if frame.can_id == IMU_RATE_ID)
    babble = [middle._replace(t_ns=middle.t_ns + n * 50_000) for n in range(10_000)]
    return sorted([*frames, *babble], key=lambda frame: frame.t_ns)


def new_loop(config: Path, counters: DecodeCounters | None = None) -> tuple[Loop, Decoder]:
    checked = check_configuration(config)
    resolved, settings = checked.resolved, checked.settings
    made = Decoder(
        resolved.sources, resolved.messages, (), counters, resolved.protections, RateBound.of(2000.0, 0.5, 1.0)
    )
    roles = frozenset(source.role for source in resolved.sources)
    loop_settings = LoopSettings(steering_ratio=settings.vehicle.steering_ratio, watch=settings.watch.limits())
    return Loop(settings.vehicle.car(), settings.estimator.tuning(), loop_settings, made, roles), made


def replayed(config: Path, frames: list[Frame]) -> list[object]:
    loop, _ = new_loop(config)
    return [*(row for frame in frames for row in loop.frame(frame)), *loop.finish()]


@pytest.mark.parametrize(("seed", "where"), [(1, 0.3), (2, 0.55), (3, 0.8)])
def test_saving_and_resuming_equals_never_stopping(protected: Path, seed: int, where: float) -> None:
    frames = faulty(seed)
    cut = int(where * len(frames))
    loop, made = new_loop(protected)
    rows = [row for frame in frames[:cut] for row in loop.frame(frame)]
    resumed, again = new_loop(protected, made.counters)
    resumed.memory = copy.deepcopy(loop.memory)
    rows += [row for frame in frames[cut:] for row in resumed.frame(frame)]
    assert repr([*rows, *resumed.finish()]) == repr(replayed(protected, frames))
    seen = again.counters.messages
    assert sum(message.babbling for message in seen.values()) > 5000
    assert sum(message.repeated for message in seen.values()) > 10
    assert sum(message.wrong_sequence for message in seen.values()) > 0


@pytest.mark.parametrize("seed", [4, 5])
def test_a_clock_that_ticks_in_between_changes_no_row(protected: Path, seed: int) -> None:
    """Live: the clock brings ticks due before the next frame is there. Replay: the next frame does."""
    frames, chance = faulty(seed), random.Random(seed)
    loop, _ = new_loop(protected)
    rows = []
    for frame, later in zip(frames, [*frames[1:], frames[-1]], strict=True):
        rows += loop.frame(frame)
        if later.t_ns > frame.t_ns:
            rows += loop.advance(chance.randrange(frame.t_ns, later.t_ns))
    expected = replayed(protected, frames)
    assert repr([*rows, *loop.finish()][: len(expected)]) == repr(expected)


def test_the_golden_drives_counters_are_all_in_order(protected: Path) -> None:
    loop, made = new_loop(protected)
    for frame in golden_frames():
        loop.frame(frame)
    assert made.rejected == 0
    assert all(made.counters.messages[name].frames > 100 for name in COUNTERS)
    assert all(made.counters.messages[name].lost == 0 for name in COUNTERS)
