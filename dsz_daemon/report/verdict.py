"""The one sentence at the top of the page. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dsz_daemon.report.display import SIGMA, SPREADS_95, duration, number, words
from dsz_daemon.report.results import ChannelResult

# What one channel does at the end, what several do.
_FATES = {
    "learning": ("is still learning", "are still learning"),
    "holding": ("holds its offset", "hold their offsets"),
    "invalid": ("is invalid at the end", "are invalid at the end"),
}


def verdict(results: Sequence[ChannelResult], rows: int, warnings: int) -> str:
    """Say how far the channels came, how good that is where a truth is known, and what to look at."""
    if not rows:
        return "No step was written, so there is nothing to show but what was counted."
    if not results:
        return "No IMU channel is mapped, so there was nothing to zero."
    parts = [_convergence(results), *_unfinished(results), *_against_truth(results)]
    if warnings:
        parts.append(f"{warnings} warning{'s' if warnings > 1 else ''} below")
    return "; ".join(parts) + "."


def _convergence(results: Sequence[ChannelResult]) -> str:
    total = len(results)
    converged = [r for r in results if r.state == "converged"]
    if len(converged) < total:
        return f"{len(converged) or 'None'} of {total} channel{'s' if total > 1 else ''} converged"
    last_s = max(r.converged_after_s for r in converged)
    subject = "The one mapped channel" if total == 1 else f"All {total} channels"
    when = f" within {duration(last_s)}" if np.isfinite(last_s) else ""
    return f"{subject} converged{when}"


def _unfinished(results: Sequence[ChannelResult]) -> list[str]:
    """What became of the others, those with the same fate and the same main reason together."""
    alike: dict[tuple[str, str], list[str]] = {}
    for result in results:
        if result.state in _FATES:
            reason = next(iter(result.closed_share), "") if result.state != "learning" else ""
            alike.setdefault((result.state, reason), []).append(result.channel)
    return [
        f"{_listed(names)} {_FATES[state][len(names) > 1]}{f' (mostly {words(reason)})' if reason else ''}"
        for (state, reason), names in alike.items()
    ]


def _against_truth(results: Sequence[ChannelResult]) -> list[str]:
    known = [r for r in results if np.isfinite(r.error_in_spreads)]
    if not known:
        return []
    outside = [r for r in known if abs(r.error_in_spreads) > SPREADS_95]
    if not outside:
        every = "every offset is" if len(known) > 1 else "the offset is"
        return [f"{every} within its 95 % spread of the truth"]
    listed = [f"{r.channel} ({number(r.error_in_spreads, 1, sign=True)}{SIGMA})" for r in outside]
    return [f"outside {'its' if len(listed) == 1 else 'their'} 95 % spread of the truth: {_listed(listed)}"]


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
