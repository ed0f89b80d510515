"""What a fitted model leaves on blocks that it has not seen, and how sure its parameters are."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from dsz_daemon.diagnose.effects.shape_names import with_shapes
from dsz_daemon.diagnose.fitting.descent import Place
from dsz_daemon.diagnose.fitting.dives import noise_of_a_dive
from dsz_daemon.diagnose.fitting.model import (
    DRAWN,
    GRIP,
    IMU,
    MOMENTS,
    TILTS,
    UPRIGHT,
    Fit,
    Slopes,
    room,
)
from dsz_daemon.diagnose.fitting.spreads import TURNS, covariance_of, spreads_of
from dsz_daemon.diagnose.residuals.comparison import Rows, floors, noises
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import held_out, held_out_kinds, sums
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.surroundings.smooth_roads import (
    SURER,
    leaning,
    leans_on_a_bank,
    rows_as_one,
    slopes_of_bends,
)

# No effect of a real car is to the letter what the simulation makes of it.
_EFFECT_FORM = 0.03
# Least of all the limit of grip: every tyre has a curve of its own.
_GRIP_FORM = 0.1
# Nor is what has no name just what the simplest of a library makes of it, from inputs with their noise.
_SHAPE_FORM = 0.1
# Of how much a load turns with a car more is known than its ends: all of it, or nothing.
_SURER_THAN_ITS_ENDS = 2.0


def judged_model(drive: Drive, rows: Rows, tolerance: Mapping[str, float], here: Place, slopes: Slopes) -> Fit:
    """What a model leaves on blocks that a fit has not seen, and how sure its parameters are."""
    words, left, scatter, (x, effects, columns, values) = drive.vocabulary, here.left, here.scatter, slopes
    found = sums(rows, left, values, scatter)
    per_row = correlated_rows(left / scatter[rows.block], rows.used)
    box = room(drive, x, columns, tolerance)
    hang, prior = np.ones(len(columns)), box.weight.copy()
    prior[[place for place, i in enumerate(columns) if i == TURNS]] *= _SURER_THAN_ITS_ENDS
    if leans_on_a_bank(effects):
        lean = leaning(slopes_of_bends(drive, here.felt, x, here.bent), here.bent)
        places = [columns.index(column) for column in lean.columns]
        box.weight[places] += np.diag(lean.squares)
        prior[places] += np.diag(lean.squares)
        # What hangs together tells as much as fewer rows, and no more than it does where it counts for more.
        hang[places] = np.where(np.diag(lean.squares) > 0.0, SURER * rows_as_one(here.bent), 1.0)
    # When a stretch begins and ends is told by the moments around, which some fold has not seen; and how a car is drawn
    # is not what is judged.
    lasting = [place for place, i in enumerate(columns) if words.columns[i] not in MOMENTS and i not in DRAWN]
    unseen = held_out(found, lasting, box) * scatter**2
    together = {
        name: held_out_kinds(found, lasting, box, kind, per_row) * scatter**2 for name, kind in rows.together.items()
    }
    form = form_of(drive, rows, x, effects, here.base)
    steps = drive.steps_rows * (drive.steps / scatter) ** 2
    covariance = covariance_of(found, per_row, prior, steps, np.nan_to_num(noises(drive)) / scatter, hang)
    std, told = spreads_of(drive, rows, slopes, (left, per_row), covariance, tolerance)
    known = (x, std, effects, left, scatter, per_row, found, columns, unseen, here.road, form, together, here.felt)
    return Fit(*known, covariance, here.felt.unseen_along(x, rows), told=told)


@np.errstate(over="ignore", invalid="ignore")
def form_of(drive: Drive, rows: Rows, x: Floats, effects: tuple[str, ...], base: Floats) -> Floats:
    """What the simulation's form may be off by (13,): its own, and a share of what the effects in it do."""
    if not effects:
        return rows.form
    without = x.copy()
    without[[i for effect in effects for i in drive.vocabulary.columns_of(effect)]] = 0.0
    change = np.where(rows.used, (base - predicted(drive, without, flat(len(base))))[rows.at], 0.0)
    count = np.maximum(np.sum(rows.used, axis=0), 1)
    # Of the IMU what lasts all the way is the offset's to say.
    lasting = np.sum(change[:, :IMU], axis=0) / count[:IMU]
    change[:, :IMU] -= np.where(rows.used[:, :IMU], lasting, 0.0)
    rms = np.sqrt(np.sum(change**2, axis=0) / count)
    share = np.full(len(rms), _GRIP_FORM if GRIP & set(effects) else _EFFECT_FORM)
    share[[CHANNELS.index(channel) for channel in with_shapes(effects)]] = _SHAPE_FORM
    found = np.hypot(np.hypot(rows.form, share * rms), noise_of_a_dive(drive, x))
    if TILTS & set(effects):
        # A road that a gyro has felt has the gyro's noise in it, and -q v shows it.
        noise = float(np.nan_to_num(floors(drive)[1])) * float(np.sqrt(np.mean(drive.wheels**2)))
        found[UPRIGHT] = math.hypot(found[UPRIGHT], noise)
    return np.asarray(found, dtype=np.float64)
