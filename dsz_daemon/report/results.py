"""The numbers of the table, per channel, straight from the samples. Pure; SI throughout."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.report.display import Floats, Samples, channel_column
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, REFERENCE_OF

NAN = float("nan")


class Level(NamedTuple):
    """Mean and root mean square of raw and compensated, over the rows that have a value."""

    raw_mean: float
    compensated_mean: float
    raw_rms: float
    compensated_rms: float


class ChannelResult(NamedTuple):
    """One channel over the whole run.

    `offset` and `offset_std` are the last ones; `state` and `reason` those of the last row;
    `gate_share` the share of rows in which the offset was learning, `closed_share` how much of
    the time each reason kept it from learning; `converged_after_s` counts from the first row.
    `error` is against the truth, `difference` against the mapped unit named `reference`.
    """

    channel: str
    offset: float
    offset_std: float
    state: str
    reason: str
    gate_share: float
    closed_share: dict[str, float]
    converged_after_s: float
    level: Level
    true_offset: float = NAN
    error: Level | None = None
    reference: str = ""
    difference: Level | None = None

    @property
    def offset_error(self) -> float:
        """Estimated minus true offset."""
        return self.offset - self.true_offset

    @property
    def error_in_spreads(self) -> float:
        """Offset error over its published standard deviation."""
        return self.offset_error / self.offset_std if self.offset_std > 0 else NAN


def column(samples: Samples, name: str) -> Floats | None:
    """Return a column of numbers, or None when it is missing or has no single finite value."""
    if name not in samples:
        return None
    try:
        values = np.asarray(samples[name], dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return values if np.any(np.isfinite(values)) else None


def row_count(samples: Samples) -> int:
    """Rows that have a time."""
    time_s = column(samples, "time_s")
    return 0 if time_s is None else int(np.count_nonzero(np.isfinite(time_s)))


def seconds(samples: Samples) -> Floats:
    """Seconds since the first row, shape (rows,)."""
    time_s = np.asarray(samples["time_s"], dtype=np.float64)
    return np.asarray(time_s - time_s[np.isfinite(time_s)][0], dtype=np.float64)


def mapped_channels(samples: Samples, summary: Mapping[str, Any]) -> list[str]:
    """IMU channels that the samples or the summary know, in the vocabulary's order."""
    told = mapping(summary.get("channels"))
    return [c for c in IMU_CHANNELS if channel_column(c) in samples or c in told]


def truth_at(samples: Samples, truth: Samples | None, name: str) -> Floats | None:
    """Return a column of the truth at the samples' times (linear), NaN outside its span."""
    if truth is None:
        return None
    values, truth_s = column(truth, name), column(truth, "time_s")
    if values is None or truth_s is None or len(values) != len(truth_s):
        return None
    good = np.isfinite(values) & np.isfinite(truth_s)
    return np.interp(samples["time_s"], truth_s[good], values[good], left=np.nan, right=np.nan)


def channel_result(channel: str, samples: Samples, summary: Mapping[str, Any], truth: Samples | None) -> ChannelResult:
    """Everything the table says of one channel; what the samples lack comes from the summary."""
    told = mapping(mapping(summary.get("channels")).get(channel))
    reference = f"{REFERENCE_OF[channel]}_{QUANTITIES[channel].suffix}"
    true_offset = truth_at(samples, truth, channel_column(channel, "offset"))
    return ChannelResult(
        channel=channel,
        offset=_last(samples, channel_column(channel, "offset"), told.get("offset")),
        offset_std=_last(samples, channel_column(channel, "offset_std"), told.get("offset_std")),
        state=_last_word(samples, f"{channel}_state", told.get("state")),
        reason=_last_word(samples, f"{channel}_reason", told.get("reason")),
        gate_share=_gate_share(samples, channel),
        closed_share=_closed_share(samples, channel),
        converged_after_s=_converged_after_s(samples, channel),
        level=_level(samples, channel) or Level(NAN, NAN, NAN, NAN),
        true_offset=NAN if true_offset is None else _last_finite(true_offset),
        error=_level_minus(samples, channel, truth_at(samples, truth, channel_column(channel))),
        reference=REFERENCE_OF[channel] if column(samples, reference) is not None else "",
        difference=_level_minus(samples, channel, column(samples, reference)),
    )


def mapping(value: Any) -> Mapping[str, Any]:
    """`value` if it is a mapping, else an empty one: a summary may lack anything."""
    return value if isinstance(value, Mapping) else {}


def _last_finite(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if len(finite) else NAN


def _last(samples: Samples, name: str, told: Any) -> float:
    values = column(samples, name)
    if values is not None:
        return _last_finite(values)
    return float(told) if isinstance(told, (int, float)) else NAN


def _last_word(samples: Samples, name: str, told: Any) -> str:
    words = samples.get(name)
    if words is not None and len(words):
        return str(words[-1])
    return str(told or "")


def _gate_share(samples: Samples, channel: str) -> float:
    gate = column(samples, f"{channel}_gate")
    return NAN if gate is None else float(np.mean(gate > 0))


def _closed_share(samples: Samples, channel: str) -> dict[str, float]:
    """Share of all rows per reason, the largest first."""
    gate, reasons = samples.get(f"{channel}_gate"), samples.get(f"{channel}_reason")
    if gate is None or reasons is None or not len(reasons):
        return {}
    counted = Counter(str(r) for r in reasons[~np.asarray(gate, dtype=bool)])
    return {reason: n / len(reasons) for reason, n in counted.most_common() if reason != "none"}


def _converged_after_s(samples: Samples, channel: str) -> float:
    states = samples.get(f"{channel}_state")
    if states is None or not row_count(samples):
        return NAN
    converged = np.flatnonzero(np.asarray(states) == "converged")
    return float(seconds(samples)[converged[0]]) if len(converged) else NAN


def _level(samples: Samples, channel: str) -> Level | None:
    """Mean and RMS of the readings, over the rows in which both have a value."""
    raw = column(samples, channel_column(channel, "raw"))
    compensated = column(samples, channel_column(channel))
    return None if raw is None or compensated is None else _levels(raw, compensated)


def _level_minus(samples: Samples, channel: str, against: Floats | None) -> Level | None:
    """The same of the readings minus `against`, which may be missing."""
    raw = column(samples, channel_column(channel, "raw"))
    compensated = column(samples, channel_column(channel))
    if raw is None or compensated is None or against is None:
        return None
    return _levels(raw - against, compensated - against)


def _levels(raw: Floats, compensated: Floats) -> Level | None:
    common = np.isfinite(raw) & np.isfinite(compensated)
    if not np.any(common):
        return None
    r, c = raw[common], compensated[common]
    return Level(float(np.mean(r)), float(np.mean(c)), float(np.sqrt(np.mean(r**2))), float(np.sqrt(np.mean(c**2))))
