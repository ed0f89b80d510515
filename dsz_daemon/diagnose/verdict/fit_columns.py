"""The fit over time, for a file: what was measured, simulated as configured, and with the causes in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from dsz_daemon.diagnose.residuals.comparison import own_offsets
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.verdict.told_roads import told_road
from dsz_daemon.signals import IMU_CHANNELS


def columns_of_fit(found: Search, first_s: float, causes: Collection[str]) -> Mapping[str, Floats]:
    """A row per step of the simulation: what was measured, the nominal and the fitted simulation, and the profiles.

    `causes`: what was said to be left out.
    """
    drive, best = found.drive, found.best
    road = told_road(drive, best, causes)[0]
    nominal = predicted(drive, found.nominal.x, found.nominal.road)
    fitted = predicted(drive, best.x, best.road)
    if found.rows.piece is not None and drive.recording.piece is not None:
        for shown in (nominal, fitted):
            more = own_offsets(found.rows, found.rows.measured - shown[found.rows.at])
            shown[:, : len(IMU_CHANNELS)] += more[drive.recording.piece]
    columns: dict[str, Floats] = {"time_s": np.asarray(first_s + drive.recording.time_s)}
    theirs = np.zeros_like(nominal) if drive.theirs is None else drive.theirs
    for c, channel in enumerate(CHANNELS):
        if np.isfinite(drive.measured[:, c]).any():
            columns[f"{channel}_measured"] = drive.measured[:, c] + theirs[:, c]
            columns[f"{channel}_nominal"] = nominal[:, c] + theirs[:, c]
            columns[f"{channel}_fitted"] = fitted[:, c] + theirs[:, c]
    return columns | {"road_bank_rad": road.bank_rad, "road_grade_up_rad": road.grade_rad, "side_wind_n": road.side_n}
