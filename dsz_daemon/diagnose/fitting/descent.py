"""Down to where no step takes more off what is left: Gauss-Newton in a box, with slopes that are seldom taken.

A model's slopes cost as many simulations as it has parameters, a step costs one. So slopes are taken where it begins,
turned by what each step shows, and taken again where no step gets further or where the end seems to be reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.compiled import compiled
from dsz_daemon.diagnose.residuals.comparison import Bools, Ints, Rows, residual
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import Box, likelihood_of, scatter_of, solved, sums
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.moving import Moving, driven
from dsz_daemon.diagnose.simulation.prediction import predicted, shown
from dsz_daemon.diagnose.simulation.road import Profiles
from dsz_daemon.diagnose.surroundings.profiles import Felt
from dsz_daemon.diagnose.surroundings.smooth_roads import bends, leaning, roughness, slopes_of_bends, unevenness

_ROUNDS = 20
# By slopes that were turned, not taken, two steps in a row have to bring next to nothing.
_QUIET_TWICE = 2
# A fit may be asked after so many rounds whether it is worth more.
_ASKED = 4
_RESTS = 0.05
# Deviations; what is further off was something else.
_FAR = 4.0
_WRONG = 1e9
_STILL, _LEVEL = 1e-9, np.zeros(0)


class Place(NamedTuple):
    """Parameters, the road that is felt for them, what is predicted there and left (k, 13), each block's scatter.

    `bent`: by how much a bank bends (rows,) that the body's lean is to be told from; (0,) where there is none.
    """

    x: Floats
    felt: Felt
    road: Profiles
    base: Floats
    left: Floats
    scatter: Floats
    bent: Floats


class Step(NamedTuple):
    """The next place, the step (p,) to it, the change (k, 13) that it made, and what that took off what is left."""

    there: Place
    step: Floats
    change: Floats
    gone: float


class Learnt(NamedTuple):
    """What is known of the ways down: sensitivities (k, 13, p), those of how a bank bends (rows, 4), (0, 4) without.

    `is_exact`: whether they are those of the place, not of another and turned since.
    """

    slopes: Floats
    bends: Floats
    is_exact: bool = True


class Slope(NamedTuple):
    """What a descent works with: the fitted `columns`, their `sizes` (p,), inf for what is linear anyway.

    `taken`: sensitivities (k, 13, p) at a place; `box`: how far the columns may go from some parameters; `leans`:
    whether the body does so on a bank. `moments`: columns that are times, of which a drive tells little but where it
    does much, so that a step by their slopes may go anywhere.
    """

    drive: Drive
    rows: Rows
    floor: Floats
    columns: tuple[int, ...]
    sizes: Floats
    taken: Callable[[Place], Floats]
    box: Callable[[Floats], Box]
    leans: bool = False
    moments: Sequence[int] = ()

    def place(self, x: Floats, felt: Felt) -> Place:
        """What there is for these parameters, the body's lean to forces that are in no simulation included."""
        road = felt(x)
        moving = driven(self.drive, x, road)
        here = self._as_it_leans(x, felt, road, shown(self.drive, x, moving))
        return self._leant(here, moving, here, math.inf)

    def _as_it_leans(self, x: Floats, felt: Felt, road: Profiles, base: Floats) -> Place:
        left = residual(self.rows, base)
        bent = bends(self.drive, road, x) if self.leans else _LEVEL
        return Place(x, felt, road, base, left, scatter_of(self.rows, left, self.floor), bent)

    def _leant(self, here: Place, moving: Moving, before: Place, most: float) -> Place:
        """The same parameters with the body's lean to what is left now, or as far as no more than `most` is left by it.

        On a bank that is felt by the roll gyro a body's lean makes another bank of the same readings, and that leaves
        another acceleration to lean to: round by round it may go further and further the other way.
        """
        share = 1.0
        while share > _RESTS:
            felt = here.felt.leaning(here.x, moving, here.base, share)
            if felt is here.felt:
                break
            road = felt(here.x)
            there = self._as_it_leans(here.x, felt, road, predicted(self.drive, here.x, road))
            if self.loss(before, there.left, there.bent) <= most:
                return there
            share *= 0.4
        return here

    def loss(self, here: Place, left: Floats, bent: Floats) -> float:
        """Half the sum of squares of what is left, and of how much a bank bends, as things scatter `here`."""
        return loss_of(left, self.rows, here.scatter) + unevenness(bent, roughness(here.bent))

    def learnt(self, here: Place, known: Floats | None = None) -> Learnt:
        """The ways down from here, of which the sensitivities may be `known`."""
        bent = slopes_of_bends(self.drive, here.felt, here.x, here.bent) if self.leans else np.zeros((0, 4))
        return Learnt(self.taken(here) if known is None else known, bent)

    def step(self, here: Place, learnt: Learnt) -> Step | None:
        """The next step, if need be without another moment; None where it only goes up."""
        found = sums(self.rows, here.left, learnt.slopes, here.scatter, _FAR)
        squares, cross = found.squares.sum(axis=(0, 1)), found.cross.sum(axis=(0, 1))
        if self.leans:
            lean = leaning(learnt.bends, here.bent)
            at = [self.columns.index(column) for column in lean.columns]
            squares[np.ix_(at, at)] += lean.squares
            cross[at] += lean.cross
        box = self.box(here.x)
        if (down := self._along(here, solved(squares, cross, box))) is not None:
            return down
        still = [self.columns.index(i) for i in self.moments if i in self.columns]
        box.low[still] = box.high[still] = 0.0
        return self._along(here, solved(squares, cross, box)) if still else None

    def _along(self, here: Place, step: Floats) -> Step | None:
        """As much of a step (p,) as takes something off; None where none of it does."""
        before = self.loss(here, here.left, here.bent)
        share = 1.0
        while share > _RESTS:
            x = here.x.copy()
            x[list(self.columns)] += share * step
            road = here.felt(x)
            moving = driven(self.drive, x, road)
            there = self._as_it_leans(x, here.felt, road, shown(self.drive, x, moving))
            if (after := self.loss(here, there.left, there.bent)) < before:
                leant = self._leant(there, moving, here, before)
                return Step(leant, share * step, here.left - there.left, before - after)
            share *= 0.4
        return None


def descended(
    slope: Slope,
    here: Place,
    known: Floats | None,
    settled: float,
    roughly: bool = False,
    is_hopeless: Callable[[Place, Floats], bool] | None = None,
) -> tuple[Place, Learnt]:
    """Where no step takes more than the share `settled` off what is left, and the slopes by which that was found.

    `known`: the slopes here. `roughly`: they are taken again only where no step by them gets further, not where the end
    seems to be reached. What `is_hopeless` by its place and slopes, after some rounds or where slopes were to be taken
    again, is left there.
    """
    learnt, quiet = slope.learnt(here, known), 0
    for k in range(_ROUNDS):
        if k == _ASKED and is_hopeless is not None and is_hopeless(here, learnt.slopes):
            break
        found = _first_step(slope, here, learnt) if k == 0 and known is not None else slope.step(here, learnt)
        if found is None:
            if learnt.is_exact or (is_hopeless is not None and is_hopeless(here, learnt.slopes)):
                break
            learnt = slope.learnt(here)
            continue
        there, step, change, gone = found
        before = slope.loss(here, here.left, here.bent)
        scatters = float(np.mean(np.abs(there.scatter / here.scatter - 1.0), axis=0).max())
        quiet = quiet + 1 if gone < settled * (before + 500.0) and scatters < _RESTS else 0
        here, was_exact = there, learnt.is_exact
        learnt = Learnt(turned(learnt.slopes, change, step, slope.sizes), learnt.bends, is_exact=False)
        if quiet and (was_exact or (roughly and quiet == _QUIET_TWICE)):
            break
        if quiet and not roughly:
            if is_hopeless is not None and is_hopeless(here, learnt.slopes):
                break
            learnt = slope.learnt(here)
    return here, learnt


def _first_step(slope: Slope, here: Place, learnt: Learnt) -> Step | None:
    """The usual step, or that as if all blocks of a channel scattered alike: whichever leads to what is likelier.

    Where the simulation is wrong by much, blocks scatter by much and say little: what would put all of them right is
    not tried by the usual one.
    """
    rows, usual = slope.rows, slope.step(here, learnt)
    power = np.sum(here.left**2, axis=0, where=rows.used) / np.maximum(np.sum(rows.used, axis=0), 1)
    alike = np.sqrt(np.maximum(power, np.maximum(np.nan_to_num(slope.floor), _STILL) ** 2))
    other = slope.step(here._replace(scatter=np.tile(alike, (len(here.scatter), 1))), learnt)
    if usual is None or other is None:
        return usual or other
    per_row = correlated_rows(other.there.left / other.there.scatter[rows.block], rows.used)
    likely = [likelihood_of(rows, found.there.left, per_row) for found in (usual, other)]
    return other if likely[1] > likely[0] else usual


def loss_of(left: Floats, rows: Rows, scatter: Floats) -> float:
    """Half the sum of squares, beyond `_FAR` deviations as for a distance."""
    return float(np.sum(loss_of_rows(left, rows, scatter)))


def loss_of_rows(left: Floats, rows: Rows, scatter: Floats) -> Floats:
    """The same, row by row (k,)."""
    return _loss_of_rows(left, rows.used, rows.block, scatter)


@compiled
def _loss_of_rows(left: Floats, used: Bools, block: Ints, scatter: Floats) -> Floats:
    found = np.zeros(len(left))
    for k in range(len(left)):
        for c in range(left.shape[1]):
            if used[k, c]:
                # A car that has become unstable is infinitely wrong, and that is all that counts.
                z = abs(left[k, c] / scatter[block[k], c])
                if not z < _WRONG:
                    z = _WRONG
                found[k] += 0.5 * z * z if z < _FAR else _FAR * (z - 0.5 * _FAR)
    return found


def turned(slopes: Floats, change: Floats, step: Floats, sizes: Floats) -> Floats:
    """Slopes (k, 13, p) turned so that `step` (p,) makes just the `change` (k, 13) of the prediction that it made.

    Schubert's sparse form of Broyden's update (Math. Comp. 24, 1970), in units of the parameters' `sizes` (p,): what a
    channel does not feel of a parameter it does not learn.
    """
    return _turned(slopes, change, step, step / sizes**2)


@compiled
def _turned(slopes: Floats, change: Floats, step: Floats, along: Floats) -> Floats:
    channels, p = slopes.shape[1], slopes.shape[2]
    feels = np.zeros((channels, p), dtype=np.bool_)
    for k in range(len(slopes)):
        for c in range(channels):
            for i in range(p):
                if slopes[k, c, i] != 0.0:
                    feels[c, i] = True
    # How far each parameter of a channel is turned by what the channel is off; by nothing where none is felt.
    turns = np.zeros((channels, p))
    for c in range(channels):
        power = 0.0
        for i in range(p):
            if feels[c, i]:
                power += along[i] * step[i]
        for i in range(p):
            if feels[c, i] and power > 0.0:
                turns[c, i] = along[i] / power
    found = np.empty_like(slopes)
    for k in range(len(slopes)):
        for c in range(channels):
            off = change[k, c]
            for i in range(p):
                off -= slopes[k, c, i] * step[i]
            for i in range(p):
                found[k, c, i] = slopes[k, c, i] + off * turns[c, i]
    return found
