"""A recording as arrays on one grid, filtered alike in every channel.

All signals pass the same linear-phase low-pass: what goes into the simulation as well as what its output is held
against, so that speed can be differentiated without the filter showing as a difference between the two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose.recordings.flat_tops import FlatTop, flat_top
from dsz_daemon.diagnose.recordings.rounding import coarse_step, rounded_anew
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Ints = np.ndarray[Any, np.dtype[np.int64]]
Bools = np.ndarray[Any, np.dtype[np.bool_]]

DT_S = 0.01
# Gaussian: half the power at 2.2 Hz, above what a driver and a car's body do, below what pole counting adds.
FILTER_S = 0.06
# Noise of a steering sensor by which play would come out wider by as much as its spread, at the road wheels; what takes
# most of it off (half of what swings at 4 Hz, at 7 Hz), and how much more than noise it may take: a hand may tremble.
_FLICKER_RAD, _NO_MORE = 5e-5, 1.3
_LIGHT = tuple(np.hanning(n + 2)[1:-1] / np.sum(np.hanning(n + 2)) for n in (21, 13))
# Longitudinal acceleration, measured and predicted, passes another: a speed that is differentiated is noise above
# that, and whatever smooths a prediction (a bandwidth, a delay) would look like physics.
ALONG_FILTER_S = 0.15
# Steering and wheel speeds come every 10 to 50 ms; what is missing for longer is not made up.
LONGEST_GAP_S = 0.25
# A signal that is missing for so much of the time is worth a word where a recording is too short.
_MUCH_MISSING = 0.2
# Where nothing came for so long, one recording ends and the next begins; so much of nothing is left between the two.
_PAUSE_S, _BETWEEN_S = 10.0, 2.0
# What a reference may bring: its columns, each on the log's clock, often once a second.
REFERENCE = ("vx_mps", "vy_mps", "yaw_rate_radps", "grade_up_rad")
_REFERENCE_GAP_S = 1.5
# Between samples that come more seldom than this a line is no motion: they count where they are, so closely.
_SELDOM_S, _AT_A_SAMPLE_S = 0.15, 0.02
# No reference is known better than to so much of what it varies by; one that comes seldom no better than to this.
_REFERENCE_BEST, _SELDOM_BEST = 1e-3, 1e-2
PEDALS = ("brake", "accelerator")


class Recording(NamedTuple):
    """One drive, or several, on a grid of DT_S; SI, filtered, NaN where a signal is missing.

    `time_s` (n,) counts from the first frame; `imu` (n, 6) in the order of `IMU_CHANNELS`, `wheels_mps` (n, 4) by the
    configured radius. `floor` (10,) is the standard deviation that white noise of the unfiltered channels leaves, IMU
    channels first, then wheels. `steering_step_rad` is the steering's resolution at the road wheel. `reference` (n, 4)
    and its floor (4,) are in the order of `REFERENCE`. `piece` (n,) counts recordings, between which `time_s` jumps.
    `tops`: IMU channels whose readings stand at an end. `rounding_rad` (ways, n): what rounding may have done to the
    steering, as it moves; None where that is not known. `pressed`: of each pedal that is recorded whether it is (n,).
    `told_rad` (n,): the road wheels' angle before its low-pass, which has `told_kernel`; None where it has none.
    """

    time_s: Floats
    road_wheel_angle_rad: Floats
    wheels_mps: Floats
    imu: Floats
    floor: Floats
    steering_step_rad: float = 0.0
    reference: Floats | None = None
    reference_floor: Floats | None = None
    piece: Ints | None = None
    tops: tuple[FlatTop, ...] = ()
    rounding_rad: Floats | None = None
    pressed: tuple[tuple[str, Floats], ...] = ()
    told_rad: Floats | None = None
    told_kernel: Floats | None = None


def recorded(
    signals: Mapping[str, Signal], steering_ratio: float, reference: Mapping[str, Signal] | None = None
) -> Recording:
    """The recording of decoded samples; `steering_ratio` is hand wheel over road wheel.

    Of a `reference` (states by name, SI) what is in `REFERENCE` is used, and `speed_mps` where there is no `vx_mps`.
    """
    first = min(int(signal.t_ns[0]) for signal in signals.values() if len(signal.t_ns))
    time_s, piece = _grid(signals, first)
    names = (*IMU_CHANNELS, *WHEEL_SPEEDS)
    raw = {name: _on_grid(signals.get(name), first, time_s) for name in names}
    by_hand, kernels = "steering_wheel_angle" in signals, {name: _kernel_of(signals.get(name)) for name in names}
    told, ratio = (
        signals.get("steering_wheel_angle" if by_hand else "road_wheel_angle"),
        steering_ratio if by_hand else 1.0,
    )
    steering, step = _on_grid(told, first, time_s) / ratio, step_of(told)
    rounding = rounded_anew(told, step, white_std(told.values)) if told is not None and step > 0.0 else []
    steering_kernel = _kernel_of(told)
    smooth = {name: filtered(values, kernels[name]) for name, values in raw.items()}
    tops = [_top(c, signals.get(name), first) for c, name in enumerate(IMU_CHANNELS)]
    states, states_floor = on_grid_of(reference or {}, first, time_s) or (None, None)
    return Recording(
        time_s,
        filtered(steering, steering_kernel),
        np.column_stack([smooth[name] for name in WHEEL_SPEEDS]),
        np.column_stack([smooth[name] for name in IMU_CHANNELS]),
        np.array([_floor(signals.get(name), kernels[name]) for name in names]),
        step / ratio,
        states,
        states_floor,
        piece,
        tuple(top for top in tops if top is not None),
        np.array([filtered(_on_grid(one, first, time_s) / ratio, steering_kernel) for one in rounding])
        if rounding
        else None,
        tuple(
            (name, _pressed(signals[name], first, time_s))
            for name in PEDALS
            if name in signals and len(signals[name].t_ns)
        ),
        _without_flicker(steering, white_std(told.values, 4) / ratio if told is not None else math.nan),
        steering_kernel,
    )


def _without_flicker(steering_rad: Floats, noise_rad: float) -> Floats:
    """The steering without so much noise of its sensor that play would follow it.

    At each turn of the hand the noise of all samples about it takes up play, two to three deviations of it. Where a
    low-pass takes off more than noise it is a hand that trembles, of which play lets nothing through: that stays.
    """
    for kernel in _LIGHT if noise_rad > _FLICKER_RAD else ():
        light = filtered(steering_rad, kernel)
        taken = np.abs(steering_rad - light)
        of_noise_rad = noise_rad * math.sqrt(1.0 + float(np.sum(kernel**2)) - 2.0 * float(kernel[len(kernel) // 2]))
        if 1.4826 * np.nanmedian(taken) < _NO_MORE * of_noise_rad:
            return light
    return steering_rad


def _pressed(pedal: Signal, first_ns: int, time_s: Floats) -> Floats:
    """Whether a pedal is pressed, 0 to 1 behind the low-pass: until its next sample it stays as it was."""
    last = np.searchsorted((pedal.t_ns - first_ns) * 1e-9, time_s, side="right") - 1
    return filtered(np.where(last < 0, 0.0, (pedal.values != 0.0)[last]), filter_kernel())


def _grid(signals: Mapping[str, Signal], first_ns: int) -> tuple[Floats, Ints]:
    """The grid's instants, s since the first sample, and which recording each is of."""
    at_ns = np.unique(np.concatenate([signal.t_ns for signal in signals.values()]))
    ends = np.flatnonzero(np.diff(at_ns) > _PAUSE_S * 1e9)
    grids = []
    for begin, end in zip((0, *(ends + 1)), (*ends, len(at_ns) - 1), strict=True):
        start_s, last_s = ((int(at_ns[i]) - first_ns) * 1e-9 for i in (begin, end))
        pause_s = 0.0 if end == len(at_ns) - 1 else _BETWEEN_S
        grids.append(start_s + DT_S * np.arange(int((last_s + pause_s - start_s) / DT_S) + 1, dtype=np.float64))
    return np.concatenate(grids), np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])


def on_grid_of(reference: Mapping[str, Signal], first_ns: int, time_s: Floats) -> tuple[Floats, Floats] | None:
    """Reference states (n, 4) on the grid, filtered, with what is white in them (4,); None without any."""
    found = {name: reference.get(name) for name in REFERENCE}
    found["vx_mps"] = found["vx_mps"] or reference.get("speed_mps")
    if not any(found.values()):
        return None
    values = [_state_on_grid(signal, first_ns, time_s) for signal in found.values()]
    floors = np.array([_floor(signal, filter_kernel()) for signal in found.values()])
    best = (_SELDOM_BEST if _is_seldom(signal) else _REFERENCE_BEST for signal in found.values())
    varies = (float(np.std(signal.values)) if signal else math.nan for signal in found.values())
    least = [share * std for share, std in zip(best, varies, strict=True)]
    return np.column_stack(values), np.maximum(floors, least)


def on_grid(signal: Signal, first_ns: int, time_s: Floats) -> Floats:
    """One signal's samples on the grid, filtered; NaN where it is not."""
    return filtered(_on_grid(signal, first_ns, time_s, _REFERENCE_GAP_S), filter_kernel())


def _state_on_grid(signal: Signal | None, first_ns: int, time_s: Floats) -> Floats:
    """A reference's samples on the grid, filtered; of one that comes seldom what is close to its samples.

    What the low-pass would make of that is told by a curve through them, from which it is a sample or so away.
    """
    if signal is None or not _is_seldom(signal):
        return filtered(_on_grid(signal, first_ns, time_s, _REFERENCE_GAP_S), filter_kernel())
    # Nothing else of a recording needs it.
    from scipy.interpolate import CubicSpline  # noqa: PLC0415

    stamps, first = np.unique((signal.t_ns - first_ns) * 1e-9, return_index=True)
    away_s = np.abs(time_s - stamps[_nearest(stamps, time_s)])
    curve = filtered(np.asarray(CubicSpline(stamps, signal.values[first])(time_s)), filter_kernel())
    return np.where(away_s <= _AT_A_SAMPLE_S, curve, np.nan)


def _nearest(stamps: Floats, time_s: Floats) -> Ints:
    after = np.clip(np.searchsorted(stamps, time_s), 1, len(stamps) - 1)
    return np.where(stamps[after] - time_s < time_s - stamps[after - 1], after, after - 1)


def _is_seldom(signal: Signal | None) -> bool:
    return signal is not None and len(signal.t_ns) > 1 and float(np.median(np.diff(signal.t_ns))) * 1e-9 > _SELDOM_S


def _on_grid(signal: Signal | None, first_ns: int, time_s: Floats, longest_gap_s: float = LONGEST_GAP_S) -> Floats:
    if signal is None or len(signal.t_ns) < 2:
        return np.full(len(time_s), np.nan)
    at_s: Floats = np.asarray((signal.t_ns - first_ns) * 1e-9, dtype=np.float64)
    values = np.interp(time_s, at_s, signal.values, np.nan, np.nan)
    after = np.clip(np.searchsorted(at_s, time_s), 1, len(at_s) - 1)
    values[at_s[after] - at_s[after - 1] > longest_gap_s] = np.nan
    return values


def without_steering(recording: Recording, there: np.ndarray[Any, np.dtype[np.bool_]]) -> Recording:
    """The recording in which nobody knows how the car was steered where `there` (n,): these rows are not compared."""
    told = recording.road_wheel_angle_rad if recording.told_rad is None else recording.told_rad
    known, before = (np.where(there, np.nan, steering) for steering in (recording.road_wheel_angle_rad, told))
    return recording._replace(road_wheel_angle_rad=known, told_rad=before)


def with_gaps(signals: Mapping[str, Signal]) -> dict[str, float]:
    """Signals that for much of the time are missing, between samples further apart than `LONGEST_GAP_S`: its share."""
    found = {}
    for name, signal in signals.items():
        gaps_s = 1e-9 * np.diff(np.asarray(signal.t_ns, dtype=np.float64))
        share = float(np.sum(gaps_s[gaps_s > LONGEST_GAP_S])) / max(float(np.sum(gaps_s)), 1e-9)
        if share > _MUCH_MISSING:
            found[name] = share
    return found


def filter_kernel(filter_s: float = FILTER_S) -> Floats:
    """The low-pass's weights (odd number), of sum 1."""
    reach = math.ceil(4.0 * filter_s / DT_S)
    weights = np.exp(-0.5 * (DT_S * np.arange(-reach, reach + 1) / filter_s) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def sharp_kernel(cut_hz: float) -> Floats:
    """A windowed sinc (k,) of three half-waves to each side: what is slower than the cut passes, no more."""
    reach = round(1.5 / (cut_hz * DT_S))
    kernel = np.hamming(2 * reach + 1) * np.sinc(2.0 * cut_hz * DT_S * np.arange(-reach, reach + 1))
    return np.asarray(kernel / kernel.sum())


def _kernel_of(signal: Signal | None) -> Floats:
    """The low-pass for a signal, less what joining its samples by straight lines smooths it by.

    Lines weigh the samples by a triangle as wide as two periods, whose variance is a sixth of a period's square: else
    what comes seldom would be smoother than what comes often, as if a sensor were slow.
    """
    if signal is None or len(signal.t_ns) < 2:
        return filter_kernel()
    period_s = float(np.median(np.diff(signal.t_ns))) * 1e-9
    return filter_kernel(math.sqrt(max(FILTER_S**2 - period_s**2 / 6.0, (0.5 * FILTER_S) ** 2)))


def filtered(values: Floats, kernel: Floats) -> Floats:
    """The values behind the low-pass; NaN as far as a missing value reaches."""
    reach = len(kernel) // 2
    padded = np.concatenate((np.full(reach, values[0]), values, np.full(reach, values[-1])))
    return np.convolve(padded, kernel, mode="valid")


def step_of(signal: Signal | None) -> float:
    """The steps in which a signal is told, in its unit, behind noise as well; 0 without one."""
    return max(least_step(signal), coarse_step(signal)) if signal is not None else 0.0


def least_step(signal: Signal | None) -> float:
    """The smallest step of a signal, 0 without one."""
    steps = np.abs(np.diff(signal.values)) if signal is not None else np.zeros(0)
    steps = steps[steps > 1e-9]
    return float(np.min(steps)) if len(steps) else 0.0


def _floor(signal: Signal | None, kernel: Floats) -> float:
    """What the filter leaves of a signal's white noise, which comes at the signal's own rate."""
    if signal is None or len(signal.t_ns) < 10:
        return math.nan
    period_s = float(np.median(np.diff(signal.t_ns))) * 1e-9
    std = white_std(signal.values)
    if not np.diff(signal.values).all():
        # Values that stand still between two steps show no noise, and are rounded all the same.
        std = max(std, least_step(signal) / math.sqrt(12.0))
    return std * math.sqrt(float(np.sum(kernel**2)) * max(period_s / DT_S, 1.0))


def _top(channel: int, signal: Signal | None, first_ns: int) -> FlatTop | None:
    if signal is None or len(signal.t_ns) < 10:
        return None
    at_s = np.asarray((signal.t_ns - first_ns) * 1e-9, dtype=np.float64)
    return flat_top(channel, at_s, signal.values, least_step(signal), white_std(signal.values))


def white_std(values: Floats, order: int = 2) -> float:
    """Standard deviation of what is white in a signal: of its differences, of which a smooth signal has little.

    Of the `order`-th ones, which the less has of what is quick, and white noise as its binomials make of it.
    """
    differences = np.diff(values, order)
    differences = np.abs(differences[np.isfinite(differences)])
    of_one = math.sqrt(math.comb(2 * order, order))
    return float(1.4826 * np.median(differences) / of_one) if len(differences) else math.nan
