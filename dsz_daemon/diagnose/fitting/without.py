"""A model without some of its effects: fitted again, or by the slopes of the larger one where that tells enough."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from dsz_daemon.diagnose.fitting.fit import fitted
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, Fit, Slopes
from dsz_daemon.diagnose.residuals.comparison import Each, Rows, sensitivities
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.simulation.prediction import predicted

# What an effect gains by slopes that are not quite the place's, for that to be enough to know that it stays.
_SURELY = 3.0 * LEAST_GAIN


def slopes_at(drive: Drive, rows: Rows, fit: Fit, each: Each = map) -> Slopes:
    """The slopes of a fit's own columns at its end."""
    base = predicted(drive, fit.x, fit.road)
    slopes = sensitivities(drive, rows, fit.x, fit.road, base, fit.columns, fit.felt, each)
    return Slopes(fit.x, fit.effects, fit.columns, slopes)


def without(
    drive: Drive,
    rows: Rows,
    best: Fit,
    tolerance: Mapping[str, float],
    effects: Collection[str],
    each: Each = map,
    known: Slopes | None = None,
) -> Fit:
    """The model fitted again without these effects; roughly, by slopes that are `known` of it with them."""
    start = best.x.copy()
    for effect in effects:
        start[list(drive.vocabulary.columns_of(effect))] = 0.0
    rest = tuple(name for name in best.effects if name not in effects)
    if known is not None:
        # On another road all slopes are others.
        known = None if OWN_CHANNEL.keys() & set(effects) else known._replace(x=start)
    return fitted(drive, rows, start, rest, tolerance, each=each, felt=best.felt, known=known)


def surely_without(
    drive: Drive,
    rows: Rows,
    best: Fit,
    tolerance: Mapping[str, float],
    effect: str,
    known: Slopes | None,
    worth: Callable[[Fit], float],
    each: Each = map,
) -> Fit:
    """The model without one effect: roughly where by its `worth` over that it surely stays, else as exact as any."""
    roughly = without(drive, rows, best, tolerance, (effect,), each, known)
    # By slopes of another place that lead nowhere it is not fitted at all, and worth anything.
    rest = list(roughly.columns)
    is_fitted = not np.array_equal(roughly.x[rest], best.x[rest])
    if is_fitted and (roughly.is_exact or worth(roughly) > _SURELY):
        return roughly
    return without(drive, rows, best, tolerance, (effect,), each)
