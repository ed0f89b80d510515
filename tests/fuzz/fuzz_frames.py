"""Frames: real ones, mutated ones and noise through decoder, loop and, at every tick, encoder.

Whatever comes, offsets stay finite and within what the configuration allows, a frame brings no more ticks due
than the gap allows, every frame is counted once, and what goes out has our ids and eight bytes. All shipped
configurations take their turn, a chunk each.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator
from functools import cache, partial
from typing import NamedTuple

from fuzz_chunk import Session, Target, Unexpected
from synthetic_car import CARS, GOLDEN, SyntheticCar, gentle_drive

from dsz_daemon.core.state import as_plain, from_plain
from dsz_daemon.edge.logs import LogReport, read_frames
from dsz_daemon.errors import ConfigError
from dsz_daemon.pipeline.decode_counters import DecodeCounters
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs.setup import Setup, set_up

_BATCH = 1_000
# Bus time a frame, ns: a tick costs as much as twenty frames, and 100 frames a tick is more than a full bus brings.
_USUAL_NS, _CROWDED_NS = 1_900_000, 100_000
_START_NS = 1_700_000_000_000_000_000
_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_STAMPS = (0, 1, -1, -(10**12), 2**63 - 1, 2**62, 10**18, 4 * 10**18)
_frame = partial(tuple.__new__, Frame)


class _Bench(NamedTuple):
    """One configuration, frames that fit it, and the largest offset that each channel may publish."""

    name: str
    setup: Setup
    corpus: tuple[Frame, ...]
    largest: tuple[float, ...]


@cache
def _bench(number: int) -> _Bench:
    """The configuration whose turn it is; one whose DBC is not installed (opendbc) gives its turn to the first."""
    path = CARS[number % len(CARS)]
    try:
        setup = set_up(path)
    except ConfigError as error:
        print(f"frames: {path.name} is left out: {' '.join(str(error).split())[:160]}")
        return _bench(0)
    if path == GOLDEN:
        corpus = tuple(read_frames([GOLDEN.parents[1] / "sine_steer.log.gz"], LogReport()))
    else:
        car = SyntheticCar(setup)
        corpus = tuple(f for k in range(400) for f in car.frames(_START_NS, gentle_drive(0.01 * k)))
    tuning = setup.settings.estimator.tuning()
    laws = (tuning.gyro_x, tuning.gyro_y, tuning.gyro_z, tuning.accel_x, tuning.accel_y, tuning.accel_z)
    name = "golden" if path == GOLDEN else path.stem
    return _Bench(name, setup, corpus, tuple(law.largest_offset * max(1.0, tuning.c_y) for law in laws))


def run(session: Session, count: int) -> None:
    """One sequence over one loop; it is never started anew within a chunk."""
    bench = _bench(session.chunk % len(CARS))
    rng, setup = session.random, bench.setup
    encoder = setup.encoder()
    decoder = setup.decoder(encoder)
    loop = setup.loop(decoder)
    settings = setup.settings.loop
    # Ticks wait for no longer than the gap: this many rows a frame, and no more.
    most_rows = 2 * (round(settings.gap_s * settings.rate_hz) + 2)
    source = _sequence(bench.corpus, rng)
    done = published = 0
    while done < count:
        session.begin(inputs=min(_BATCH, count - done))
        for _ in range(min(_BATCH, count - done)):
            frame = next(source)
            rows = loop.frame(frame)
            if rows:
                if len(rows) > most_rows:
                    raise Unexpected(f"{len(rows)} rows due by {frame}")
                for row in rows:
                    _look_at_row(row, bench.largest)
                    published += _look_at_sent(encoder.encode(row), encoder.published_ids)
        done += min(_BATCH, count - done)
        due_ns = loop.next_tick_ns
        if due_ns is not None and rng.random() < 0.05:
            for row in loop.advance(due_ns + rng.randrange(10**9)):
                _look_at_row(row, bench.largest)
        loop.silent_row(due_ns or 0)
        if rng.random() < 0.02:
            state = loop.memory.estimator
            if repr(from_plain(json.loads(json.dumps(as_plain(state))))) != repr(state):
                raise Unexpected(f"the state does not come back: {state}")
    _look_at_counts(decoder.counters, done)
    session.outcomes[f"{bench.name}, chunks"] += 1
    session.outcomes["frames with samples"] += loop.memory.counters.frames
    session.outcomes["published"] += published
    session.outcomes["rejected"] += decoder.counters.rejected


def _look_at_row(row: Row, largest: tuple[float, ...]) -> None:
    for channel, bound in zip(row.output.channels, largest, strict=True):
        if not abs(channel.offset) <= bound * (1.0 + 1e-9):
            raise Unexpected(f"offset {channel.offset}, allowed {bound}")
        if not 0.0 < channel.offset_std < math.inf:
            raise Unexpected(f"spread {channel.offset_std}")


def _look_at_sent(frames: list[Frame], ids: frozenset[tuple[int, bool]]) -> int:
    for frame in frames:
        if len(frame.data) != 8 or (frame.can_id, frame.is_extended) not in ids:
            raise Unexpected(f"sent {frame}")
    return len(frames)


def _look_at_counts(counters: DecodeCounters, frames: int) -> None:
    """Every frame is in one count at least (one that two plans mean is in two)."""
    used = sum(message.frames + message.refused for message in counters.messages.values())
    told = used + sum((counters.unwanted, counters.own, counters.remote, counters.error_frames, counters.ambiguous))
    if counters.frames != frames or told < frames:
        raise Unexpected(f"{frames} frames, counted {counters}")
    senders = sum(len(message.senders) for message in counters.messages.values())
    if senders > 8 * len(counters.messages):
        raise Unexpected(f"{senders} senders remembered")


def _sequence(corpus: tuple[Frame, ...], rng: random.Random) -> Iterator[Frame]:
    """Episodes of some thousand frames: calm, wild, or nearly all noise, on a clock that goes on."""
    t_ns, at = _START_NS, 0
    while True:
        share = rng.choice((0.0, 0.05, 0.3, 0.9, 1.0))
        step_ns = _USUAL_NS if rng.random() < 0.02 else _CROWDED_NS
        for _ in range(rng.randrange(500, 5_000)):
            t_ns += step_ns
            at = (at + 1) % len(corpus)
            frame = corpus[at]
            if rng.random() >= share:
                # As `_replace`, in a third of the time.
                yield _frame((t_ns, *frame[1:]))
                continue
            leap = rng.random()
            if leap < 0.0001:
                # The clock itself is set: on a bus nobody can, in a recording anything stands.
                t_ns = max(0, t_ns + rng.choice((-1, 1)) * int(10 ** rng.uniform(6, 15)))
                if t_ns > 3 * 10**18:
                    t_ns = _START_NS
            yield _mutated(frame, t_ns, rng)


def _mutated(frame: Frame, t_ns: int, rng: random.Random) -> Frame:
    kind = rng.randrange(16)
    data = frame.data
    if kind < 5:
        bits = int.from_bytes(data, "big")
        for _ in range(1 if kind else rng.randrange(1, 65)):
            bits ^= 1 << rng.randrange(8 * len(data) or 1)
        data = (bits & ((1 << 8 * len(data)) - 1)).to_bytes(len(data), "big")
    elif kind < 8:
        data = rng.randbytes(len(data))
    elif kind == 8:
        data = data[: rng.randrange(len(data) + 1)]
    elif kind == 9:
        length = rng.choice(_LENGTHS)
        data = (data + rng.randbytes(64))[:length]
        return frame._replace(t_ns=t_ns, data=data, is_fd=length > 8, fd_flags=rng.randrange(16))
    elif kind == 10:
        extended = rng.random() < 0.5
        return Frame(t_ns, frame.channel, rng.randrange(0x20000000 if extended else 0x800), rng.randbytes(8), extended)
    elif kind == 11:
        return frame._replace(t_ns=t_ns, is_extended=not frame.is_extended)
    elif kind == 12:
        flag = rng.choice(("is_remote", "is_error", "is_fd"))
        return frame._replace(t_ns=t_ns, remote_length=rng.randrange(9), **{flag: True})
    elif kind == 13:
        return frame._replace(t_ns=t_ns, channel=rng.choice(("can0", "can1", "can9", "", "\0")))
    elif kind == 14:
        data = bytes([rng.choice((0, 255))]) * len(data)
    elif rng.random() < 0.004:
        return frame._replace(t_ns=rng.choice(_STAMPS))
    else:
        # A little out of order, which buses with several queues are.
        return frame._replace(t_ns=t_ns - rng.randrange(20_000_000))
    return frame._replace(t_ns=t_ns, data=data)


TARGET = Target(
    "frames", "random and mutated frames through decoder, loop and encoder", 10_000_000, 500_000, 40_000, run
)
