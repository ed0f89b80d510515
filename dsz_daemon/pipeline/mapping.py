"""Where each role of the vocabulary comes from, resolved: what decode needs and no more.

The configuration is turned into these (units already looked up), so that this floor knows
nothing of YAML or of how a user writes things.
"""

from __future__ import annotations

from typing import NamedTuple


class Part(NamedTuple):
    """One signal of a sum, with its sign (+1 or -1)."""

    signal: str
    sign: float = 1.0


class Source(NamedTuple):
    """One role's source: SI value = sign * to_si * (unit value).

    Unit value: the sum of the parts' physical values; for an analog sensor
    (sum * volts_per_count - null_volts) / volts_per_unit instead.
    `to_si` is unit -> SI, wheel radius included where a wheel turns in rad/s or rpm.
    `on_values`: for switches, the physical values that mean "on" (empty: any nonzero one).
    `valid_signal`/`valid_values`: another signal of the same message that vouches for this
    one; a frame in which it has none of these values is counted as flagged and not used.
    Values outside [low, high] (SI) are counted as out of range and not used.
    """

    role: str
    message: str
    parts: tuple[Part, ...]
    to_si: float
    low: float
    high: float
    channel: str | None = None
    sign: float = 1.0
    volts_per_count: float | None = None
    null_volts: float = 0.0
    volts_per_unit: float = 1.0
    on_values: tuple[float, ...] = ()
    valid_signal: str | None = None
    valid_values: tuple[float, ...] = ()
    is_switch: bool = False


class Sample(NamedTuple):
    """One decoded value of one role: SI, stamped with its frame's time."""

    t_ns: int
    role: str
    value: float
