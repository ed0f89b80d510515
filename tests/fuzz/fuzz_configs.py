"""Configurations: mutated text and mutated structures through everything that `dsz check` does.

A mutated configuration gives settings that a loop can be built from, or ConfigError or InputError with
printable words. DBC files are read once here (`fuzz_dbcs` is about those); everything else is the real path.
"""

from __future__ import annotations

import copy
import json
import random
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import yaml
from fuzz_chunk import Session, Target, Unexpected
from fuzz_mutate import mutated

from dsz_daemon.config import resolution
from dsz_daemon.config.settings import Settings
from dsz_daemon.edge.dbc import LoadedDbc, load_dbc
from dsz_daemon.errors import ConfigError, DszError, Fault, InputError
from dsz_daemon.pipeline.encode import Encoder
from dsz_daemon.runs import setup as setup_module
from dsz_daemon.runs.setup import set_up

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
GOLDEN = ROOT / "tests" / "golden" / "sine_steer"
# PyYAML reads 200 kB a second: large files are in, but seldom.
_SMALL = [
    (HERE / "corpus" / "configs" / name).read_bytes() for name in ("tiny.yaml",) * 6 + ("small.yaml", "sections.yaml")
]
_NASTY = [path.read_bytes() for path in sorted((HERE / "corpus" / "configs").glob("*.yaml"))]
_LARGE = [
    path.read_bytes() for path in [ROOT / "config" / "example.yaml", *sorted((ROOT / "config" / "cars").glob("*.yaml"))]
]
# Read once and kept: reading DBC files anew for every input would be most of the time.
_GOOD = {"car.dbc", "imu.dbc", *re.findall(r"pkg:[\w/.]+", b"".join(_LARGE).decode())}
_TOKENS = [
    b"&a ", b"*a", b"<<: *a", b"!!python/object:os.system ", b"!!str ", b"? ", b"| ", b"> ", b"---\n", b"...\n",
    b"%YAML 9\n",
    b"{", b"}", b"[", b"]", b": ", b"- ", b", ", b"# ", b"'", b'"', b"vehicle", b"signals", b"gyro_x",
    b"wheel_speed_fl",
    b"deg/s", b"rad/s", b"m/s^2", b"rpm", b"sign: -1", b"valid_signal", b"on_values", b"volts_per_unit",
    b"channel: can0",
    b"estimator: {as_printed: true}", b"loop: {rate_hz: 20}", b"output: {bus: can9}", b"extended: true", b"service: {}",
    b"&a [*a]", b"pkg:opendbc/x.dbc", b"~root/x", b"../", b"\\0", b"\\x1b", b"\\ud800", b"0x", b"0o7", b"1_000",
    b"{{{{{{{{", b"[[[[[[[[",
]  # fmt: skip


def _structures() -> list[dict[str, Any]]:
    return [yaml.safe_load(text) for text in _SMALL]


def run(session: Session, count: int) -> None:
    """Half of them mutated as text, half as structure; now and then what is nested very deep or very large."""
    rng, bases = session.random, _structures()
    for _ in range(count):
        draw = rng.random()
        if session.inputs < len(_NASTY):
            # What was found once, as it was found.
            data = _NASTY[session.inputs]
        elif draw < 0.45:
            data = mutated(rng.choice(_SMALL), rng, _TOKENS)
        elif draw < 0.55:
            data = mutated(rng.choice(_NASTY), rng, _TOKENS)
        elif draw < 0.554:
            data = mutated(rng.choice(_LARGE), rng, _TOKENS)
        elif draw < 0.555:
            data = _monster(rng)
        else:
            data = _written(_changed(rng.choice(bases), rng), rng)
        session.begin(data)
        one(session, data)


def one(session: Session, data: bytes) -> None:
    """Reads, checks and, where it is good, builds: the outcome is counted, anything undue raised."""
    if not (session.folder / "car.dbc").exists():
        for dbc in GOLDEN.glob("*.dbc"):
            shutil.copy(dbc, session.folder)
    path = session.folder / "config.yaml"
    path.write_bytes(data)
    try:
        with _quicker(checks_stability=session.inputs % 10 == 1):
            setup = set_up(path)
    except (ConfigError, InputError) as error:
        session.outcomes[type(error).__name__] += 1
        look_at(error)
        return
    session.outcomes["good"] += 1
    # As `dsz check --json` and the summary print it.
    json.dumps(setup.settings.model_dump(mode="json"))
    # An encoder reads our own DBC, which takes longer than all the rest.
    encoder = setup.encoder() if session.outcomes["good"] % 10 == 1 else _usual_encoder()
    setup.loop(setup.decoder(encoder))


@contextmanager
def _quicker(checks_stability: bool) -> Iterator[None]:
    """Good DBCs are read once; the stability check takes four times as long as the rest, for three numbers."""
    with patch.object(resolution, "load_dbc", _loaded_once):
        if checks_stability:
            yield
        else:
            with patch.object(setup_module, "stability_faults", _unchecked):
                yield


def _unchecked(_settings: Settings) -> list[Fault]:
    return []


@cache
def _usual_encoder() -> Encoder:
    return set_up(GOLDEN / "config.yaml").encoder()


@cache
def _loaded(name: str) -> LoadedDbc:
    return load_dbc(name, GOLDEN)


def _loaded_once(name: str, base: Path) -> LoadedDbc:
    """Good files once; whatever is wrong with a name is found anew each time."""
    return _loaded(name) if name in _GOOD else load_dbc(name, base)


def look_at(error: DszError) -> None:
    """Words for a terminal: some faults, a line each, nothing in them that a terminal obeys."""
    for text in str(error).split("\n"):
        if len(text) > 20_000:
            raise Unexpected(f"a message of {len(text)} characters: {text[:200]!r}")
        if not all(c.isprintable() for c in text):
            raise Unexpected(f"not printable: {text[:400]!r}")


_VALUES = (
    None, True, False, 0, 1, -1, 2, 1.5, -0.0, 1e308, -1e308, 5e-324, float("nan"), float("inf"), 2**31, 2**63,
    2**64, -(2**70),
    10**400, "", " ", "x", "0", "1673 kg", "~", "\0", "\x1b[2J", "\n", "\u202e", "\ud7ff", "A" * 3000, [], {}, [[]],
    [None], {"": None},
    {"a": {"b": {"c": {}}}}, "deg/s", "rad/s", "g", "km/h", "can0", "car.dbc", "nofile.dbc", "~nobody/x",
    "pkg:__main__/x",
)  # fmt: skip


def _changed(base: dict[str, Any], rng: random.Random) -> Any:
    """A copy in which a few values are deleted, doubled, moved or of another kind."""
    data = json.loads(json.dumps(base))
    for _ in range(1 + int(rng.expovariate(0.7))):
        places = list(_places(data))
        if not places:
            return copy.deepcopy(rng.choice(_VALUES))
        holder, key = rng.choice(places)
        draw = rng.random()
        if draw < 0.2:
            del holder[key]
        elif draw < 0.6:
            holder[key] = copy.deepcopy(rng.choice(_VALUES))
        elif draw < 0.75:
            other, other_key = rng.choice(places)
            holder[key] = json.loads(json.dumps(other[other_key], default=str))
        elif isinstance(holder, dict):
            name = rng.choice([str(key) + rng.choice("sx_ "), rng.choice(["bus", "gear", "", "<<", "1", "\x07"])])
            holder[name] = holder[key]
        else:
            holder.append(holder[key])
    return data


def _places(data: Any) -> Any:
    """(holder, key) of every value within."""
    if isinstance(data, dict):
        for key in list(data):
            yield data, key
            yield from _places(data[key])
    elif isinstance(data, list):
        for i in range(len(data)):
            yield data, i
            yield from _places(data[i])


def _written(data: Any, rng: random.Random) -> bytes:
    """As YAML's JSON subset, or as PyYAML would write it."""
    if rng.random() < 0.9:
        text = json.dumps(data, ensure_ascii=rng.random() < 0.5)
        return text.replace("NaN", ".nan").replace("Infinity", ".inf").encode("utf-8", "replace")
    return yaml.safe_dump(data, allow_unicode=True).encode("utf-8", "replace")


def _monster(rng: random.Random) -> bytes:
    """Deep, wide or self-similar."""
    n = int(10 ** rng.uniform(1.0, 3.5))
    kind = rng.randrange(7)
    if kind == 0:
        return b"vehicle: " + b"[" * n + b"]" * n
    if kind == 1:
        return b"vehicle: " + b"{a: " * n + b"}" * n
    if kind == 2:
        return b"\n".join(b" " * i + b"a:" for i in range(min(n, 600)))
    if kind == 3:
        laughs = [b"a0: &a0 [x, x]"] + [b"a%d: &a%d [*a%d, *a%d]" % (i, i, i - 1, i - 1) for i in range(1, min(n, 200))]
        return b"\n".join([*laughs, b"signals: {dbc: *a9, gyro_z: {unit: *a9, message: *a9, signal: *a9}}"])
    if kind == 4:
        merges = [b"a0: &a0 {x: 1}"] + [
            b"a%d: &a%d {<<: [*a%d, *a%d]}" % (i, i, i - 1, i - 1) for i in range(1, min(n, 200))
        ]
        return b"\n".join([*merges, b"vehicle: {<<: *a5}"])
    if kind == 5:
        return b"signals: {" + b", ".join(b"k%d: {message: m, signal: s}" % i for i in range(min(n, 800))) + b"}"
    return b"vehicle: {mass_kg: " + rng.choice([b"9", b"0x" + b"f" * n, b"-", b"1e"]) * min(n, 9) + b"9" * n + b"}"


TARGET = Target("configs", "mutated configurations through `dsz check`", 100_000, 5_000, 300, run, one)
