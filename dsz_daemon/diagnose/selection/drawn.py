"""How a simulation is drawn: what is told of that before anything is left out, as soon as it is, and once more."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.fitting.drawings import as_drawn, told, untold
from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.gains import far_off, gained
from dsz_daemon.diagnose.fitting.model import Fit
from dsz_daemon.diagnose.residuals.comparison import Each, Rows
from dsz_daemon.diagnose.simulation.drive import Drive, nothing
from dsz_daemon.diagnose.simulation.pulls import by_force

# How well what comes before anything else, or stays, is fitted.
WELL = 2e-5
_RADII, _OTHER_WHEELS = ("wheel_radius",), slice(6, 8)


def refitted(drive: Drive, rows: Rows, tolerance: Mapping[str, float], each: Each) -> Fit:
    """The nominal simulation's own numbers; of a car that pulls aside by much, by what it does so, too."""
    level = nothing(drive.vocabulary)
    start = untold(level, drive.steer)
    if not np.array_equal(start, level):
        # Roughly first: how wheels are drawn is told by far, or not yet.
        roughly = fitted(drive, rows, start, (), tolerance, each=each)
        so = as_drawn(roughly.x, roughly.std, roughly.columns)
        start = roughly.x if so is None else so
    nominal = fitted(drive, rows, start, (), tolerance, WELL, each)
    pulled = by_force(nominal.x, nominal.std, nominal.columns)
    return nominal if pulled is None else fitted(drive, rows, pulled, (), tolerance, WELL, each)


def drawn(drive: Drive, rows: Rows, fit: Fit, tolerance: Mapping[str, float], each: Each) -> Fit:
    """The model with front wheels that roll one way or another, as soon as that is told.

    And anew where it was told before radii were that are others: front wheels that read 2 % more all the way look as if
    they were never turned. Then they are far off wherever they are turned less, or not.
    """
    so = as_drawn(fit.x, fit.std, fit.columns)
    if so is not None:
        return fitted(drive, rows, so, fit.effects, tolerance, WELL, each, felt=fit.felt)
    if fit.effects[-1:] != _RADII or not told(fit.x) or not far_off(drive, fit)[_OTHER_WHEELS].any():
        return fit
    start = untold(fit.x, drive.steer)
    anew = fitted(drive, rows, start, fit.effects, tolerance, each=each, felt=fit.felt)
    so = as_drawn(anew.x, anew.std, anew.columns)
    anew = fitted(drive, rows, anew.x if so is None else so, fit.effects, tolerance, WELL, each, felt=fit.felt)
    return anew if gained(drive, fit, anew) > 0.0 else fit
