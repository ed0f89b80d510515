"""DBC files: mutated text through `load_dbc`, the mapping and the decoder.

cantools' parser raises whatever it runs into; out of `load_dbc` come a database, ConfigError or InputError.
What it let pass must decode any payload.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fuzz_chunk import Session, Target
from fuzz_configs import look_at
from fuzz_mutate import mutated

from dsz_daemon.config.check import check_configuration
from dsz_daemon.edge.dbc import LoadedDbc, load_dbc
from dsz_daemon.errors import ConfigError, InputError
from dsz_daemon.pipeline.decode import Decoder
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Part, Source

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
_CORPUS = [
    path.read_bytes()
    for path in [
        *sorted((ROOT / "dbc").glob("example_*.dbc")),
        ROOT / "dbc" / "ford_pinion.dbc",
        *sorted((ROOT / "tests" / "golden" / "sine_steer").glob("*.dbc")),
        *sorted((HERE / "corpus" / "dbcs").glob("*.dbc")),
    ]
]
_TOKENS = [
    b"BO_ ", b" SG_ ", b"SG_MUL_VAL_ ", b"SIG_VALTYPE_ ", b"VAL_ ", b"VAL_TABLE_ ", b"CM_ ", b"BA_ ", b"BA_DEF_ ",
    b"BU_:", b"NS_ :", b"BS_:",
    b"EV_ ", b"ENVVAR_DATA_ ", b"BO_TX_BU_ ", b"SIG_GROUP_ ", b'CM_ "IMPORT imu.dbc";\n', b'CM_ "IMPORT ../x";\n',
    b"M", b"m0", b"m1M", b"m99999999",
    b"0|0@1+", b"63|64@0-", b"7|65@1-", b"|", b"@1+", b"@0-", b"(1,0)", b"(0,0)", b"(1e400,-1e400)", b"(nan,inf)",
    b"[0|0]", b'""', b"Vector__XXX",
    b"2147483648", b"4294967295", b"3221225472", b"536870912", b";", b":", b",", b":()[]", b":( ", b"9" * 4400,
]  # fmt: skip
_VEHICLE = {
    "mass_kg": 1673, "yaw_inertia_kgm2": 2850, "cg_to_front_axle_m": 1.149, "cg_to_rear_axle_m": 1.491,
    "front_cornering_stiffness_n_per_rad": 62000, "rear_cornering_stiffness_n_per_rad": 68000,
}  # fmt: skip


def run(session: Session, count: int) -> None:
    """Files of some 25 lines with a few mutations each; those of `corpus/dbcs` as they are, too."""
    rng = session.random
    for _ in range(count):
        whole = session.inputs < len(_CORPUS)
        data = _CORPUS[session.inputs] if whole else mutated(rng.choice(_CORPUS), rng, _TOKENS)
        session.begin(data)
        one(session, data)


def one(session: Session, data: bytes) -> None:
    """Loads, maps and decodes."""
    (session.folder / "fuzzed.dbc").write_bytes(data)
    try:
        loaded = load_dbc("fuzzed.dbc", session.folder)
    except (ConfigError, InputError) as error:
        session.outcomes[type(error).__name__] += 1
        look_at(error)
        return
    session.outcomes["lenient" if loaded.warnings else "good"] += 1
    _decode(session, loaded)
    if session.outcomes["good"] % 20 == 1:
        _map(session, loaded)


def _decode(session: Session, loaded: LoadedDbc) -> None:
    """Every signal of every message, from random payloads of every length."""
    rng = session.random
    messages = {m.name: m for m in loaded.database.messages}
    signals = [(m, s) for m in messages.values() for s in m.signals][:40]
    for message, signal in signals:
        source = Source(signal.name, message.name, (Part(signal.name),), 1.0, -1e9, 1e9)
        try:
            decoder = Decoder([source], messages)
        except ConfigError as error:
            session.outcomes["signal refused"] += 1
            look_at(error)
            continue
        for length in (0, 1, 7, 8, 64):
            frame = Frame(0, "can0", message.frame_id, rng.randbytes(length), message.is_extended_frame)
            for sample in decoder.decode(frame):
                session.outcomes["samples"] += 1
                if not -1e9 <= sample.value <= 1e9:
                    raise AssertionError(f"{sample} is out of its source's bounds")


def _map(session: Session, loaded: LoadedDbc) -> None:
    """The whole way of `dsz check` over this DBC, with the first signals mapped."""
    message = loaded.database.messages[0]
    roles: dict[str, Any] = {
        role: {"message": message.name, "signal": signal.name, "unit": "deg/s"}
        for role, signal in zip(("gyro_x", "gyro_y", "gyro_z"), message.signals, strict=False)
    }
    path = session.folder / "config.yaml"
    path.write_text(json.dumps({"vehicle": _VEHICLE, "signals": {"dbc": "fuzzed.dbc", **roles}}), encoding="utf-8")
    try:
        check_configuration(path)
    except (ConfigError, InputError) as error:
        look_at(error)
    session.outcomes["mapped"] += 1


TARGET = Target("dbcs", "mutated DBC files through load_dbc, mapping and decoder", 10_000, 2_500, 100, run, one)
