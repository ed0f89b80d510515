"""What an effect of a fit does to the channels: the prediction with it, less that without it."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted


def shown_by(drive: Drive, fit: Fit, effect: str) -> Floats:
    """What an effect of a fit does to all channels (n, 13), its profile included."""
    x, road, none = fit.x.copy(), fit.road, np.zeros(len(drive.steer))
    x[list(drive.vocabulary.columns_of(effect))] = 0.0
    if effect == "road_bank":
        road = road._replace(bank_rad=none)
    elif effect == "road_grade":
        road = road._replace(grade_rad=none)
    elif effect == "side_wind":
        road = road._replace(side_n=none)
    return predicted(drive, fit.x, fit.road) - predicted(drive, x, road)
