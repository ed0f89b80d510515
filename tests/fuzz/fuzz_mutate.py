"""Bytes into other bytes: the mutations that all text formats share."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

_NASTY = (
    b"\0", b"\t", b"\r", b"\n", b"\r\n", b"\x1c", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc0\x80", b"\xed\xa0\x80",
    b"\xe2\x80\xa8", b"\xf0\x9f\x9a\x97", "ß".encode(), b"-", b"--", b"'", b'"', b"\\", b"%s", b"{}", b"[]",
    b"0", b"-1", b"1e999", b"-1e999", b"1e-999", b"nan", b".nan", b".inf", b"NaN", b"Infinity", b"null", b"true",
    b"9" * 400, b"9" * 5000, b"0x" + b"f" * 5000, b"18446744073709551616", b"9223372036854775807", b"-0",
    b"0.1" + b"0" * 300, b"1" + b"0" * 309, b"A" * 1000,
)  # fmt: skip
_Mutation = Callable[[bytes, random.Random, Sequence[bytes]], bytes]


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    """A stretch: mostly short, now and then anything."""
    start = rng.randrange(len(data) + 1)
    most = len(data) - start
    return start, start + min(most, rng.randrange(1, 9) if rng.random() < 0.8 else rng.randrange(most + 1))


def _flip(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def _byte(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]


def _without(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def _twice(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    start, end = _span(data, rng)
    times = 1 if rng.random() < 0.9 else rng.randrange(2, 400)
    return data[:end] + data[start:end] * times + data[end:]


def _token(data: bytes, rng: random.Random, tokens: Sequence[bytes]) -> bytes:
    start, end = _span(data, rng)
    token = rng.choice(tokens) if tokens and rng.random() < 0.7 else rng.choice(_NASTY)
    return data[:start] + token + data[end if rng.random() < 0.5 else start :]


def _cut(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _lines(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    """A line deleted, repeated or moved."""
    lines = data.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    line = lines[at] if rng.random() < 0.5 else lines.pop(at)
    if rng.random() < 0.7:
        lines.insert(to, line)
    return b"\n".join(lines)


def _indent(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    lines[at] = rng.choice([b" ", b"  ", b"\t", b"    "]) + lines[at] if rng.random() < 0.6 else lines[at].lstrip()
    return b"\n".join(lines)


def _number(data: bytes, rng: random.Random, _tokens: Sequence[bytes]) -> bytes:
    """A digit becomes another number."""
    places = [i for i, c in enumerate(data[:20_000]) if 48 <= c <= 57]
    if not places:
        return data
    at = rng.choice(places)
    new = rng.choice([b"0", b"9", b"99", b"-1", b"1e9", b"4294967295", b"2147483648", b"64", b"65", b"255", b"0.5"])
    return data[:at] + new + data[at + 1 :]


_MUTATIONS: tuple[_Mutation, ...] = (_flip, _byte, _without, _twice, _token, _token, _cut, _lines, _indent, _number)
_WEIGHTS = (3, 3, 3, 2, 4, 4, 0.5, 3, 2, 4)
LARGEST_BYTES = 200_000


def mutated(data: bytes, rng: random.Random, tokens: Sequence[bytes] = ()) -> bytes:
    """`data` after one to eight mutations, mostly few; `tokens` are words of the format."""
    for _ in range(1 + min(7, int(rng.expovariate(0.7)))):
        (mutation,) = rng.choices(_MUTATIONS, _WEIGHTS)
        data = mutation(data, rng, tokens)[:LARGEST_BYTES]
    return data
