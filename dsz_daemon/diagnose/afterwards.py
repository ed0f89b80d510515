"""What is asked of a search that has ended: what its parameters move, and what gains how much in which channel."""

from __future__ import annotations

from collections.abc import Sequence

from dsz_daemon.diagnose.comparison import Each, sensitivities
from dsz_daemon.diagnose.effects import INDEX, TOLERATED
from dsz_daemon.diagnose.fit import fitted
from dsz_daemon.diagnose.gains import gained, gained_by_channel
from dsz_daemon.diagnose.prediction import Floats, predicted
from dsz_daemon.diagnose.search import Search, without


def slopes_of(found: Search, columns: Sequence[int], each: Each = map) -> Floats:
    """Sensitivities (k, 13, len(columns)) at the end of the search."""
    best = found.best
    base = predicted(found.drive, best.x, best.road)
    return sensitivities(found.drive, found.rows, best.x, best.road, base, columns, None, each)


def tolerance_gain(found: Search, each: Each = map) -> float:
    """What refitting the configured parameters gains over leaving them as they are, causes included."""
    start = found.best.x.copy()
    start[[INDEX[p.name] for p in TOLERATED]] = 0.0
    held = fitted(found.drive, found.rows, start, found.best.effects, {}, each=each, felt=found.best.felt)
    return gained(found.drive, held._replace(form=found.rows.form, columns=found.best.columns), found.best)


def gains_by_channel(found: Search, effect: str, each: Each = map) -> Floats:
    """What an effect of the model gains in each channel (13,), in log likelihood on blocks that no fit has seen."""
    smaller = without(found.drive, found.rows, found.best, found.tolerance, (effect,), each)
    return gained_by_channel(found.drive, smaller._replace(form=found.rows.form), found.best)
