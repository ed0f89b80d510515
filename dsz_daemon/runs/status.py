"""What a running daemon answers when it is asked how it is: one JSON object. And the one line for its supervisor.

SI and radians; a number that is not there, or not finite, is null. Times are bus time. Built between
two ticks of the loop: plain dictionaries from plain values, nothing that could wait. Counts and
health are taken field by field, so that a new field is shown without a word here.

The fields' names are asked for once. A tuple of unknown length is made longer than it is and then cut, and
CPython 3.11 keeps up to 2000 of each length for later: one a question, and memory grows for an hour.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import fields
from functools import cache
from typing import Any

from dsz_daemon.core.outputs import ChannelState, Reason, StepOutput
from dsz_daemon.edge.health import BusHealth, Link
from dsz_daemon.pipeline.decode_counters import DecodeCounters, MessageCounts, RoleCounts
from dsz_daemon.pipeline.encode import EncoderState
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.report.display import CHANNEL_WORDS
from dsz_daemon.runs.asking import FORMAT
from dsz_daemon.runs.facts import LiveFacts, StateFacts
from dsz_daemon.runs.setup import Setup, versions
from dsz_daemon.signals import GYRO_CHANNELS, IMU_CHANNELS, QUANTITIES

_LONGEST_LINE = 120
_BUS = tuple(field.name for field in fields(BusHealth))
_ENCODER = tuple(field.name for field in fields(EncoderState))
_ROLE = tuple(field.name for field in fields(RoleCounts))
# `senders` is what the decoder remembers between two frames: no count, and nobody's business.
_MESSAGE = tuple(field.name for field in fields(MessageCounts) if field.name not in {"last_t_ns", "senders"})
_DECODER = tuple(field.name for field in fields(DecodeCounters))
_STATE = tuple(field.name for field in fields(StateFacts))
_MOTION = StepOutput._fields[len(IMU_CHANNELS) :]
_DEG = 180.0 / math.pi
# What people look at first: the yaw rate, which every car has.
_SHOWN_FIRST = ("gyro_z", *IMU_CHANNELS)


@cache
def prepared_versions() -> dict[str, Any]:
    """The versions of all that runs; the first call reads package metadata (4 ms), so call it before the loop."""
    return versions()


def snapshot_text(setup: Setup, facts: LiveFacts) -> bytes:
    """The snapshot as one line of strict JSON: what the status socket sends."""
    return json.dumps(snapshot(setup, facts), allow_nan=False, separators=(",", ":")).encode() + b"\n"


def snapshot(setup: Setup, facts: LiveFacts) -> dict[str, Any]:
    """Everything in `facts`, by name, with units; only mapped IMU channels and roles are in it."""
    now_ns, row = facts.now_ns, facts.row
    # As it is published meanwhile: nothing is known but the offsets.
    silent = facts.phase == "silent"
    return {
        "format": FORMAT,
        "summary": status_line(setup, facts),
        "phase": facts.phase,
        "pid": os.getpid(),
        "config": str(setup.path),
        "versions": prepared_versions(),
        "time_s": now_ns * 1e-9,
        "started_s": facts.started_ns * 1e-9,
        "uptime_s": max(0, now_ns - facts.started_ns) * 1e-9,
        "rate_hz": setup.settings.loop.rate_hz,
        "rows": facts.rows,
        "missed_ticks": facts.missed_ticks,
        "timer_overruns": facts.timer_overruns,
        "reloads": facts.reloads,
        "output_refused": facts.output_refused,
        "row": None if row is None else _row(row, now_ns),
        "channels": {name: _channel(name, row, silent) for name in setup.channels},
        "motion": {} if row is None or silent else _motion(row.output),
        "inputs": {role: _input(role, row, now_ns) for role in sorted(setup.roles)},
        "decoder": _decoder(facts.decoder, now_ns),
        "encoder": {name: getattr(facts.encoder, name) for name in _ENCODER},
        "buses": [_bus(bus, now_ns - facts.started_ns) for bus in facts.buses],
        "lateness": _lateness(facts.lateness),
        "state_file": _state_file(facts.state_file, now_ns),
        "events": [
            {
                "time_s": event.t_ns * 1e-9,
                "age_s": _age_s(now_ns, event.t_ns) if event.t_ns else None,
                "priority": event.priority.name.lower(),
                "kind": event.kind,
                "message": event.message,
            }
            for event in facts.events
        ],
    }


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _age_s(now_ns: int, then_ns: int) -> float:
    return (now_ns - then_ns) * 1e-9


def _row(row: Row, now_ns: int) -> dict[str, Any]:
    return {
        "time_s": row.t_ns * 1e-9,
        "age_s": _age_s(now_ns, row.t_ns),
        "event": row.event,
        "refused": [refusal._asdict() for refusal in row.refused],
        # Missed ticks are the daemon's to count (above); a row gets theirs only when it is published.
        "counters": {name: n for name, n in row.counters._asdict().items() if name != "missed_ticks"},
    }


def _channel(name: str, row: Row | None, silent: bool) -> dict[str, Any]:
    unit = QUANTITIES[name].si_unit
    if row is None:
        nothing = dict.fromkeys(("raw", "compensated", "offset", "offset_std"))
        return {"unit": unit, **nothing, "state": "invalid", "gate": False, "reason": "no_rows"}
    output = getattr(row.output, name)
    if silent:
        output = output._replace(
            raw=math.nan, compensated=math.nan, state=ChannelState.INVALID, gate=False, reason=Reason.STALE
        )
    return {
        "unit": unit,
        "raw": _number(output.raw),
        "compensated": _number(output.compensated),
        "offset": _number(output.offset),
        "offset_std": _number(output.offset_std),
        "state": output.state.name.lower(),
        "gate": bool(output.gate),
        "reason": output.reason.name.lower(),
    }


def _motion(output: StepOutput) -> dict[str, Any]:
    values = ((name, getattr(output, name)) for name in _MOTION)
    return {name: value if isinstance(value, bool) else _number(value) for name, value in values}


def _input(role: str, row: Row | None, now_ns: int) -> dict[str, Any]:
    value, age_s = (None, None) if row is None else (row.inputs.get(role), row.ages_s.get(role))
    if row is not None and age_s is not None:
        age_s += _age_s(now_ns, row.t_ns)
    return {"unit": QUANTITIES[role].si_unit, "value": _number(value), "age_s": _number(age_s)}


def _decoder(counters: DecodeCounters, now_ns: int) -> dict[str, Any]:
    counted = {name: getattr(counters, name) for name in _DECODER}
    counted["roles"] = {
        role: {**{name: getattr(counts, name) for name in _ROLE}, "rejected": counts.rejected}
        for role, counts in counters.roles.items()
    }
    counted["messages"] = {name: _message(counts, now_ns) for name, counts in counters.messages.items()}
    return counted


def _message(counts: MessageCounts, now_ns: int) -> dict[str, Any]:
    counted = {name: getattr(counts, name) for name in _MESSAGE}
    last_ns = counts.last_t_ns
    return {**counted, "refused": counts.refused, "age_s": None if last_ns is None else _age_s(now_ns, last_ns)}


def _bus(bus: BusHealth, up_ns: int) -> dict[str, Any]:
    up_s = up_ns * 1e-9
    return {
        **{name: getattr(bus, name) for name in _BUS},
        # Means since the start; for the load of this moment take the difference of two answers.
        "mean_received_per_s": bus.received / up_s if up_s > 0.0 else None,
        "mean_sent_per_s": bus.sent / up_s if up_s > 0.0 else None,
    }


def _lateness(lateness: Lateness) -> dict[str, Any]:
    return {
        "ticks": lateness.total,
        "mean_us": lateness.sum_us / lateness.total if lateness.total else None,
        "sum_us": lateness.sum_us,
        "p50_us": lateness.percentile_us(50.0),
        "p99_us": lateness.percentile_us(99.0),
        "max_us": lateness.max_us,
        # Upper edges of the bins that are not empty; null: above the last edge.
        "bins": [[_number(edge_us), count] for edge_us, count in lateness.bins()],
    }


def _state_file(state: StateFacts, now_ns: int) -> dict[str, Any]:
    known = {name: getattr(state, name) for name in _STATE}
    saved_ns = known.pop("saved_ns")
    return {**known, "saved_age_s": None if saved_ns is None else _age_s(now_ns, saved_ns)}


def status_line(setup: Setup, facts: LiveFacts) -> str:
    """One line of at most 120 characters for people: systemd's STATUS text."""
    where = ", ".join(bus.name for bus in facts.buses) or setup.output_bus
    if facts.phase == "waiting":
        line = f"waiting for frames on {where}"
    elif facts.phase == "silent":
        since = "" if facts.row is None else f" for {_silence(facts)}"
        line = f"silent on {where}: no frames{since}, offsets kept"
    else:
        line = f"{facts.phase} on {where}: {_learnt(setup, facts.row)}"
    troubles = [f"{bus.name} {bus.link.value.replace('_', ' ')}" for bus in facts.buses if bus.link != Link.UP]
    if facts.output_refused:
        troubles.append("output refused: another sender on our ids")
    if facts.state_file.problem:
        troubles.append("offsets can't be saved")
    # Trouble first: the line may be cut.
    line = " ".join("; ".join([*troubles, line]).split())
    return line if len(line) <= _LONGEST_LINE else line[: _LONGEST_LINE - 3] + "..."


def _silence(facts: LiveFacts) -> str:
    heard = [counts.last_t_ns for counts in facts.decoder.messages.values() if counts.last_t_ns is not None]
    last_ns = max(heard, default=facts.started_ns)
    return f"{max(0.0, _age_s(facts.now_ns, last_ns)):.0f} s"


def _learnt(setup: Setup, row: Row | None) -> str:
    if row is None or not setup.channels:
        return "no row yet"
    outputs = {name: getattr(row.output, name) for name in setup.channels}
    converged = sum(output.state == ChannelState.CONVERGED for output in outputs.values())
    found = f"{converged} of {len(outputs)} channels converged"
    first = next(name for name in _SHOWN_FIRST if name in outputs)
    offset = outputs[first].offset
    if not math.isfinite(offset):
        return found
    shown = f"{offset * _DEG:+.2f} deg/s" if first in GYRO_CHANNELS else f"{offset:+.2f} m/s^2"
    return f"{CHANNEL_WORDS[first]} {shown} offset, {found}"
