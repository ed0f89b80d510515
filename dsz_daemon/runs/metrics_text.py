"""A daemon's answer as Prometheus metrics: `dsz_` + what + unit, SI and radians as inside."""

from __future__ import annotations

import math
from itertools import accumulate
from typing import Any

from dsz_daemon.core.outputs import ChannelState, Reason
from dsz_daemon.edge.health import Link
from dsz_daemon.runs.exposition import Exposition
from dsz_daemon.signals import QUANTITIES

PHASES = ["waiting", "running", "silent"]
_STATES = [state.name.lower() for state in ChannelState]
_REASONS = [reason.name.lower() for reason in Reason]
_LINKS = [link.value for link in Link]
# Half decades from 10 us to 10 s: edges that the daemon's own bins (tenths of decades) share.
_LATENESS_EDGES_S = [10.0 ** (n / 2) for n in range(-10, 3)]

_CHANNEL_MEANINGS = {
    "raw": "reading of the sensor",
    "compensated": "reading minus offset",
    "offset": "estimated offset: reading minus truth",
    "offset_std": "standard deviation of the estimated offset",
}
# Counts whose name does not say it all; others are named as they are.
_MEANINGS = {
    "bus": {
        "received": "frames received, after the interface's filters",
        "sent": "own frames sent",
        "lost": "frames that the kernel dropped because they were not fetched in time",
        "dropped": "own frames that the interface did not take",
        "foreign": "frames with our own output ids that somebody else sent",
        "outages": "times that the interface went down or away",
    },
    "decoder": {
        "frames": "frames of any id",
        "unwanted": "frames that nothing is mapped to",
        "own": "frames with ids that this daemon publishes",
        "ambiguous": "frames of a wanted id on a second channel",
    },
    "message": {
        "frames": "frames used",
        "refused": "frames not used as a whole",
        "babbling": "frames beyond the rate bound",
        "lost": "frames that never came, by the alive counter",
        "wrong_length": "frames shorter or longer than the DBC says",
    },
    "role": {
        "short": "frames with too few bytes for the role's signals",
        "not_present": "frames whose multiplexer carried other signals",
        "flagged": "values that another signal did not vouch for",
        "rejected": "values that came but were not used",
    },
    "loop": {
        "frames": "frames that gave a sample",
        "gaps": "silences after which filters began anew",
        "rejected": "values and frames not used",
    },
}


def metrics_text(answer: dict[str, Any] | None) -> str:
    """The page for one answer; None (no daemon): `dsz_up 0` and nothing else."""
    page = Exposition()
    page.gauge("dsz_up", "1 if the daemon answers on its status socket", float(answer is not None))
    if answer is not None:
        _daemon(page, answer)
        _channels(page, answer["channels"])
        _motion_and_inputs(page, answer)
        _counts(page, answer)
        _buses(page, answer["buses"])
        _lateness(page, answer["lateness"])
        _state_file(page, answer["state_file"])
    return page.text()


def _daemon(page: Exposition, answer: dict[str, Any]) -> None:
    versions = {key.replace("-", "_"): str(value) for key, value in answer["versions"].items()}
    page.gauge("dsz_info", "versions and configuration in use", 1.0, {**versions, "config": answer["config"]})
    page.one_of("dsz_phase", "what the daemon is doing", "phase", PHASES, answer["phase"], {})
    page.gauge("dsz_start_time_seconds", "bus time when the daemon began", answer["started_s"])
    page.gauge("dsz_uptime_seconds", "bus time since then", answer["uptime_s"])
    page.gauge("dsz_tick_rate_hertz", "rows a second", answer["rate_hz"])
    page.counter("dsz_rows_total", "steps of the estimator", answer["rows"])
    page.counter("dsz_missed_ticks_total", "ticks estimated too late to be published", answer["missed_ticks"])
    page.counter("dsz_timer_overruns_total", "timer expirations nobody came for", answer["timer_overruns"])
    page.counter("dsz_reloads_total", "configurations taken over while running", answer["reloads"])
    page.gauge(
        "dsz_output_refused", "1 while silent because another sender uses our ids", float(answer["output_refused"])
    )
    if answer["row"] is not None:
        page.gauge("dsz_row_age_seconds", "age of the last row", answer["row"]["age_s"])


def _channels(page: Exposition, channels: dict[str, Any]) -> None:
    for name, channel in channels.items():
        labels, suffix = {"channel": name}, QUANTITIES[name].suffix
        for what, meaning in _CHANNEL_MEANINGS.items():
            page.gauge(f"dsz_{what}_{suffix}", f"{meaning}, {QUANTITIES[name].si_unit}", channel[what], labels)
        page.gauge("dsz_learning", "1 while the offset is learning", float(channel["gate"]), labels)
        page.one_of("dsz_channel_state", "trust in the channel", "state", _STATES, channel["state"], labels)
        meaning = "why the channel is not learning"
        page.one_of("dsz_channel_reason", meaning, "reason", _REASONS, channel["reason"], labels)


def _motion_and_inputs(page: Exposition, answer: dict[str, Any]) -> None:
    for name, value in answer["motion"].items():
        page.gauge(f"dsz_motion_{name}", f"{name.replace('_', ' ')}, SI", None if value is None else float(value))
    for role, given in answer["inputs"].items():
        quantity = QUANTITIES[role]
        name = "_".join(part for part in ("dsz_input", quantity.suffix) if part)
        page.gauge(name, f"input as used at the last row, {quantity.si_unit}", given["value"], {"role": role})
        page.gauge("dsz_input_age_seconds", "age of that input", given["age_s"], {"role": role})


def _count(page: Exposition, of: str, section: dict[str, Any], labels: dict[str, str] | None = None) -> None:
    for name, count in section.items():
        if isinstance(count, int) and not isinstance(count, bool):
            meaning = _MEANINGS[of].get(name, name.replace("_", " "))
            page.counter(f"dsz_{of}_{name}_total", f"{of}: {meaning}", count, labels)


def _counts(page: Exposition, answer: dict[str, Any]) -> None:
    decoder = answer["decoder"]
    _count(page, "decoder", decoder)
    for role, counts in decoder["roles"].items():
        _count(page, "role", counts, {"role": role})
    for message, counts in decoder["messages"].items():
        labels = {"message": message, "bus": counts["channel"] or ""}
        _count(page, "message", counts, labels)
        page.gauge("dsz_message_age_seconds", "time since the last frame used", counts["age_s"], labels)
    if answer["row"] is not None:
        _count(page, "loop", answer["row"]["counters"])
    page.counter("dsz_encoder_rows_total", "rows encoded", answer["encoder"]["rows"])
    for signal, count in answer["encoder"]["saturated"].items():
        page.counter("dsz_encoder_saturated_total", "values sent as the end of their range", count, {"signal": signal})


def _buses(page: Exposition, buses: list[dict[str, Any]]) -> None:
    for bus in buses:
        labels = {"bus": bus["name"], "interface": bus["interface"]}
        page.one_of("dsz_bus_link", "what the interface is doing", "link", _LINKS, bus["link"], labels)
        _count(page, "bus", bus, labels)


def _lateness(page: Exposition, lateness: dict[str, Any]) -> None:
    bins = [(math.inf if edge_us is None else edge_us * 1e-6, count) for edge_us, count in lateness["bins"]]
    seen = list(accumulate((count for _, count in bins), initial=0))
    # The edges are equal but for rounding: half a bin's width keeps them apart.
    below = [(edge_s, seen[sum(upper_s < edge_s * 1.1 for upper_s, _ in bins)]) for edge_s in _LATENESS_EDGES_S]
    meaning = "how late the ticks of the loop came"
    page.histogram("dsz_tick_lateness_seconds", meaning, below, lateness["ticks"], lateness["sum_us"] * 1e-6)
    page.gauge("dsz_tick_lateness_max_seconds", "the latest of all", lateness["max_us"] * 1e-6)


def _state_file(page: Exposition, state: dict[str, Any]) -> None:
    page.gauge("dsz_state_saved_age_seconds", "time since the offsets were last saved", state["saved_age_s"])
    page.gauge("dsz_state_restored_age_seconds", "age of the offsets begun with", state["restored_age_s"])
    page.gauge("dsz_state_problem", "1 while the offsets can't be kept as wanted", float(bool(state["problem"])))
