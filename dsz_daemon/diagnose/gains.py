"""What a larger model gains on unseen blocks, and which channels have a say in it."""

from __future__ import annotations

import numpy as np

from dsz_daemon.diagnose.comparison import Bools, floors
from dsz_daemon.diagnose.evidence import gain
from dsz_daemon.diagnose.fit import UPRIGHT, Fit
from dsz_daemon.diagnose.limits import read_off
from dsz_daemon.diagnose.prediction import Drive, Floats

# A parameter more has to be paid for; one that the drive does not move is none.
_A_PARAMETER = 3.0
# Of the power that noise and form may leave: a channel with less has nothing to gain.
_QUIET = 0.7
# A profile takes all that its own sensor has left over: it is judged by the other channels; wind by the yaw rate alone,
# since whatever is wrong about the lateral motion or the lean shows in all else as it does in the acceleration.
_NO_JUDGES = {"road_bank": [0], "road_grade": [1], "side_wind": [0, 1, 3, 4, 5, 6, 7, 8]}


def gained(drive: Drive, smaller: Fit, larger: Fit, per_row: Floats | None = None, kind: str = "") -> float:
    """Log likelihood that the larger model gains on blocks that its fit has not seen.

    `per_row` (13,): how many rows count as one, if not as many as hang together in what the larger model leaves.
    `kind`: on whole manoeuvres, or recordings, that it has not seen.
    """
    per_row = larger.per_row if per_row is None else per_row
    count, form = larger.sums.counts.copy(), smaller.form.copy()
    for effect in set(larger.effects) - set(smaller.effects):
        count[:, _NO_JUDGES.get(effect, [])] = 0.0
        if effect in {"road_bank", "road_grade"}:
            # With the profile comes its gyro's noise.
            form[UPRIGHT] = max(form[UPRIGHT], larger.form[UPRIGHT])
    parameters = drive.vocabulary.columns
    moved = [
        i
        for i, std in zip(larger.columns, larger.std.tolist(), strict=True)
        if i not in smaller.columns and std < 0.1 * (parameters[i][1].high - parameters[i][1].low)
    ]
    before, after = (fit.together[kind] if kind else fit.unseen for fit in (smaller, larger))
    found = gain(before, after, count, per_row, form, quiet(drive, smaller)) - _A_PARAMETER * len(moved)
    # That readings stand at a limit is seen without any simulation.
    return found if kind else found + read_off(drive, larger.x) - read_off(drive, smaller.x)


def quiet(drive: Drive, fit: Fit) -> Bools:
    """Channels (13,) in which no more is left than noise and form leave."""
    power = fit.unseen.sum(axis=0) / np.maximum(fit.sums.counts.sum(axis=0), 1.0)
    return np.asarray(power < _QUIET * (np.nan_to_num(floors(drive)) ** 2 + fit.form**2))
