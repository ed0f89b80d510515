"""`dsz diagnose`: the nominal simulation against a recording: what was left out, by name, and how well it fits then."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.diagnose import REFERENCE_USED, SIMULATION_USED
from dsz_daemon.diagnose import diagnose as diagnosed
from dsz_daemon.diagnose.recordings.recording import Floats
from dsz_daemon.diagnose.verdict.fit_columns import columns_of_fit
from dsz_daemon.diagnose.verdict.level import OF_A_TURN, TURNED, UNEXPLAINED
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.edge.memory import available_bytes
from dsz_daemon.edge.samples_file import write_columns
from dsz_daemon.edge.small_arrays import keep_freed_memory
from dsz_daemon.errors import InputError, MachineError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.report.diagnosis_page import diagnosis_page
from dsz_daemon.report.diagnosis_words import end_of, is_formless, is_spin, spins_of
from dsz_daemon.runs.hands import Hands
from dsz_daemon.runs.never_received import hints, never_received
from dsz_daemon.runs.results import output_folder
from dsz_daemon.runs.setup import Setup, set_up, versions
from dsz_daemon.runs.states_file import check_overlap, read_states
from dsz_daemon.runs.summary import write_json
from dsz_daemon.signals import WHEEL_SPEEDS

Progress = Callable[[int, int], None]

_SIDE_BY_SIDE = 2
# Six axes and the whole vocabulary took 0.61, 1.33 and 3.56 GB for 150, 600 and 1800 s.
_BYTES_AT_ALL, _BYTES_PER_S = 3e8, 2e6
_PAUSE_S = 1.0
_STEERING = frozenset({"steering_wheel_angle", "road_wheel_angle"})


class Beside(NamedTuple):
    """What a user may hold beside a recording: measured states, and a simulation of one's own."""

    reference: Path | None = None
    simulation: Path | None = None


NOTHING_BESIDE = Beside()


def diagnose(
    logs: Sequence[Path],
    config: Path,
    folder: Path,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
    beside: Beside = NOTHING_BESIDE,
    draws: bool = True,
) -> dict[str, Any]:
    """Writes diagnosis.json, fit.parquet and report.html of one recording (in pieces) into `folder`; returns the first.

    Without the last unless it `draws`. `say` hears what is being done. InputError: nothing to drive the simulation with
    (steering, wheel speeds), nothing to compare, too little of it, or a file beside it that can't be read or is of
    another time. MachineError: it is too long for the memory that is left.
    """
    keep_freed_memory()
    setup = set_up(config)
    output_folder(folder)
    report = LogReport()
    _require_mapped(setup)
    signals, warnings = _read(setup, logs, report, progress)
    first_s = min(int(signal.t_ns[0]) for signal in signals.values()) * 1e-9
    last_s = max(int(signal.t_ns[-1]) for signal in signals.values()) * 1e-9
    _require_memory(signals)
    reference, unused = _states(beside.reference, first_s, last_s, REFERENCE_USED)
    simulation, others = _states(beside.simulation, first_s, last_s, SIMULATION_USED)
    warnings += unused + others
    vehicle = setup.settings.vehicle
    with Hands(_SIDE_BY_SIDE) as hands:
        said, found = diagnosed(
            signals,
            vehicle.car(),
            vehicle.steering_ratio,
            tolerance=setup.settings.diagnose.tolerance,
            reference=reference,
            simulation=simulation,
            say=say,
            each=hands.map,
        )
    result: dict[str, Any] = plain(said)
    result |= {"versions": versions(), "settings": setup.settings.used()}
    result["source"] = {"recording": [path.name for path in logs], "log": report.summary(), "warnings": warnings} | {
        name: path.name for name, path in beside._asdict().items() if path is not None
    }
    write_json(result, folder / "diagnosis.json")
    columns = columns_of_fit(found, first_s, [cause.effect for cause in said.causes])
    write_columns(columns, folder / "fit.parquet")
    if draws:
        _write_report(folder / "report.html", result, columns, ", ".join(path.name for path in logs))
    return result


def _states(
    path: Path | None, first_s: float, last_s: float, used: Collection[str]
) -> tuple[Mapping[str, Signal] | None, list[str]]:
    """The states of a file, and what is said of columns that are not `used`."""
    if path is None:
        return None, []
    states = read_states(path)
    check_overlap(states, first_s, last_s, path)
    unused = [*(name for name in states.signals if name not in used), *states.unknown]
    return states.signals, [f"{path.name}: not used: {', '.join(unused)}"] if unused else []


def _require_mapped(setup: Setup) -> None:
    """InputError where what the simulation is driven by is not mapped."""
    missing = [name for name in WHEEL_SPEEDS if name not in setup.roles]
    if not setup.roles & _STEERING:
        missing.append("steering_wheel_angle")
    if missing:
        raise InputError(
            f"{setup.path}: signals: {', '.join(missing)} not mapped; expected four wheel speeds and a steering angle, "
            "which drive the simulation"
        )


def _require_received(never: Mapping[str, str]) -> None:
    """InputError where what drives the simulation is mapped, and `never` came."""
    gone: dict[str, list[str]] = {}
    for role in (role for role in never if role in {*WHEEL_SPEEDS, *_STEERING}):
        gone.setdefault(never[role], []).append(role)
    if gone:
        words = "; ".join(f"{', '.join(roles)} ({why})" for why, roles in gone.items())
        raise InputError(f"never received, and the simulation is driven by it: {words}")


def _require_memory(signals: Mapping[str, Signal]) -> None:
    """MachineError where a recording is too long for the memory that is left: the system would end it half-way."""
    steps_s = np.diff(signals[WHEEL_SPEEDS[0]].t_ns) * 1e-9
    recorded_s = float(steps_s[steps_s < _PAUSE_S].sum())
    left, needed = available_bytes(), _BYTES_AT_ALL + _BYTES_PER_S * recorded_s
    if left is not None and needed > left:
        most_s = max(0.0, (left - _BYTES_AT_ALL) / _BYTES_PER_S)
        raise MachineError(
            f"{recorded_s:.0f} s of recording need some {needed / 1e9:.1f} GB of memory, {left / 1e9:.1f} GB are left; "
            f"expected {most_s:.0f} s at most: give its pieces one by one, or a part of it"
        )


def _write_report(path: Path, result: dict[str, Any], columns: Mapping[str, Floats], title: str) -> None:
    """The page, after all other results. MachineError where it can't be drawn or written."""
    try:
        path.write_text(diagnosis_page(result, columns, title), encoding="utf-8")
    except OSError as error:
        raise MachineError(f"{path}: can't write the report: {error.strerror or error}") from error


def plain(said: Any) -> Any:
    """Named tuples as dictionaries, to be written down."""
    if isinstance(said, tuple) and hasattr(said, "_asdict"):
        return {name: plain(value) for name, value in said._asdict().items()}
    if isinstance(said, dict):
        return {name: plain(value) for name, value in said.items()}
    return [plain(value) for value in said] if isinstance(said, (list, tuple)) else said


def _figure(value: float) -> str:
    """Whole numbers where there are hundreds, four digits else."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.4g}"


def words(result: dict[str, Any]) -> str:
    """The diagnosis in some lines."""
    lines = [f"verdict: {result['verdict']}"]
    for cause in result["causes"]:
        lines.append(f"- {cause['statement']} ({cause['effect']}, probability {cause['probability']:.2f})")
        if cause["indistinguishable_from"]:
            lines.append(f"  this recording can't tell it from: {', '.join(cause['indistinguishable_from'])}")
        if cause["next_manoeuvre"]:
            lines.append(f"  to tell them apart: {cause['next_manoeuvre']}")
    for error in result["parameter_errors"]:
        configured, fitted, std = (_figure(error[key]) for key in ("configured", "fitted", "std"))
        lines.append(f"- {error['parameter']}: configured {configured}, fits best at {fitted} +- {std}")
    lines += [f"- {spins}" for spins in spins_of(result)]
    for shape in result["unlisted"]:
        if is_spin(shape):
            continue
        k = f"{shape['coefficient']['value']:.3g} {shape['coefficient']['unit']}"
        if is_formless(shape):
            lines.append(f"- {shape['channel']}: {k} (rms) is left, of no known shape")
            continue
        told = end_of(shape) or f"{shape['channel']}: {shape['shape']} with k = {k}"
        lines.append(f"- {told}, for which there is no name")
    lines += [f"- {one['statement']}" for key in ("same_as_offsets", "same_as_slip") for one in result[key]]
    levels, off = result["level"], list[str]()
    if any(value > UNEXPLAINED for value in levels.values()):
        off = [f"{name} {value:.0f} times" for name, value in levels.items() if value > UNEXPLAINED]
    elif all(map(is_formless, result["unlisted"])):
        # What is left is how the car turns: by less, but by too much for the name that it would have.
        off = [f"{name} {levels[name]:.1f} times" for name in OF_A_TURN if levels.get(name, 0.0) > TURNED]
    if off and result["verdict"] in {"unexplained", "partly_explained"}:
        lines.append(f"- not explained: {', '.join(off)} what noise and the simulation's coarseness leave")
    for place in result["located"][:3]:
        when = f"{place['start_s']:.0f} to {place['end_s']:.0f} s"
        lines.append(f"  {place['channel']}: {when}, {place['share']:.0%} of its excess")
    for channel, fit in result["fit"].items():
        held = fit["held_out"]
        if held["after"] < 0.9 * held["before"]:
            lines.append(f"  {channel}: rms on unseen data {held['before']:.4g} -> {held['after']:.4g} {fit['unit']}")
    if result["could_not_test"]:
        lines.append(f"not excited enough to test: {', '.join(one['effect'] for one in result['could_not_test'])}")
    return "\n".join(lines)


def signals_of(
    setup: Setup, logs: Sequence[Path], report: LogReport, progress: Progress | None = None
) -> dict[str, Signal]:
    """All samples of the mapped roles, stamps not falling; stamps that fall back are left out."""
    return _read(setup, logs, report, progress)[0]


def _read(
    setup: Setup, logs: Sequence[Path], report: LogReport, progress: Progress | None
) -> tuple[dict[str, Signal], list[str]]:
    """As `signals_of`, and what a user should know of what is not among them."""
    decoder = setup.decoder(setup.encoder())
    wanted = {can_id for can_id, _ in decoder.wanted_ids()}
    stamps: dict[str, list[int]] = {}
    values: dict[str, list[float]] = {}
    early: dict[str, int] = {}
    for frame in read_frames(logs, report, progress, wanted):
        for sample in decoder.decode(frame):
            mine = stamps.setdefault(sample.role, [])
            if not mine or sample.t_ns >= mine[-1]:
                mine.append(sample.t_ns)
                values.setdefault(sample.role, []).append(sample.value)
            else:
                early[sample.role] = early.get(sample.role, 0) + 1
    if not stamps:
        names = ", ".join(str(path) for path in logs)
        came = hints(setup, decoder.counters)
        raise InputError(f"{names}: none of the mapped messages is in it; is this the car of {setup.path}?{came}")
    never = never_received(setup, decoder.counters)
    _require_received(never)
    warnings = report.words()
    warnings += [f"{role}: mapped, but never received ({why})" for role, why in never.items()]
    for role, n in early.items():
        warnings.append(
            f"{role}: {n} of {n + len(stamps[role])} samples left out, whose stamps are before those of earlier ones "
            "(logs that overlap, or in another order than they were recorded?)"
        )
    for role, counts in decoder.counters.roles.items():
        if counts.refuses_many:
            warnings.append(f"{role}: {counts.words()}")
    signals = {role: Signal(np.array(stamps[role], dtype=np.int64), np.array(values[role])) for role in stamps}
    return signals, warnings
