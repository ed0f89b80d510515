"""Simulation against recording: what physics the simulation leaves out.

    from dsz_daemon.diagnose import diagnose

    found = diagnose(signals, car, steering_ratio)
    print(found.said.verdict, found.said.causes)

`signals` are decoded samples by role (`dsz_daemon.runs.diagnose.signals_of` reads them from logs), SI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from dsz_daemon.core.parameters import Car
from dsz_daemon.diagnose.effects.row import CAR, SENSORS, Effect, Motion, Parameter
from dsz_daemon.diagnose.effects.vocabulary import vocabulary
from dsz_daemon.diagnose.faults.axis_faults import found_faults
from dsz_daemon.diagnose.faults.backwards import as_shapes, backwards, without_them
from dsz_daemon.diagnose.faults.bunches import hardly_there, told_by_stamps
from dsz_daemon.diagnose.faults.echoes import told_by_echoes
from dsz_daemon.diagnose.faults.input_faults import AT_THE_ROAD, BY_HAND, found_input_faults
from dsz_daemon.diagnose.faults.reference_faults import require_same_car
from dsz_daemon.diagnose.faults.single_readings import coarse_readings, coarse_steering, told_by_readings
from dsz_daemon.diagnose.faults.spinning import rolling_rows, spinning
from dsz_daemon.diagnose.faults.steering_stops import is_one, stop_of, without_it
from dsz_daemon.diagnose.faults.stuck_readings import told_by_standing
from dsz_daemon.diagnose.faults.turning_readings import of_wheels, told_by_turning
from dsz_daemon.diagnose.faults.wiring import wiring_of
from dsz_daemon.diagnose.recordings.recording import LONGEST_GAP_S, REFERENCE, on_grid, recorded, with_gaps
from dsz_daemon.diagnose.residuals.comparison import SLOW_MPS, Each, driven_s, rows_of
from dsz_daemon.diagnose.residuals.drives import against, drive_of
from dsz_daemon.diagnose.selection.search import Search, searched
from dsz_daemon.diagnose.shapes.unlisted import Shape
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, nothing
from dsz_daemon.diagnose.simulation.own_effects import require_sound
from dsz_daemon.diagnose.simulation.prediction import predicted
from dsz_daemon.diagnose.simulation.road import flat
from dsz_daemon.diagnose.verdict.another_car import with_own_numbers
from dsz_daemon.diagnose.verdict.answer import answered, with_nothing_said, with_what_has_no_shape
from dsz_daemon.diagnose.verdict.said import Diagnosis
from dsz_daemon.errors import InputError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS

__all__ = ["CAR", "SENSORS", "Diagnosed", "Effect", "Motion", "Parameter", "diagnose"]

_SHORTEST_S = 20.0
_STIFFNESS = {"front_cornering_stiffness_n_per_rad": 0.1, "rear_cornering_stiffness_n_per_rad": 0.1}
# The names that a user's simulation may have for what an IMU would show.
_SIMULATED = {
    **{name: (name,) for name in IMU_CHANNELS},
    "gyro_z": ("gyro_z", "yaw_rate_radps"),
    "accel_x": ("accel_x", "ax_mps2"),
    "accel_y": ("accel_y", "ay_mps2"),
}
# Columns of states that are used of a file beside a recording.
REFERENCE_USED = (*REFERENCE, "speed_mps")
SIMULATION_USED = tuple(dict.fromkeys(name for names in _SIMULATED.values() for name in names))


class Diagnosed(NamedTuple):
    """What is said, and the search behind it: drive, fits, all that was tried."""

    said: Diagnosis
    search: Search


def diagnose(
    signals: Mapping[str, Signal],
    car: Car,
    steering_ratio: float,
    *,
    tolerance: Mapping[str, float] = _STIFFNESS,
    effects: tuple[Effect, ...] = (),
    reference: Mapping[str, Signal] | None = None,
    simulation: Mapping[str, Signal] | None = None,
    say: Callable[[str], None] | None = None,
    each: Each = map,
) -> Diagnosed:
    """What one recording says of the nominal simulation, or of the user's own `simulation`.

    `tolerance`: how far configured stiffnesses may be off, as shares by their names; `effects`: rows of one's own;
    `reference`: states by name, SI; `each`: a `map` that works side by side; `say` hears what is being done.
    InputError: nothing to drive the simulation with (steering, wheel speeds), nothing to compare, or too little of it.
    ValueError: an effect of one's own that can't be asked.
    """
    _require(signals)
    words = vocabulary(effects)
    require_sound(effects)
    if say is not None:
        say("looking for axes that are not what they are called")
    signals, repeated = told_by_echoes(signals)
    signals, bunched = told_by_stamps(signals)
    signals, standing = told_by_standing(signals)
    signals, single = told_by_readings(signals)
    turning = told_by_turning(signals)
    recording = recorded(signals, steering_ratio, reference)
    role = BY_HAND if BY_HAND in signals else AT_THE_ROAD
    input_faults, wiring = found_input_faults(recording, car, steering_ratio, role)
    if input_faults:
        signals = wiring.mended_signals(signals)
        recording = recorded(signals, steering_ratio, reference)
    bunched = [*bunched, *hardly_there(recording, signals)]
    coarse = [*coarse_steering(signals, steering_ratio), *coarse_readings(signals)]
    drive = drive_of(recording, car, steering_ratio, words)
    rows = rows_of(drive)
    length_s = driven_s(drive, rows)
    if length_s < _SHORTEST_S:
        missing = ", ".join(f"{name} {share:.0%}" for name, share in with_gaps(signals).items())
        why = f"; of the time without samples for more than {LONGEST_GAP_S:g} s: {missing}" if missing else ""
        raise InputError(
            f"{length_s:.1f} s of driving (above {SLOW_MPS:g} m/s, all signals there); "
            f"expected {_SHORTEST_S:g} s or more to fit and to judge{why}"
        )
    nominal = predicted(drive, nothing(words), flat(len(drive.steer)))
    used = np.zeros((len(nominal), 6), dtype=np.bool_)
    used[rows.at] = rows.used[:, :6]
    faults = found_faults(drive.recording.imu, nominal[:, :6], used)
    if faults:
        mended = wiring_of(faults).mended_signals(signals)
        drive = drive_of(recorded(mended, steering_ratio, reference), car, steering_ratio, words)
    require_same_car(drive.recording)
    first_ns = min(int(signal.t_ns[0]) for signal in signals.values() if len(signal.t_ns))
    drive, stops = _where_steered(drive, signals, first_ns, car, steering_ratio)
    drive, back = (drive, []) if simulation else _forwards(drive, car, steering_ratio)
    drive = _held_against(drive, simulation, first_ns) if simulation else drive
    try:
        found = searched(drive, rolling_rows(drive, rows_of(drive)), tolerance, say, each)
        found, by_numbers = with_own_numbers(drive, found, tolerance, say, each)
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"the recording is so far from what the configured car can do that nothing can be fitted to it ({error}); "
            "expected steering, wheel speeds and IMU in the units and with the signs that the configuration gives them"
        ) from error
    # Readings beyond what a steering reaches, in another unit, are not its end.
    stops = [] if any(fault.channel == role for fault in input_faults) else stops
    lines = of_wheels(turning, found.best.effects)
    beside = [
        *repeated,
        *bunched,
        *standing,
        *single,
        *lines,
        *coarse,
        *stops,
        *back,
        *spinning(found.drive, found.rows, found.best),
    ]
    said = answered(found, [*input_faults, *faults], each, by_numbers, beside)
    if not (said.causes or said.parameter_errors or said.unlisted):
        said, found = with_nothing_said(said, found)
    return Diagnosed(with_what_has_no_shape(said, found), found)


def _held_against(drive: Drive, simulation: Mapping[str, Signal], first_ns: int) -> Drive:
    """The drive against the user's own simulation. InputError where that has nothing of it, or too little."""
    theirs = {}
    for channel, names in _SIMULATED.items():
        name = next((name for name in names if name in simulation), None)
        if name is not None:
            theirs[channel] = on_grid(simulation[name], first_ns, drive.recording.time_s)
    if not theirs:
        raise InputError(f"the simulation has none of {', '.join(CHANNELS[:6])}: there is nothing to hold it against")
    drive = against(drive, theirs)
    length_s = driven_s(drive, rows_of(drive))
    if length_s < _SHORTEST_S:
        raise InputError(
            f"the simulation is there for {length_s:.1f} s of driving (above {SLOW_MPS:g} m/s); "
            f"expected {_SHORTEST_S:g} s or more to fit and to judge"
        )
    return drive


def _where_steered(
    drive: Drive, signals: Mapping[str, Signal], first_ns: int, car: Car, steering_ratio: float
) -> tuple[Drive, list[Shape]]:
    """The drive without what a steering sensor at its end does not tell, and what is said of that."""
    stop = stop_of(signals)
    if stop is None or not is_one(drive, stop, first_ns):
        return drive, []
    recording, share = without_it(drive.recording, stop, first_ns)
    return drive_of(recording, car, steering_ratio, drive.vocabulary), [stop.as_shape(share)]


def _forwards(drive: Drive, car: Car, steering_ratio: float) -> tuple[Drive, list[Shape]]:
    """The drive without what it does backwards, by wheel speeds that have no sign, and what is said of that."""
    stretches = backwards(drive.recording, car.wheelbase_m)
    if not stretches:
        return drive, []
    recording = without_them(drive.recording, stretches)
    return drive_of(recording, car, steering_ratio, drive.vocabulary), as_shapes(drive.recording, stretches)


def _require(signals: Mapping[str, Signal]) -> None:
    missing = [name for name in WHEEL_SPEEDS if name not in signals]
    if missing:
        raise InputError(f"no samples of {', '.join(missing)}: the simulation is driven by four wheel speeds")
    if not {"steering_wheel_angle", "road_wheel_angle"} & set(signals):
        raise InputError("no samples of a steering angle: the simulation is driven by it")
    if not any(name in signals for name in IMU_CHANNELS):
        raise InputError("no samples of any IMU channel: there is nothing to hold the simulation against")
