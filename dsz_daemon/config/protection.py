"""The `protection` section: which input messages carry a checksum and an alive counter, and of what kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.config.sections import Section, Text, Whole
from dsz_daemon.pipeline.checksums import E2E_PROFILES
from dsz_daemon.pipeline.protection import Checksum, Counter, E2e, Protection

Loc = tuple[str | int, ...]

# AUTOSAR's profile 2 has a Data ID for each value of its counter; one alone stands for all.
_MANY_IDS = 16

_MaxLost = Annotated[
    Whole | None,
    Field(ge=0, le=254, description="frames in a row that may be lost before the sender counts as another one"),
]
_DataIds = Annotated[
    tuple[Annotated[Whole, Field(ge=0, le=0xFFFF)], ...],
    BeforeValidator(
        lambda given: given if isinstance(given, list | tuple) else [given],
        json_schema_input_type=int | list[int],
    ),
    Field(min_length=1, max_length=_MANY_IDS),
]


class CounterSettings(Section):
    """An alive counter: one more with every frame, and round again."""

    signal: Text = Field(description="signal name in the DBC")
    last: Whole | None = Field(
        None, ge=1, le=0xFFFFFFFF, description="highest value, then 0 again; all of its bits, where not given"
    )
    max_lost: _MaxLost = None


class ChecksumSettings(Section):
    """A checksum over the message."""

    method: Literal["toyota", "honda", "crc8_sae_j1850", "xor", "sum8"]
    signal: Text | None = Field(None, description="signal name in the DBC; the last byte, where not given")


class E2eSettings(Section):
    """AUTOSAR end-to-end protection: CRC and counter in the message's first bytes."""

    profile: Literal[1, 2, 5, 11]
    data_id: _DataIds = Field(description="the message's Data ID; for profile 2 one, or sixteen (one a counter value)")
    data_id_mode: Literal["both", "alternating", "low", "nibble"] = "both"
    max_lost: _MaxLost = None


class ProtectionSettings(Section):
    """One message's protection: counter, checksum or both; or AUTOSAR E2E, which is both."""

    counter: CounterSettings | None = None
    checksum: ChecksumSettings | None = None
    e2e: E2eSettings | None = None

    def of(self, message: str) -> Protection:
        """As the pipeline takes it."""
        counter, checksum, e2e = self.counter, self.checksum, self.e2e
        return Protection(
            message,
            Counter(counter.signal, counter.last, counter.max_lost) if counter else None,
            Checksum(checksum.method, checksum.signal) if checksum else None,
            E2e(e2e.profile, e2e.data_id, e2e.data_id_mode, e2e.max_lost) if e2e else None,
        )


def protection_faults(section: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
    """What no single key shows, of the plain data: nothing to check, two kinds at once, Data IDs of another profile."""
    for message, entry in section.items():
        if not isinstance(entry, Mapping):
            continue
        loc: Loc = ("protection", message)
        given = [key for key in ("counter", "checksum", "e2e") if entry.get(key) is not None]
        if not given and not set(entry) - {"counter", "checksum", "e2e"}:
            yield loc, "says nothing; expected counter, checksum or e2e"
        if "e2e" in given and len(given) > 1:
            yield (*loc, "e2e"), f"is given beside {given[0]}; expected e2e alone, which has a checksum and a counter"
        e2e = entry.get("e2e")
        if isinstance(e2e, Mapping):
            yield from _e2e_faults((*loc, "e2e"), e2e)


def _e2e_faults(loc: Loc, e2e: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
    number = e2e.get("profile")
    profile = E2E_PROFILES.get(number) if isinstance(number, int) else None
    if profile is None:
        return
    ids = e2e.get("data_id")
    many = ids if isinstance(ids, list | tuple) else [ids]
    if len(many) != 1 and not (number == 2 and len(many) == _MANY_IDS):
        expected = f"one, or {_MANY_IDS} (one a counter value)" if number == 2 else "one"
        yield (*loc, "data_id"), f"{len(many)} of them; expected {expected} for profile {number}"
    for data_id in many:
        if isinstance(data_id, int) and profile.largest_data_id < data_id <= 0xFFFF:
            yield (
                (*loc, "data_id"),
                f"0x{data_id:X} is not a Data ID of profile {number}; expected 0 to 0x{profile.largest_data_id:X}",
            )
            break
    mode, modes = e2e.get("data_id_mode"), profile.data_id_modes
    if mode in {"both", "alternating", "low", "nibble"} and mode not in modes:
        expected = f"{' or '.join(modes)}{did_you_mean(str(mode), modes)}" if modes else "no such key"
        yield (*loc, "data_id_mode"), f"{mode!r} is not of profile {number}; expected {expected}"
