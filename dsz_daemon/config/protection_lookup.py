"""The `protection` section against the DBC: what decode checks, and every name and layout that does not fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from cantools.database.can import Message

from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.config.protection import ProtectionSettings
from dsz_daemon.edge.dbc import LoadedDbc
from dsz_daemon.errors import Fault
from dsz_daemon.pipeline.protection import Protection, problems

Where = Callable[[Sequence[str | int]], str]


class ProtectionLookup(NamedTuple):
    """The protections of mapped messages, and what is wrong with the section."""

    protections: tuple[Protection, ...]
    faults: tuple[Fault, ...]
    warnings: tuple[str, ...]


def protection_lookup(
    section: Mapping[str, ProtectionSettings],
    mapped: Mapping[str, Message],
    dbcs: Sequence[LoadedDbc],
    where: Where,
    complete: bool,
) -> ProtectionLookup:
    """Every entry looked up; `complete`: all DBC files could be read, so what is not in them is nowhere."""
    protections: list[Protection] = []
    faults: list[Fault] = []
    warnings: list[str] = []
    known = {message.name: message for dbc in reversed(dbcs) for message in reversed(dbc.database.messages)}
    for name, entry in section.items():
        message = mapped.get(name) or known.get(name)
        if message is None:
            if complete:
                files = ", ".join(dbc.name for dbc in dbcs)
                what = f"message {name!r} is not in {files}{did_you_mean(name, known)}"
                faults.append(Fault(where(("protection", name)), what))
            continue
        protection = entry.of(name)
        found = [
            Fault(where(("protection", name, *place)), what + _meant(place, protection, message))
            for place, what in problems(protection, message)
        ]
        faults += found
        if name not in mapped:
            warnings.append(
                f"{where(('protection', name))}: no signal is taken from message {name!r}: nothing to protect"
            )
        elif not found:
            protections.append(protection)
    return ProtectionLookup(tuple(protections), tuple(faults), tuple(warnings))


def _meant(place: tuple[str, ...], protection: Protection, message: Message) -> str:
    """Near misses of a signal that is not in the message."""
    part = {"counter": protection.counter, "checksum": protection.checksum}.get(place[0])
    names = [signal.name for signal in message.signals]
    if part is None or part.signal is None or part.signal in names:
        return ""
    return did_you_mean(part.signal, names)
