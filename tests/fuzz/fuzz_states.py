"""State files: mutated bytes and forged values through everything that reads one at start.

What was changed by a single byte is set aside and said, never believed and never an error. What a forger
gave a right checksum must still bring nothing out of bounds into the estimator, and the loop must go on
with whatever was taken over.
"""

from __future__ import annotations

import copy
import json
import random
from functools import cache
from typing import Any

from fuzz_chunk import Session, Target, Unexpected
from fuzz_mutate import mutated
from synthetic_car import GOLDEN, SyntheticCar, gentle_drive

from dsz_daemon.edge import state_file
from dsz_daemon.edge.boot import Boot
from dsz_daemon.pipeline.encode import Encoder
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.runs.memory import recalled, remembered
from dsz_daemon.runs.setup import Setup, set_up

_TOKENS = [
    b"null", b"NaN", b"1e999", b"{", b"}", b"[", b"]", b'"', b'"format":"dsz-offsets"', b'"version":2', b'"body":{}',
    b"\\u0000", b"true",
    b",", b"-", b"0.", b"e99",
]  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1.5, 1e-300, 1e308, -1e308, 5e-324, 2**63, 10**30, 10**400, "", "x", "nan", "\0", [], {},
    [[]], [0.0] * 50, {"": 0}, "A" * 500,
)  # fmt: skip
_START_NS = 1_700_000_000_000_000_000
_BOOT = Boot("b" * 32, 10**12)


@cache
def _setup() -> Setup:
    return set_up(GOLDEN)


@cache
def _encoder() -> Encoder:
    return _setup().encoder()


@cache
def _frames() -> tuple[Frame, ...]:
    car = SyntheticCar(_setup())
    return tuple(f for k in range(4) for f in car.frames(_START_NS + k * 10_000_000, gentle_drive(0.01 * k)))


@cache
def _learnt() -> bytes:
    """The file after some seconds of driving."""
    setup = _setup()
    car, loop = SyntheticCar(setup), setup.loop(setup.decoder(setup.encoder()))
    for k in range(600):
        for frame in car.frames(_START_NS + k * 10_000_000, gentle_drive(0.01 * k)):
            loop.frame(frame)
    return state_file.encoded(remembered(setup, loop.memory.estimator, _START_NS, 21.0, _BOOT))


def run(session: Session, count: int) -> None:
    """Most of them changed as bytes, the others as values and given a right checksum."""
    rng, whole = session.random, _learnt()
    base = json.dumps(state_file.decoded(whole))
    for i in range(count):
        data = whole
        if rng.random() < 0.7:
            data = mutated(whole, rng, _TOKENS)
        elif i:
            body = json.loads(base)
            _change(body, rng)
            try:
                data = state_file.encoded(body)
            except ValueError:
                data = json.dumps(body).encode()
        session.begin(data)
        one(session, data)


def one(session: Session, data: bytes) -> None:
    """Loads it as the only generation there is, and goes on with what it holds."""
    path = session.folder / "offsets.json"
    path.write_bytes(data)
    loaded = state_file.load(path)
    for word in loaded.said:
        if len(word) > 2_000:
            raise Unexpected(f"{len(word)} characters said")
    if loaded.body is None:
        session.outcomes["set aside"] += 1
        if not loaded.said or path.exists():
            raise Unexpected(f"not believed; said {loaded.said}, still there: {path.exists()}")
        return
    if state_file.encoded(loaded.body) != data:
        raise Unexpected("believed, though it is not what was written")
    recall = recalled(_setup(), loaded.body, _START_NS + 3_600_000_000_000, _BOOT)
    session.outcomes["believed whole" if len(recall.taken) == len(_setup().channels) else "believed in part"] += 1
    for word in recall.said:
        if len(word) > 2_000:
            raise Unexpected(f"{len(word)} characters said: {word[:200]}")
    if recall.estimator is not None and session.inputs % (3 if recall.said else 20) == 1:
        _go_on(session, recall.estimator)


def _go_on(session: Session, estimator: Any) -> None:
    """Some ticks from there: every offset and spread finite and within what the configuration allows."""
    setup = _setup()
    tuning = setup.settings.estimator.tuning()
    laws = (tuning.gyro_x, tuning.gyro_y, tuning.gyro_z, tuning.accel_x, tuning.accel_y, tuning.accel_z)
    loop = setup.loop(setup.decoder(_encoder()), estimator)
    for frame in _frames():
        for row in loop.frame(frame):
            session.outcomes["rows"] += 1
            for channel, law in zip(row.output.channels, laws, strict=True):
                if not (abs(channel.offset) <= law.largest_offset * 1.2 and 0.0 < channel.offset_std < 1e3):
                    raise Unexpected(f"goes on with {channel}")


def _change(body: Any, rng: random.Random) -> None:
    for _ in range(1 + int(rng.expovariate(1.0))):
        places = list(_places(body))
        if not places:
            return
        holder, key = rng.choice(places)
        draw = rng.random()
        if draw < 0.2:
            del holder[key]
        elif draw < 0.5 and isinstance(holder[key], float):
            # Another number of the same kind: the forger who knows what he does.
            holder[key] *= rng.choice((-1.0, 0.5, 2.0, 10.0, 1e3, 1e-3))
        elif draw < 0.9 or not isinstance(holder, dict):
            holder[key] = copy.deepcopy(rng.choice(_VALUES))
        else:
            holder[str(key) + "x"] = holder[key]


def _places(data: Any) -> Any:
    if isinstance(data, dict | list):
        for key in list(data) if isinstance(data, dict) else range(len(data)):
            yield data, key
            yield from _places(data[key])


TARGET = Target("states", "mutated and forged state files", 100_000, 10_000, 500, run, one)
