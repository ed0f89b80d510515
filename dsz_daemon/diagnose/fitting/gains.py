"""What a larger model gains on unseen blocks, and which channels have a say in it."""

from __future__ import annotations

import math

import numpy as np

from dsz_daemon.diagnose.effects.row import SENSORS
from dsz_daemon.diagnose.fitting.limits import read_off
from dsz_daemon.diagnose.fitting.model import OWN_CHANNEL, UPRIGHT, Fit
from dsz_daemon.diagnose.fitting.moments import moments_of
from dsz_daemon.diagnose.residuals.comparison import BLOCK_S, Bools, noises
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN, gain
from dsz_daemon.diagnose.residuals.inputs import smoothed_away
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.prediction import ALONG
from dsz_daemon.diagnose.surroundings.smooth_roads import bends, is_new_on_a_bank, smoother
from dsz_daemon.diagnose.surroundings.unfelt_banks import ACROSS, is_unfelt
from dsz_daemon.diagnose.surroundings.unfelt_grades import climbs_unfelt
from dsz_daemon.diagnose.surroundings.winds import by_the_lean

# A parameter more has to be paid for; one that the drive does not move is none.
_A_PARAMETER = 3.0
# Of the power that noise and form may leave: a channel with less has nothing to gain.
_QUIET = 0.7
# What is said has to gain this. Counted in sealed trials (`dsz prove`): of causes that gained less one in five was true
# (seed 2026). The model has not all that a car is. And so many times more for what has no formula: it fits nearly
# anything.
TOLD_GAIN, TOLD_PROFILE = 20.0, 2.0
# Of an instrument that is all that differs half of that: of 88 recordings of three simulators with nothing left out
# none has one that gains as much.
_ALONE = 0.5
# But what flickers drifts a little, too.
_WANDERING = frozenset({"bias_drift"})
# But one whose rest hangs together, and hardly does (in rows, of which white noise has 5) with the larger model.
_HUNG, _WHITE_ROWS = 2.0, 10.0
# A channel that was off by so many times what noise and form leave, and is by so much less, is put right.
_OFF, _RIGHT = 3.0, 3.0
# A profile takes all that its own sensor has left over: it is judged by the other channels; wind by the yaw rate alone,
# since whatever is wrong about the lateral motion or the lean shows in all else as it does in the acceleration.
_ROLL_GYRO = 0
_NO_JUDGES = {"road_bank": [0], "road_grade": [1], "side_wind": [0, 1, 3, 4, 5, 6, 7, 8]}
# Wind by the lean takes what the roll gyro has, as a bank does; but a body that leans has to show it there.
_TAKEN_BY_A_LEAN = _ROLL_GYRO


def gained(drive: Drive, smaller: Fit, larger: Fit, per_row: Floats | None = None, kind: str = "") -> float:
    """Log likelihood that the larger model gains on blocks that its fit has not seen.

    `per_row` (13,): how many rows count as one, if not as many as hang together in what the larger model leaves.
    `kind`: on whole manoeuvres, or recordings, that it has not seen.
    """
    per_row = larger.per_row if per_row is None else per_row
    count, form = larger.sums.counts.copy(), smaller.form.copy()
    # What hung together, and does so no more, has gained however small it is.
    whitened = (larger.per_row < _WHITE_ROWS) & (larger.per_row < smaller.per_row / _HUNG)
    mute = quiet(drive, smaller) & ~whitened
    for effect in set(larger.effects) - set(smaller.effects):
        if effect == "side_wind" and by_the_lean(larger.x):
            mute[_TAKEN_BY_A_LEAN] = True
        else:
            count[:, _taken_by(drive, effect, larger)] = 0.0
        if effect == "side_wind":
            # What rounding does to the steering pushes a car over time, too: no formula has it, but a profile may.
            form = np.hypot(form, drive.steps)
        if effect == "side_wind" and "low_friction" in larger.effects:
            # Where grip ends, what pushes sideways may be the tyres' own curve.
            start_s, end_s = larger.x[moments_of(drive)]
            begins_s = BLOCK_S * np.arange(len(count))
            count[(begins_s + BLOCK_S > start_s) & (begins_s < end_s)] = 0.0
        if effect in {"road_bank", "road_grade"}:
            # With the profile comes its gyro's noise.
            form[UPRIGHT] = max(form[UPRIGHT], larger.form[UPRIGHT])
    if is_new_on_a_bank(smaller.effects, larger.effects):
        # The bank had the lean in it, to the last digit of the gyro that it is taken from; a simulation has not.
        form = np.maximum(form, larger.form)
        if mute[_ROLL_GYRO]:
            count[:, _ROLL_GYRO] = 0.0
    parameters = drive.vocabulary.columns
    moved = [
        i
        for i, std in zip(larger.columns, larger.std.tolist(), strict=True)
        if i not in smaller.columns and std < 0.1 * (parameters[i][1].high - parameters[i][1].low)
    ]
    before, after = (
        np.where(count > 0.0, (fit.together[kind] if kind else fit.unseen) + count * smoothed_away(drive, fit.x), 0.0)
        for fit in (smaller, larger)
    )
    # What hangs together only since the larger model has it wrong says as much against it as it did for the smaller.
    worse = after.sum(axis=0) > before.sum(axis=0)
    per_row = np.where(worse, np.minimum(per_row, smaller.per_row), per_row)
    if larger.along is not None and "road_grade" not in smaller.effects and not kind:
        # Nothing else shows this road: what of it other places tell is its evidence.
        count[:, ALONG] = larger.sums.counts[:, ALONG]
        before[:, ALONG], after[:, ALONG] = smaller.unseen[:, ALONG], larger.along[0]
        per_row = np.where(np.arange(len(per_row)) == ALONG, larger.along[1], per_row)
    found = gain(before, after, count, per_row, form, mute) - _A_PARAMETER * len(moved)
    found += _smooths(drive, smaller, larger)
    # That readings stand at a limit is seen without any simulation.
    return found if kind else found + read_off(drive, larger.x) - read_off(drive, smaller.x)


def told_from(drive: Drive, fit: Fit, effect: str) -> float:
    """From which gain on an effect is told.

    An instrument that alone is wrong is asked half: what gains little beside others mostly takes what these leave.
    A grade that no gyro feels is asked no more than others where nothing else is left that is wrong: what has 5 s of
    road to tell the next 5 s by says little for certain, however far off a level road is.
    """
    if effect not in OWN_CHANNEL:
        is_alone = fit.effects == (effect,) and drive.vocabulary.described(effect).touches == SENSORS
        is_alone &= effect not in _WANDERING
        return TOLD_GAIN * (_ALONE if is_alone else 1.0)
    if effect == "road_grade" and climbs_unfelt(drive) and not np.delete(far_off(drive, fit), ALONG).any():
        return TOLD_GAIN
    return TOLD_PROFILE * TOLD_GAIN


def _smooths(drive: Drive, smaller: Fit, larger: Fit) -> float:
    """Log likelihood gained by a bank that bends less, since a lean that was in it is the body's."""
    if not is_new_on_a_bank(smaller.effects, larger.effects):
        return 0.0
    return smoother(*(bends(drive, fit.road, fit.x) for fit in (smaller, larger)))


def is_beyond_form(drive: Drive, smaller: Fit, larger: Fit) -> bool:
    """Whether the larger model does what taking back an error of the simulation's form would not, however much else is.

    It puts a channel right, or takes the bends out of a bank.
    """
    return puts_right(drive, smaller, larger) or _smooths(drive, smaller, larger) >= LEAST_GAIN


def quiet(drive: Drive, fit: Fit) -> Bools:
    """Channels (13,) in which no more is left than noise and form leave."""
    power = fit.unseen.sum(axis=0) / np.maximum(fit.sums.counts.sum(axis=0), 1.0)
    return np.asarray(power < _QUIET * (np.nan_to_num(noises(drive)) ** 2 + fit.form**2))


def far_off(drive: Drive, fit: Fit) -> Bools:
    """Channels (13,) of which so much is left, on blocks that no fit has seen, that no error of form would do it."""
    return np.asarray(_left(fit) > _OFF * np.hypot(np.nan_to_num(noises(drive)), fit.form))


def puts_right(drive: Drive, smaller: Fit, larger: Fit) -> bool:
    """Whether a channel that is far off no longer is, by far; not one of which a profile has taken what it left."""
    now_off = far_off(drive, larger._replace(form=smaller.form))
    right = far_off(drive, smaller) & ~now_off & (_left(larger) < _left(smaller) / _RIGHT)
    for effect in set(larger.effects) - set(smaller.effects):
        right[_taken_by(drive, effect, larger)] = False
    if larger.along is not None and "road_grade" not in smaller.effects:
        rows = max(float(larger.sums.counts[:, ALONG].sum()), 1.0)
        told = math.sqrt(float(larger.along[0].sum()) / rows) < float(_left(smaller)[ALONG]) / _RIGHT
        right[ALONG] = told and bool(far_off(drive, smaller)[ALONG])
    return bool(right.any())


def _taken_by(drive: Drive, effect: str, fit: Fit) -> list[int]:
    """The channels that are no judges of a profile."""
    if effect == "road_bank" and is_unfelt(drive):
        return [ACROSS]
    if effect == "road_grade" and climbs_unfelt(drive):
        return [ALONG]
    return [_TAKEN_BY_A_LEAN] if effect == "side_wind" and by_the_lean(fit.x) else _NO_JUDGES.get(effect, [])


def _left(fit: Fit) -> Floats:
    return np.asarray(np.sqrt(fit.unseen.sum(axis=0) / np.maximum(fit.sums.counts.sum(axis=0), 1.0)))
