"""How well each channel fits, before and after, on rows that a fit has seen and on those that it has not."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import floors
from dsz_daemon.diagnose.residuals.flexible import flexible_rms
from dsz_daemon.diagnose.residuals.locate import channel_names
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.simulation.drive import Floats
from dsz_daemon.diagnose.simulation.prediction import ALONG
from dsz_daemon.diagnose.verdict.said import ChannelFit, Sides
from dsz_daemon.signals import GYRO_CHANNELS, IMU_CHANNELS


def goodness(found: Search) -> dict[str, ChannelFit]:
    """RMS per channel: nominal with offsets and stiffnesses, and with the causes; on seen and on unseen blocks."""
    floor, least = floors(found.drive), flexible_rms(found.drive, found.rows, found.best.left)

    def rms(fit: Fit, unseen: bool) -> Floats:
        n = np.maximum(fit.sums.counts.sum(axis=0), 1.0)
        total = fit.unseen.sum(axis=0) if unseen else (fit.sums.left * fit.scatter**2).sum(axis=0)
        if unseen and fit.along is not None:
            total[ALONG] = fit.along[0].sum()
        return np.asarray(np.sqrt(np.maximum(total, 0.0) / n), dtype=np.float64)

    seen, unseen = ((rms(found.nominal, side), rms(found.best, side)) for side in (False, True))
    return {
        channel: ChannelFit(
            Sides(float(seen[0][c]), float(seen[1][c])),
            Sides(float(unseen[0][c]), float(unseen[1][c])),
            float(floor[c]),
            float(least[c]) if math.isfinite(least[c]) else None,
            _unit(channel),
        )
        for c, channel in enumerate(channel_names(found.drive))
        if found.rows.used[:, c].any()
    }


def _unit(channel: str) -> str:
    if channel in GYRO_CHANNELS or channel.endswith("_radps"):
        return "rad/s"
    return "m/s^2" if channel in IMU_CHANNELS else "rad" if channel.endswith("_rad") else "m/s"
