"""`dsz bench accuracy`: how far estimated offsets are from the true ones, over seeds, scenarios and estimators.

A trial is one scenario with one seed's sensors. Its readings are those that `dsz simulate` packs into frames, put onto
the loop's grid all at once and stepped through by the compiled estimator; that this equals `dsz replay` is tested.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from dsz_daemon import __version__
from dsz_daemon.core import batch
from dsz_daemon.core.parameters import Car, Inputs, Tuning
from dsz_daemon.core.state import initial_state
from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.grid import Signal, Stamps, gridded, ticks_between
from dsz_daemon.runs import rivals
from dsz_daemon.runs.results import output_folder
from dsz_daemon.runs.setup import Setup, set_up
from dsz_daemon.runs.summary import write_json
from dsz_daemon.runs.truth import offset_errors
from dsz_daemon.signals import IMU_CHANNELS, WHEEL_SPEEDS
from dsz_daemon.sim import scenario as scenarios
from dsz_daemon.sim.bus import configuration, dbc_files
from dsz_daemon.sim.catalogue import SCENARIOS, Scenario
from dsz_daemon.sim.coding import EPOCH_S, Series, stamps_ns
from dsz_daemon.sim.drive import Columns, drive
from dsz_daemon.sim.imu import offset_columns
from dsz_daemon.sim.vehicle import TwoTrackCar, rolling

Floats = batch.Floats
Progress = Callable[[int, int], None]
Trial = dict[str, Any]

RAW, STANDSTILL, HIGH_PASS, PRINTED, PAPER = "raw", "zero at standstill", "high-pass", "as printed", "dsz"
ESTIMATORS = (RAW, STANDSTILL, HIGH_PASS, PRINTED, PAPER)
_MADE_BY = ("signals.py", "core/*.py", "pipeline/*.py", "sim/*.py", "config/*.py", "runs/accuracy.py", "runs/rivals.py")
# So many seeds a task: a drive is made once for them.
_SEEDS_A_TASK = 10


class _Bench(NamedTuple):
    """What all trials of a scenario share."""

    scenario: Scenario
    columns: Columns
    setup: Setup


def accuracy(
    folder: Path,
    seeds: int = 100,
    names: Sequence[str] = (),
    jobs: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Runs what `folder` doesn't hold yet of seeds 1 to `seeds` in each scenario; returns all trials.

    ConfigError: no such scenario. Trials of another version of the package are not taken for this one's.
    """
    names = tuple(names) or tuple(SCENARIOS)
    unknown = [name for name in names if name not in SCENARIOS]
    if unknown:
        known = ", ".join(SCENARIOS)
        raise ConfigError(
            "can't measure", [Fault("--scenario", f"unknown {name!r}; known: {known}") for name in unknown]
        )
    store = output_folder(output_folder(folder) / f"trials-{_made_by()}")
    wanted = [(name, seed) for name in names for seed in range(1, seeds + 1)]
    missing: dict[str, list[int]] = {}
    for name, seed in wanted:
        if not _file(store, name, seed).exists():
            missing.setdefault(name, []).append(seed)
    tasks = [
        (name, rest[first : first + _SEEDS_A_TASK])
        for name, rest in missing.items()
        for first in range(0, len(rest), _SEEDS_A_TASK)
    ]
    done = len(wanted) - sum(len(found) for _, found in tasks)
    for found in _results(tasks, jobs):
        for trial in found:
            write_json(trial, _file(store, trial["scenario"], trial["seed"]))
        done += len(found)
        if progress is not None:
            progress(done, len(wanted))
    trials = [json.loads(_file(store, name, seed).read_text()) for name, seed in wanted]
    return {
        "version": __version__,
        "scenarios": list(names),
        "seeds": seeds,
        "estimators": list(ESTIMATORS),
        "trials": trials,
    }


def _results(tasks: Sequence[tuple[str, list[int]]], jobs: int | None) -> Iterator[list[Trial]]:
    if jobs == 1 or len(tasks) < 2:
        for name, found in tasks:
            yield trials_of(name, found)
        return
    # Fresh processes: a fork of one with threads may hang.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(trials_of, name, found) for name, found in tasks]
        try:
            for future in as_completed(running):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _file(store: Path, name: str, seed: int) -> Path:
    return store / f"{name}-{seed:05d}.json"


def _made_by() -> str:
    """A name for what the figures depend on: the sources that make them."""
    content, package = hashlib.sha256(), Path(__file__).parents[1]
    for pattern in _MADE_BY:
        for source in sorted(package.glob(pattern)):
            content.update(source.relative_to(package).as_posix().encode())
            content.update(source.read_bytes())
    return content.hexdigest()[:12]


def trials_of(name: str, seeds: Sequence[int]) -> list[Trial]:
    """The trials of one scenario with these seeds."""
    bench = _bench(name)
    return [_trial(bench, name, seed) for seed in seeds]


def _bench(name: str) -> _Bench:
    scenario = SCENARIOS[name]
    start = rolling(scenario.car, scenario.start_mps) if scenario.start_mps > 0.0 else None
    columns = drive(TwoTrackCar(scenario.car, scenario.road), scenario.programme, start=start)
    with tempfile.TemporaryDirectory() as folder:
        for file, text in dbc_files().items():
            (Path(folder) / file).write_text(text)
        (Path(folder) / "config.yaml").write_text(yaml.safe_dump(configuration(scenario.car)))
        return _Bench(scenario, columns, set_up(Path(folder) / "config.yaml"))


def _trial(bench: _Bench, name: str, seed: int) -> Trial:
    errors = scenarios.drawn_errors(seed)
    series = scenarios.series_of(bench.scenario, bench.columns, errors, seed)
    ticks_ns, inputs = gridded_inputs(bench.setup, series)
    time_s: Floats = np.asarray((ticks_ns - EPOCH_S * 1_000_000_000) * 1e-9, dtype=np.float64)
    true = np.column_stack([offset_columns(errors, time_s)[channel] for channel in IMU_CHANNELS])
    dt_s = 1.0 / bench.setup.settings.loop.rate_hz
    readings, wheels = inputs[:, :6], inputs[:, 6:10]
    trial: Trial = {"scenario": name, "seed": seed, "duration_s": float(time_s[-1] - time_s[0]), "channels": {}}
    found: dict[str, tuple[Floats, Floats]] = {}
    for estimator, rival in ((RAW, rivals.raw), (STANDSTILL, rivals.zero_at_standstill), (HIGH_PASS, rivals.high_pass)):
        offset = rival(readings, wheels, dt_s)
        found[estimator] = offset, np.full_like(offset, np.nan)
    settings, car = bench.setup.settings.estimator, bench.setup.settings.vehicle.car()
    printed = settings.model_copy(update={"as_printed": True}).tuning()
    for estimator, tuning in ((PRINTED, printed), (PAPER, settings.tuning())):
        found[estimator] = _estimated(car, tuning, inputs, dt_s)
    for axis, channel in enumerate(IMU_CHANNELS):
        goal = getattr(settings.tuning(), channel).goal_std
        trial["channels"][channel] = {
            estimator: offset_errors(time_s, offset[:, axis], std[:, axis], true[:, axis], goal)
            for estimator, (offset, std) in found.items()
        }
    return trial


def _estimated(car: Car, tuning: Tuning, inputs: Floats, dt_s: float) -> tuple[Floats, Floats]:
    rows = batch.run(car, tuning, initial_state(tuning), inputs, dt_s)[1]
    return rows[:, batch.OFFSET : batch.OFFSET + 6], rows[:, batch.STD : batch.STD + 6]


def gridded_inputs(setup: Setup, series: Sequence[Series]) -> tuple[Stamps, Floats]:
    """The loop's ticks (n,), and what the estimator is told at each (n, 14), of a simulated drive."""
    signals = _signals(setup, series)
    first = min(int(signal.t_ns[0]) for signal in signals.values())
    last = max(int(signal.t_ns[-1]) for signal in signals.values())
    loop = setup.settings.loop
    ticks_ns = ticks_between(first, last, round(1e9 / loop.rate_hz))
    columns = gridded(signals, ticks_ns, round(loop.stale_after_s * 1e9))
    columns["road_wheel_angle"] = columns["steering_wheel_angle"] / setup.settings.vehicle.steering_ratio
    names = (*IMU_CHANNELS, *WHEEL_SPEEDS, *Inputs._fields[10:])
    missing = np.full(len(ticks_ns), np.nan)
    return ticks_ns, np.column_stack([columns.get(name, missing) for name in names])


def _signals(setup: Setup, series: Sequence[Series]) -> dict[str, Signal]:
    """Each role's samples in SI, as the decoder reads them."""
    by_message = {each.message: each for each in series}
    signals = {}
    for source in setup.checked.resolved.sources:
        each, message = by_message[source.message], setup.checked.resolved.messages[source.message]
        total = np.zeros(len(each.stamp_us))
        for part in source.parts:
            signal = message.get_signal_by_name(part.signal)
            total = total + part.sign * (each.raw[part.signal] * float(signal.scale) + float(signal.offset))
        if source.volts_per_count is not None:
            total = (total * source.volts_per_count - source.null_volts) / source.volts_per_unit
        values = (total != 0.0).astype(np.float64) if source.is_switch else source.sign * source.to_si * total
        signals[source.role] = Signal(stamps_ns(each.stamp_us), values)
    return signals
