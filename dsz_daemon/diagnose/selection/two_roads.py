"""A road that banks and climbs at once: each tilt hides the other, and neither is anything by itself."""

from __future__ import annotations

from collections.abc import Sequence

from dsz_daemon.diagnose.fitting.gains import far_off, puts_right
from dsz_daemon.diagnose.fitting.model import TILTS
from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection.screening import feels
from dsz_daemon.diagnose.selection.smaller import BY_ITSELF
from dsz_daemon.diagnose.selection.together import tried_at_once
from dsz_daemon.diagnose.selection.trials import Step, Trial
from dsz_daemon.diagnose.simulation.drive import CHANNELS

# What shows a road's gravity.
_ALONG, _ACROSS = CHANNELS.index("accel_x"), CHANNELS.index("accel_y")
# Both roads have to gain so many times what something gains alone.
_SO_MUCH_MORE = 3.0


def both_roads(trial: Trial, tried: Sequence[Step], refused: set[str], each: Each) -> list[Step]:
    """Bank and grade, where both accelerometers are far off and nothing that was tried gains much; else empty.

    In a bend a bank turns into a grade, as angles do: the gyros that feel the one tell it wrongly without the other.
    """
    drive, best = trial.drive, trial.best
    alone, off = max((step.gain for step in tried), default=0.0), far_off(drive, best)
    if TILTS & set(best.effects) or alone > BY_ITSELF or not (off[_ALONG] and off[_ACROSS]):
        return []
    if not all(feels(drive, trial.rows, best, road) for road in sorted(TILTS)):
        return []
    least = max(_SO_MUCH_MORE * alone, LEAST_GAIN)
    both = tried_at_once(trial, [(tuple(sorted(TILTS)), best.x)], refused, each)
    return [step for step in both if step.gain > least and puts_right(drive, best, step.fit)]
