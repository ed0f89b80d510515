"""Which effects are worth a real fit: by one linear step each, or two at once, and by what is left where they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.vocabulary import GUESSED, NUISANCES
from dsz_daemon.diagnose.fitting.dives import DIVE, noise_of_a_dive
from dsz_daemon.diagnose.fitting.model import DRAWN, OWN_CHANNEL, Fit, Slopes, box_of
from dsz_daemon.diagnose.residuals.comparison import Bools, Each, Rows, noises, sensitivities
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN, Box, Sums, gain, held_out, solved, sums
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import ALONG, predicted
from dsz_daemon.diagnose.surroundings.unfelt_banks import ACROSS, is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt

# Those that a linear step brings so much of what it brings the best.
_WORTH = 0.05
# What is so seldom that it is thought of alone, and not in the place of one of two that are not.
_SELDOM = frozenset({"nose_lift", "wheels_more"})
# What is no more than an accelerometer's own square where this gyro is not there.
_BY_A_GYRO = {"nose_lift": 1}
NEVER_SCREENED = (*OWN_CHANNEL, *GUESSED)
# Two at once are thought of where one of them is among so many that move what is far off the most.
_FIRST_OF_TWO = 5
# So much more than noise and form has to be left of what a profile shows in for it to be thought of: the lateral
# acceleration, or one of a road's gyro and the accelerometer that tilts with it.
_FELT = 1.2
_SHOWN_IN = {"road_bank": (0, 4), "road_grade": (1, 3), "side_wind": (4,)}
# Wind is felt, too, where what is left hangs together over so many rows, twice what white noise does.
_BLOWS_ROWS = 10.0


def feels(drive: Drive, rows: Rows, best: Fit, effect: str) -> bool:
    """Whether a profile may be there: whether its own channel is, and more is left than noise and form leave."""
    own = OWN_CHANNEL[effect]
    if effect == "road_bank" and is_unfelt(drive):
        own = ACROSS
    if effect == "road_grade" and climbs_unfelt(drive):
        own = ALONG
    if not rows.used[:, own].any():
        return False
    if effect == "side_wind" and best.per_row[OWN_CHANNEL[effect]] > _BLOWS_ROWS:
        return True
    usual = np.hypot(np.nan_to_num(noises(drive)), best.form)
    return any(
        float(np.sqrt(np.mean(best.left[rows.used[:, c], c] ** 2))) > _FELT * float(usual[c])
        for c in _SHOWN_IN[effect]
        if rows.used[:, c].any()
    )


class Screening(NamedTuple):
    """One linear step from a model towards any effect; `names` are those that it brings the most, best first."""

    drive: Drive
    names: list[str]
    known: Slopes
    best: Fit
    found: Sums
    box: Box
    own: list[int]
    of_effects: Mapping[str, list[int]]
    before: Floats

    def after(self, effects: Sequence[str]) -> Floats:
        """Unseen squares (b, 13), SI, with these in the model, too."""
        return np.asarray(held_out(self.found, self._with(effects), self.box) * self.best.scatter**2)

    def _with(self, effects: Sequence[str]) -> list[int]:
        return [*self.own, *(place for effect in effects for place in self.of_effects[effect])]

    def gain(self, effects: Sequence[str]) -> float:
        """Log likelihood that a linear step towards them gains, as if all rows were independent of each other."""
        one, form = np.ones_like(self.best.form), self.best.form
        if DIVE in effects:
            form = np.hypot(form, noise_of_a_dive(self.drive, self._stepped(effects)))
        return gain(self.before, self.after(effects), self.found.counts, one, form)

    def _stepped(self, effects: Sequence[str]) -> Floats:
        """The parameters after a linear step towards these."""
        columns = self._with(effects)
        squares, cross = self.found.squares.sum(axis=(0, 1)), self.found.cross.sum(axis=(0, 1))
        box = Box(self.box.low[columns], self.box.high[columns], self.box.weight[columns])
        x = self.best.x.copy()
        x[np.array(self.known.columns)[columns]] += solved(squares[np.ix_(columns, columns)], cross[columns], box)
        return x

    def pairs(self, far_off: Bools, each: Each) -> list[tuple[str, str]]:
        """Two at once that together bring more than alone, best first: what one does may hide what the other does.

        One of them moves what is `far_off` (13,).
        """
        left = {name: float(np.sum(self.after([name])[:, far_off])) for name in self.of_effects}
        first = sorted(left, key=left.__getitem__)[:_FIRST_OF_TWO]
        common = [name for name in self.of_effects if name not in _SELDOM]
        asked = [pair for pair in combinations(common, 2) if set(pair) & set(first)]
        alone = dict(zip(common, each(lambda name: max(self.gain([name]), 0.0), common), strict=True))
        together = dict(zip(asked, each(self.gain, asked), strict=True))
        gains = {pair: together[pair] - sum(alone[name] for name in pair) for pair in asked}
        return [pair for pair in sorted(gains, key=lambda pair: -gains[pair]) if gains[pair] > LEAST_GAIN]


def screened(
    drive: Drive, rows: Rows, best: Fit, tolerance: Mapping[str, float], each: Each, known: Slopes | None = None
) -> Screening:
    """The effects that are not in the model, by one linear step each; of its slopes some may be `known`."""
    words = drive.vocabulary
    special = [i for name in NEVER_SCREENED for i in words.columns_of(name)]
    held = set(NUISANCES) - set(best.columns)
    columns = [i for i in range(len(words.columns)) if i not in held and (i not in special or i in best.columns)]
    all_known = _slopes(drive, rows, best, columns, known, each)
    columns = list(all_known.columns)
    found = sums(rows, best.left, all_known.values, best.scatter)
    box = box_of(words.columns, best.x, columns, tolerance)
    place = {column: i for i, column in enumerate(columns)}
    own = [place[i] for i in best.columns if i not in DRAWN]
    of_effects = {
        effect.name: [place[i] for i in words.columns_of(effect.name)]
        for effect in words.effects
        if effect.name not in best.effects
        and effect.name not in NEVER_SCREENED
        and (effect.name not in _BY_A_GYRO or rows.used[:, _BY_A_GYRO[effect.name]].any())
    }
    before = np.asarray(held_out(found, own, box) * best.scatter**2)
    screening = Screening(drive, [], all_known, best, found, box, own, of_effects, before)
    gains = dict(zip(of_effects, each(lambda name: screening.gain([name]), of_effects), strict=True))
    enough = max([_WORTH * max(gains.values()), 0.5 * LEAST_GAIN]) if gains else 0.0
    names = [name for name in sorted(gains, key=lambda name: -gains[name]) if gains[name] > enough]
    return screening._replace(names=names)


def _slopes(drive: Drive, rows: Rows, best: Fit, columns: Sequence[int], known: Slopes | None, each: Each) -> Slopes:
    """The slopes at the end of a fit, taken where they are not `known`; what is known comes first."""
    there = [] if known is None else [i for i in columns if i in known.columns]
    given = None if known is None else known.of(best.x, best.effects, there)
    if given is None:
        there = []
    base, rest = predicted(drive, best.x, best.road), [i for i in columns if i not in there]
    values = sensitivities(drive, rows, best.x, best.road, base, rest, best.felt, each, given)
    return Slopes(best.x, best.effects, (*there, *rest), values)
