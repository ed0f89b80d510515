"""Where to begin with what has no slope at 0, or another one: limits of readings and of grip, a mount that swings."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from dsz_daemon.diagnose.effects.nuisances import TOLERATED
from dsz_daemon.diagnose.effects.vocabulary import INDEX
from dsz_daemon.diagnose.fitting.descent import loss_of_rows
from dsz_daemon.diagnose.fitting.drawings import UNTOLD
from dsz_daemon.diagnose.fitting.gains import quiet
from dsz_daemon.diagnose.fitting.limits import LIMITS, limits_read_off, reaches, tops_of
from dsz_daemon.diagnose.fitting.model import IMU, Fit
from dsz_daemon.diagnose.fitting.moments import SHORTEST_S
from dsz_daemon.diagnose.recordings.recording import DT_S
from dsz_daemon.diagnose.residuals.comparison import ROW_S, Each, Rows, residual
from dsz_daemon.diagnose.simulation.drive import Drive, Floats
from dsz_daemon.diagnose.simulation.instruments import swung
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat

# The simulation goes so much beyond the furthest reading, for so many rows: then readings may clip.
_BEYOND, _FOR_ROWS = 1.02, 5
# So much of log likelihood has to be gained in a slippery stretch.
_LEAST = 10.0
_YAW, _ACROSS = 2, 4
_FRICTIONS = np.geomspace(0.12, 1.0, 14)
# Whether drive and brakes take of the grip.
_ELLIPSES = 0.01, 1.0
# What a row has to gain to count.
_NOTHING = 0.02
_TOLD_BY_INPUTS = np.array([False, False, True, True, True, False])
_SWINGING = ("per_w2_s2", "damping", "carried", "gyros", "accel_x", "accel_y", "accel_z")
_OF_A_MOUNT = [INDEX[f"soft_mount.{name}"] for name in _SWINGING]
_SWINGS_HZ, _DAMPINGS = np.geomspace(0.8, 4.0, 20), (0.04, 0.1, 0.25)
_LEAST_ROWS, _STILL, _MUCH_LESS = 300, 1e-12, 0.5
# Play that wheels take up towards straight ahead: some, and what it has to explain of a yaw rate that is off.
PLAY, _SOME_PLAY_RAD, _A_PART = "steering_backlash", 0.01, 0.1
_IN_PLAY, _PLAYS_RAD = [INDEX[f"{PLAY}.{name}"] for name in ("width_rad", "centred")], (0.002, 0.05)
# A steering sensor's zero, that slips: by so much, for a slope; and no nearer to an end than so much of what tells it.
SLIP, _ZERO, _SOME_ZERO_RAD, _AT_AN_END = "steering_slip", INDEX["steering_offset.offset_rad"], 1e-3, 0.05
_OF_A_SLIP = [INDEX[f"{SLIP}.{name}"] for name in ("jump_rad", "at_s")]
_MOMENTS = [INDEX["low_friction.start_s"], INDEX["low_friction.end_s"]]
# A stretch that gains so much of what the best does may be it.
_ABOUT = 0.9
# Stiffnesses within their tolerance; softer by so much they may have given way to a limit.
_TOLERATED, _SOFTER = [INDEX[parameter.name] for parameter in TOLERATED], 0.01
# And what it gains over configured ones is so much of what softer ones do at least, whose offsets are fitted as well.
_OF_THEIR_OWN = 0.5
# Neither is 0, so that both are fitted.
_SOME_SHARPNESS, _SOME_OF_A_BRUSH = 0.01, 0.01


def guesses(drive: Drive, rows: Rows, best: Fit, each: Each = map) -> list[tuple[str, Floats]]:
    """Effects with parameters (as in the `best` fit so far) to begin from."""
    steered = [*_slippery(drive, rows, best, each), *_centred(drive, rows, best), *_slips(drive, rows, best)]
    return [*_clipped(drive, rows, best.x), *steered, *_swings(drive, rows, best, each)]


def _centred(drive: Drive, rows: Rows, best: Fit) -> list[tuple[str, Floats]]:
    """Play of wheels that pull themselves straight ahead, where the yaw rate has what it does, as wide as that is.

    What the hand loses as it turns round, by which play is screened, is nothing like it.
    """
    used = rows.used[:, _YAW]
    if PLAY in best.effects or quiet(drive, best)[_YAW] or np.count_nonzero(used) < _LEAST_ROWS:
        return []
    x = best.x.copy()
    x[_IN_PLAY] = _SOME_PLAY_RAD, 1.0
    more = (predicted(drive, x, best.road) - predicted(drive, best.x, best.road))[rows.at[used], _YAW]
    left = best.left[used, _YAW]
    more, left = more - np.mean(more), left - np.mean(left)
    both, own = float(more @ left), float(more @ more)
    if own < _STILL or both <= 0.0 or both**2 < _A_PART * own * float(left @ left):
        return []
    x[_IN_PLAY[0]] = min(max(_SOME_PLAY_RAD * both / own, _PLAYS_RAD[0]), _PLAYS_RAD[1])
    return [(PLAY, x)]


def _slips(drive: Drive, rows: Rows, best: Fit) -> list[tuple[str, Floats]]:
    """A steering sensor that slips on its shaft, when most of the yaw rate is two zeros of it, one after the other.

    What one more zero turns the car by is known; two, with a moment between them, are two such numbers. A car forgets
    in less than a second which it had.
    """
    used = rows.used[:, _YAW]
    if SLIP in best.effects or quiet(drive, best)[_YAW] or np.count_nonzero(used) < _LEAST_ROWS:
        return []
    x = best.x.copy()
    x[_ZERO] += _SOME_ZERO_RAD
    more = (predicted(drive, x, best.road) - predicted(drive, best.x, best.road))[rows.at[used], _YAW] / _SOME_ZERO_RAD
    weight = best.scatter[rows.block[used], _YAW] ** -2.0
    # By least squares, of which both begin anew: what has one zero throughout is that of the model so far.
    squares, cross = np.cumsum(weight * more**2), np.cumsum(weight * more * best.left[used, _YAW])
    least = _AT_AN_END * squares[-1]
    between = np.flatnonzero((squares > least) & (squares < squares[-1] - least))
    if not len(between):
        return []
    before, after = squares[between], squares[-1] - squares[between]
    gained = cross[between] ** 2 / before + (cross[-1] - cross[between]) ** 2 / after - cross[-1] ** 2 / squares[-1]
    at = int(between[np.argmax(gained)])
    power = float(np.sum(weight * best.left[used, _YAW] ** 2)) - cross[-1] ** 2 / squares[-1]
    if float(np.max(gained)) < _MUCH_LESS * power:
        return []
    x = best.x.copy()
    x[_OF_A_SLIP] = (
        (cross[-1] - cross[at]) / (squares[-1] - squares[at]) - cross[at] / squares[at],
        rows.at[used][at] * DT_S,
    )
    return [(SLIP, x)]


def _swings(drive: Drive, rows: Rows, best: Fit, each: Each) -> list[tuple[str, Floats]]:
    """An IMU that swings on its mount at the rate that leaves the least, in each channel that it leaves less of.

    What is compared is filtered alike, so what is predicted may swing after that as well. Judged by what steering and
    wheels tell, not by a road that roll and pitch gyros have felt, which swings with them, nor by what they jolt.
    """
    if "soft_mount" in best.effects or quiet(drive, best)[:IMU].all():
        return []
    course = predicted(drive, best.x, best.road)[:, :IMU]
    used = rows.used[:, :IMU]
    count = np.count_nonzero(used, axis=0)
    heard = (count > _LEAST_ROWS) & _TOLD_BY_INPUTS
    if not heard.any():
        return []

    def powers(more: Floats) -> Floats:
        """What is left of each channel (6,), whose offset is free."""
        left = np.where(used, best.left[:, :IMU] - more[rows.at], 0.0)
        mean = np.sum(left, axis=0) / np.maximum(count, 1)
        return np.asarray(np.maximum(np.sum((left - mean) ** 2, axis=0, where=used), _STILL))

    before = powers(np.zeros_like(course))

    def left_by(way: tuple[float, float]) -> Floats:
        """The share (6,) of what is left of each channel that a mount which swings so leaves of it, 1 at most."""
        hz, damping = way
        return np.minimum(powers(swung(course, 2.0 * math.pi * hz, damping, DT_S) - course) / before, 1.0)

    def worth(left: Floats) -> float:
        """Log likelihood, each channel as it scatters by itself, since wheels' noise swings."""
        return float(np.sum((-0.5 * count / best.per_row[:IMU] * np.log(left))[heard]))

    ways = [*product(_SWINGS_HZ.tolist(), _DAMPINGS)]
    left, (hz, damping) = max(zip(each(left_by, ways), ways, strict=True), key=lambda one: worth(one[0]))
    if worth(left) <= _LEAST or np.min(left[heard]) >= _MUCH_LESS:
        return []
    x = best.x.copy()
    x[_OF_A_MOUNT] = (2.0 * math.pi * hz) ** -2, damping, 1.0, *(left[_YAW:] < 1.0)
    return [("soft_mount", x)]


def _clipped(drive: Drive, rows: Rows, x: Floats) -> list[tuple[str, Floats]]:
    course = predicted(drive, x, flat(len(drive.steer)))
    found, start = course[rows.at], x.copy()
    for first, name in LIMITS:
        limits = [top.limit for top in tops_of(drive, first) if reaches(drive, course, top)]
        for c in range(first, first + 3):
            used = rows.used[:, c]
            if np.count_nonzero(used) < 100:
                continue
            furthest = float(np.max(np.abs(rows.measured[used, c])))
            if np.count_nonzero(np.abs(found[used, c]) > _BEYOND * furthest) >= _FOR_ROWS:
                limits.append(furthest)
        if limits:
            start[INDEX[f"sensor_saturation.{name}"]] = max(limits)
    if not np.array_equal(start, x) and not limits_read_off(drive, start):
        # Where no reading stands still noise comes after the limit, and so may the offset.
        start[INDEX["sensor_saturation.before_offset"]] = UNTOLD
    return [] if np.array_equal(start, x) else [("sensor_saturation", start)]


def _slippery(drive: Drive, rows: Rows, best: Fit, each: Each) -> list[tuple[str, Floats]]:
    """The stretch, and its friction, that would explain the most were nothing else changed; and the same all the way.

    A car forgets in less than a second what it drove on. So what each row gains on a road that is slippery all the way
    is what it gains in any stretch, and of each friction the best stretch is where the sum of that is the largest.
    A stretch that is another one and gains about as much is one to begin with, too: near the limit a car with a little
    less grip spins, and what was slippery for longer seems to have ended before.
    """
    if not (rows.used[:, _YAW].any() or rows.used[:, _ACROSS].any()):
        return []
    everywhere, stretches = list[tuple[float, Floats]](), list[tuple[float, Floats]]()
    before = loss_of_rows(best.left, rows, best.scatter)

    def loss(x: Floats) -> Floats:
        return loss_of_rows(residual(rows, predicted(drive, x, best.road)), rows, best.scatter)

    def all_the_way(grip: tuple[Floats, float, float]) -> tuple[Floats, Floats]:
        tyres, friction, ellipse = grip
        x = tyres.copy()
        x[INDEX["low_friction.ellipse"]] = ellipse
        x[INDEX["low_friction.inverse_square"]] = friction**-2
        x[INDEX["low_friction.sharpness"]] = _SOME_SHARPNESS
        x[INDEX["low_friction.brush"]] = _SOME_OF_A_BRUSH
        x[_MOMENTS] = 0.0, len(drive.steer) * DT_S
        return x, loss(x)

    # What a limit does may be in the stiffnesses so far: beside these none is to be seen.
    configured = best.x.copy()
    configured[_TOLERATED] = 0.0
    for tyres in (best.x, configured) if _given_way(best.x) else (best.x,):
        elsewhere = before if tyres is best.x else loss(tyres)
        in_tyres = min(float(np.sum(before - elsewhere)), 0.0)
        least = _LEAST - _OF_THEIR_OWN * in_tyres
        for x, after in each(all_the_way, product((tyres,), _FRICTIONS.tolist(), _ELLIPSES)):
            gained = elsewhere - after - _NOTHING
            if (of_all := float(np.sum(gained))) > least:
                everywhere.append((of_all + in_tyres, as_everywhere(tyres, x)))
            first, last, total = _stretch(gained)
            if total > least and (last - first) * ROW_S > SHORTEST_S:
                x[_MOMENTS] = rows.at[[first, last - 1]] * DT_S
                stretches.append((total + in_tyres, x))
    for found in (everywhere, stretches):
        found.sort(key=lambda one: -one[0])
    others = [one for one in stretches if one[0] > _ABOUT * stretches[0][0] and _are_apart(one[1], stretches[0][1])]
    limits = [("tyre_saturation", x) for _, x in everywhere[:1]]
    return [*limits, *(("low_friction", x) for _, x in (*stretches[:1], *others[:1]))]


def _given_way(x: Floats) -> bool:
    """Whether tyres are softer by so much that a limit of their grip may be in that."""
    return bool(np.min(x[_TOLERATED]) < -_SOFTER)


def _are_apart(one: Floats, other: Floats) -> bool:
    return bool(np.max(np.abs(one[_MOMENTS] - other[_MOMENTS])) > SHORTEST_S)


def as_everywhere(before: Floats, slippery: Floats) -> Floats:
    """The parameters of a road that is slippery all the way, as those of tyres that hold no better on any."""
    x = before.copy()
    for name in ("inverse_square", "sharpness", "ellipse", "brush"):
        x[INDEX[f"tyre_saturation.{name}"]] = slippery[INDEX[f"low_friction.{name}"]]
    return x


def _stretch(values: Floats) -> tuple[int, int, float]:
    """From and to which row the sum of the values is the largest, and the sum (Kadane)."""
    best, most, begun, total = (0, 0), 0.0, 0, 0.0
    for k, value in enumerate(values.tolist()):
        if total <= 0.0:
            begun, total = k, 0.0
        total += value
        if total > most:
            best, most = (begun, k + 1), total
    return *best, most
