"""What a run comes to: `summary.json`, gathered row by row."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dsz_daemon.errors import MachineError
from dsz_daemon.pipeline.cycles import Cycle, CycleWatch
from dsz_daemon.pipeline.decode import DecodeCounters
from dsz_daemon.pipeline.histogram import Histogram
from dsz_daemon.pipeline.plausibility import Plausibility
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs.never_received import never_received
from dsz_daemon.runs.setup import Setup, versions
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, REFERENCE_OF


@dataclass
class _Mean:
    n: int = 0
    total: float = 0.0

    def add(self, value: float) -> None:
        if not math.isnan(value):
            self.n += 1
            self.total += value

    @property
    def value(self) -> float | None:
        return self.total / self.n if self.n else None


@dataclass
class _Channel:
    raw: _Mean = field(default_factory=_Mean)
    compensated: _Mean = field(default_factory=_Mean)
    # Against another unit's reading of the same quantity, over the rows that have all three.
    shared_raw: _Mean = field(default_factory=_Mean)
    shared_compensated: _Mean = field(default_factory=_Mean)
    reference: _Mean = field(default_factory=_Mean)
    states: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    open_rows: int = 0
    converged_after_s: float | None = None


class RunSummary:
    """Takes every row; `result` is the whole of `summary.json`."""

    def __init__(self, setup: Setup, plausibility: Plausibility) -> None:
        self._setup, self._plausibility = setup, plausibility
        self._channels = {name: _Channel() for name in setup.channels}
        self._ages_ms: dict[str, Histogram] = {}
        # The longest that each role was away and came back.
        self._longest_age_s: dict[str, float] = {}
        self.rows = 0
        self._first_ns = self._passed_ns = 0
        self._last: Row | None = None
        self.events: list[dict[str, Any]] = []

    def add(self, row: Row) -> None:
        """Takes one row into account."""
        if self.rows == 0:
            self._first_ns = row.t_ns
        self.rows += 1
        # A clock that is set is no time that passed.
        if self._last is not None and row.event != "clock_step":
            self._passed_ns += row.t_ns - self._last.t_ns
        before_s = self._last.ages_s if self._last else {}
        self._last = row
        if row.event not in {"", "start"} and len(self.events) < 1000:
            self.events.append({"time_s": row.t_ns * 1e-9, "event": row.event})
        self._plausibility.watch(row)
        for name, channel in self._channels.items():
            self._add_channel(name, channel, row)
        for role, age_s in row.ages_s.items():
            ages_ms = self._ages_ms.get(role)
            if ages_ms is None:
                ages_ms = self._ages_ms[role] = Histogram(digits=2)
            ages_ms.add(round(age_s * 1000.0))
            if before_s.get(role, 0.0) > max(age_s, self._longest_age_s.get(role, 0.0)):
                self._longest_age_s[role] = before_s[role]

    def _add_channel(self, name: str, channel: _Channel, row: Row) -> None:
        output = getattr(row.output, name)
        channel.raw.add(output.raw)
        channel.compensated.add(output.compensated)
        channel.states[output.state.name.lower()] += 1
        channel.open_rows += output.gate
        if not output.gate:
            channel.reasons[output.reason.name.lower()] += 1
        if channel.converged_after_s is None and output.state.name == "CONVERGED":
            channel.converged_after_s = self.duration_s
        reference = row.inputs.get(REFERENCE_OF[name], math.nan)
        if not math.isnan(reference + output.compensated):
            channel.reference.add(reference)
            channel.shared_raw.add(output.raw)
            channel.shared_compensated.add(output.compensated)

    @property
    def duration_s(self) -> float:
        """What passed from the first row to the last, but for steps of the clock."""
        return self._passed_ns * 1e-9

    def _channel_result(self, name: str) -> dict[str, Any]:
        channel = self._channels[name]
        output = getattr(self._last.output, name) if self._last else None
        rows = max(1, self.rows)
        result: dict[str, Any] = {
            "unit": QUANTITIES[name].si_unit,
            "offset": output.offset if output else None,
            "offset_std": output.offset_std if output else None,
            "state": output.state.name.lower() if output else "invalid",
            "reason": output.reason.name.lower() if output else "no_rows",
            "raw_mean": channel.raw.value,
            "compensated_mean": channel.compensated.value,
            "learning_share": channel.open_rows / rows,
            "held_because": dict(channel.reasons.most_common()),
            "state_rows": dict(channel.states),
            "converged_after_s": channel.converged_after_s,
        }
        if channel.reference.n:
            result["reference"] = {
                "role": REFERENCE_OF[name],
                "rows": channel.reference.n,
                "raw_mean": channel.shared_raw.value,
                "compensated_mean": channel.shared_compensated.value,
                "reference_mean": channel.reference.value,
            }
        return result

    def result(
        self,
        decoded: DecodeCounters,
        cycles: CycleWatch,
        published: Mapping[str, Any],
        source: Mapping[str, Any],
        missed_ticks: int = 0,
    ) -> dict[str, Any]:
        """The whole summary; `source` says where the frames came from, `published` where they went."""
        all_cycles = cycles.cycles()
        # Where somebody babbled, the message's own cycle can't be told.
        babbled = {can_id for can_id, name in self._message_ids() if decoded.messages[name].babbling}
        steady = [cycle for cycle in all_cycles if cycle.can_id not in babbled]
        last = self._last.counters if self._last else None
        setup = self._setup
        counts: dict[str, Any] = {
            "frames": decoded.frames,
            "samples": decoded.samples,
            "rejected": decoded.rejected,
            "missed": missed_ticks,
            "gaps": last.gaps if last else 0,
            "clock_steps": last.clock_steps if last else 0,
            "unwanted": decoded.unwanted,
            "own": decoded.own,
            "remote": decoded.remote,
            "error_frames": decoded.error_frames,
            "ambiguous": decoded.ambiguous,
            "lost_on_the_way": sum(cycle.missing for cycle in steady),
            "roles": {
                role: {
                    "samples": role_counts.samples,
                    "short": role_counts.short,
                    "not_present": role_counts.not_present,
                    "flagged": role_counts.flagged,
                    "not_a_number": role_counts.not_a_number,
                    "out_of_range": role_counts.out_of_range,
                }
                for role, role_counts in decoded.roles.items()
            },
            "messages": {
                name: {
                    "frames": message.frames,
                    "wrong_length": message.wrong_length,
                    "wrong_checksum": message.wrong_checksum,
                    "repeated": message.repeated,
                    "wrong_sequence": message.wrong_sequence,
                    "babbling": message.babbling,
                    "lost": message.lost,
                    "other_width": message.other_width,
                    "elsewhere": message.elsewhere,
                }
                for name, message in decoded.messages.items()
            },
        }
        return {
            "config": setup.path.name,
            "duration_s": self.duration_s,
            "rows": self.rows,
            "first_time_s": self._first_ns * 1e-9,
            "channels": {name: self._channel_result(name) for name in IMU_CHANNELS if name in self._channels},
            "counts": counts,
            "events": self.events,
            "warnings": [*setup.checked.warnings, *self._findings(decoded), *_lost(steady, bursts=True)],
            "notes": [*setup.checked.notes, *_lost(steady, bursts=False)],
            "cycles": [asdict(cycle) for cycle in all_cycles],
            "median_age_s": {role: (ages.median() or 0) / 1000.0 for role, ages in self._ages_ms.items()},
            "source": dict(source),
            "published": dict(published),
            "versions": versions(),
            "settings": setup.settings.model_dump(mode="json"),
        }

    def _message_ids(self) -> list[tuple[int, str]]:
        return [(message.frame_id, name) for name, message in self._setup.checked.resolved.messages.items()]

    def _findings(self, decoded: DecodeCounters) -> list[str]:
        words = [*self._plausibility.findings(), *_refused(decoded), *self._gone(decoded)]
        never = never_received(self._setup, decoded)
        words += [f"{role}: mapped, but never received ({why})" for role, why in never.items()]
        words += [
            f"{role}: {decoded.roles[role].words()}"
            for role in sorted(self._setup.roles - set(never))
            if decoded.roles[role].refuses_many
        ]
        if decoded.ambiguous:
            bound = sorted({f"{name} on {m.channel}" for name, m in decoded.messages.items() if m.channel is not None})
            words.append(
                f"{decoded.ambiguous} frames not used, which came on another interface than the first of their message "
                f"(first seen: {', '.join(bound)}); give their signals a channel"
            )
        return words

    def _gone(self, decoded: DecodeCounters) -> list[str]:
        """Signals that ended long before the run did: for longer than they ever were away before."""
        ages_s = self._last.ages_s if self._last else {}
        found: dict[str, list[str]] = {}
        for role in sorted(role for role in self._setup.roles if decoded.roles[role].samples):
            age_s = ages_s.get(role, math.inf)
            usual_s = max(2.0 * self._longest_age_s.get(role, 0.0), 5.0 * self._setup.settings.loop.stale_after_s)
            if age_s > usual_s:
                known = math.isfinite(age_s)
                since = f"in the last {age_s:.1f} s of the run" if known else "after the last gap in time"
                found.setdefault(since, []).append(role)
        return [f"{', '.join(roles)}: no value {since}" for since, roles in found.items()]


def _refused(decoded: DecodeCounters) -> list[str]:
    """Messages of which more than a few frames were refused as a whole, or lost by their own alive counter."""
    words = []
    for name, message in decoded.messages.items():
        came = message.frames + message.refused
        if message.babbling or message.refused > 0.01 * came:
            words.append(
                f"{name}: {message.refused} of {came} frames refused (wrong checksum {message.wrong_checksum}, "
                f"repeated counter {message.repeated}, counter out of sequence {message.wrong_sequence}, "
                f"beyond loop.input_rate_limit_hz {message.babbling})"
            )
        if message.lost > 0.01 * came:
            words.append(f"{name}: {message.lost} frames lost by its alive counter, {came} came")
    return words


# Some cars skip single frames as a rule: that is a note. Longer holes are a warning.
_BURST_CYCLES = 3.0


def _lost(cycles: list[Cycle], bursts: bool) -> list[str]:
    return [
        f"{cycle.channel} {cycle.can_id:03X}: {cycle.missing} frames ({100.0 * cycle.missing_share:.1f} %) are missing "
        f"from its cycle of {1000.0 * cycle.cycle_s:.1f} ms (longest gap {cycle.longest_gap_s:.2f} s)"
        for cycle in cycles
        if cycle.missing_share > 0.01 and (cycle.longest_gap_s > _BURST_CYCLES * cycle.cycle_s) == bursts
    ]


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Writes JSON that any parser reads: numbers that are not finite become null."""
    try:
        path.write_text(json.dumps(finite(content), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise MachineError(f"{path}: can't write: {error.strerror or error}") from error


def finite(value: Any) -> Any:
    """The same content with numbers that are not finite as None (JSON has no NaN)."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
