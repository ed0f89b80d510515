"""What an effect can't be, however well it fits."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.effects import INDEX
from dsz_daemon.diagnose.fit import Fit
from dsz_daemon.diagnose.prediction import Drive

# So far may the furthest readings, but for some, stand beyond a limit that they clip at.
_BEYOND, _NEARLY_ALL = 1.1, 0.999


def is_implausible(drive: Drive, fit: Fit, effect: str) -> bool:
    """Whether a parameter that is told stands at the end of what is plausible: then something else is wrong."""
    if effect == "sensor_saturation" and _reads_beyond(drive, fit):
        return True
    for i in drive.vocabulary.columns_of(effect):
        parameter = drive.vocabulary.columns[i][1]
        at_end = any(end != 0.0 and abs(fit.x[i] - end) < 1e-6 * abs(end) for end in (parameter.low, parameter.high))
        if at_end and math.isfinite(parameter.least):
            return True
    return False


def _reads_beyond(drive: Drive, fit: Fit) -> bool:
    """Whether there are readings far beyond a limit that is said to be theirs."""
    for first, name in ((0, "gyro_limit_radps"), (3, "accel_limit_mps2")):
        limit = fit.x[INDEX[f"sensor_saturation.{name}"]]
        read = np.nan_to_num(drive.measured[:, first : first + (3 if first == 0 else 2)])
        if limit > 0.0 and float(np.quantile(np.max(np.abs(read), axis=1), _NEARLY_ALL)) > _BEYOND * limit:
            return True
    return False
