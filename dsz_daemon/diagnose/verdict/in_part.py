"""What a name explains only in part: much is left of its own channel, just where it shows most.

What is there, and is told by its right name, leaves its channel's noise, and what else there is comes and goes by
itself. Something else that looks like it for a while (a bracket that tips at once, where a road would turn; readings
from a buffer, where others are late) leaves more the more the name shows.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from dsz_daemon.diagnose.effects.shape_names import is_shape
from dsz_daemon.diagnose.fitting.model import GRIP, TILTS, Fit
from dsz_daemon.diagnose.fitting.shown_by import shown_by
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import Rows, noises
from dsz_daemon.diagnose.residuals.locate import channel_names
from dsz_daemon.diagnose.simulation.drive import Drive, Floats

# Of what an effect shows (power) so much is left, and of seconds the ranks of both agree by so much. Right names of
# six simulators had 0.07 at 0.75, or 0.39 at most; of wrong ones four had 0.73 and more.
_MUCH, _TOGETHER, _PIECE_S = 0.12, 0.6, 1.0
# Or so many times more is left than it explains: of right names 0.9.
_MOST = 2.0

# Of 436 recordings of six simulators ten have any channel that is 1.5 times off. In these, and in 24 that have what is
# unknown besides, right names of what has a formula left -0.05 to 0.05 of what they show in their channel, but
# for an arm beside a limit of grip (1.0); two wrong ones left 1.6 and 1.8.
_OF_A_TURN = frozenset({"gyro_z", "accel_y"})
_TAKES_THE_REST = GRIP | {"side_wind"}
_SKETCHED = TILTS | _TAKES_THE_REST | {"wheel_slip"}

# What leans shows an accelerometer a scale, and its gyro how it turns: while that is not explained no scale has a name
# that gains less.
_OF_A_LEAN, _MUCH_GAINED = frozenset({"gyro_x", "gyro_y"}), 50.0


def is_of_a_lean(effect: str, gain: float, unexplained: Collection[str]) -> bool:
    """Whether a small scale of accelerometers stands beside a roll or pitch rate that is not explained."""
    return effect == "accel_scale" and gain < _MUCH_GAINED and not _OF_A_LEAN.isdisjoint(unexplained)


def explains_a_part(drive: Drive, rows: Rows, fit: Fit, effect: str, unexplained: Collection[str]) -> bool:
    """Whether the channel that an effect shows most in is one of the `unexplained`, and it is no name for what is."""
    c, of_it, left, share = _left_of_its_own(drive, rows, fit, effect)
    if channel_names(drive)[c] not in unexplained:
        return False
    if share > _MOST:
        return True
    used = rows.used[:, c]
    piece = (rows.at[used] * DT_S // _PIECE_S).astype(np.int64)
    there = np.bincount(piece) > 0
    of_it, left = (np.bincount(piece, squares)[there] / np.bincount(piece)[there] for squares in (of_it, left))
    together = float(np.corrcoef(np.argsort(np.argsort(of_it)), np.argsort(np.argsort(left)))[0, 1])
    return share > _MUCH and together > _TOGETHER


def leaves_its_own(drive: Drive, rows: Rows, fit: Fit, effect: str, off: Collection[str]) -> bool:
    """Whether an effect that has a formula leaves much of what it shows, where it shows most and is `off`.

    A road, a wind, a limit of grip and what slips are but sketched; and what is beside a limit or a wind has their rest
    in the same channel.
    """
    if effect in _SKETCHED or is_shape(effect):
        return False
    c, _, _, share = _left_of_its_own(drive, rows, fit, effect)
    name = channel_names(drive)[c]
    if name in _OF_A_TURN and not _TAKES_THE_REST.isdisjoint(fit.effects):
        return False
    return name in off and share > _MUCH


def _left_of_its_own(drive: Drive, rows: Rows, fit: Fit, effect: str) -> tuple[int, Floats, Floats, float]:
    """The channel an effect shows most in; squares of what it shows there (n,), of what is left, and how that compares.

    The last: power that is left beyond noise and form, over that of what is shown.
    """
    shown, expected = shown_by(drive, fit, effect)[rows.at], np.hypot(noises(drive), fit.form)
    powers = [
        float(np.var(shown[used, c]) / expected[c] ** 2) if used.any() and expected[c] > 0.0 else 0.0
        for c, used in enumerate(rows.used.T)
    ]
    c = int(np.argmax(powers))
    used = rows.used[:, c]
    of_it, left = ((values - np.mean(values)) ** 2 for values in (shown[used, c], fit.left[used, c]))
    return c, of_it, left, float(np.sum(left - expected[c] ** 2) / max(float(np.sum(of_it)), 1e-30))
