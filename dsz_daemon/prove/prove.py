"""`dsz prove`: recordings are made and sealed, a process that sees no truth answers, seals are opened and scored."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from dsz_daemon import __version__
from dsz_daemon.edge.samples_file import write_columns
from dsz_daemon.errors import ConfigError, Fault, InputError, MachineError
from dsz_daemon.prove.mix import Trial, trials
from dsz_daemon.prove.recordings import PACKED, made
from dsz_daemon.prove.rivals import boosting_and_regression
from dsz_daemon.prove.score import SECONDS, is_first, scored
from dsz_daemon.prove.seal import hash_of, hash_of_judge, hash_of_sources, hash_of_text, opened, sealed
from dsz_daemon.prove.shorter import LENGTHS_S, begin, chosen, name_of
from dsz_daemon.prove.summary import summary
from dsz_daemon.prove.third_party_model import packages

Progress = Callable[[int, int], None]

SEALS, SCORES = "seal.json", "scores.json"
_MADE_BY = ("sim/*.py", "prove/mix.py", "prove/sizes.py", "prove/ways.py", "prove/unlisted.py", "prove/recordings.py",
            "prove/own_car.py", "prove/third_party_*.py")  # fmt: skip
_SCORED_BY = ("prove/score.py", "prove/reasons.py", "prove/rivals.py")


def prove(
    folder: Path, seed: int, count: int, jobs: int | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """The scores of `count` sealed trials; what `folder` holds of them already is not done again.

    ConfigError: a negative seed, or the folder holds another proof. InputError: a seal or a recording is not what was
    published. MachineError: what it takes is not installed, or can't be written.
    """
    if seed < 0:
        raise ConfigError("can't prove", [Fault("--seed", f"{seed} is negative; expected 0 or more")])
    packages()
    boosting_and_regression()
    drawn = trials(seed, count)
    protocol = {
        "seed": seed,
        "trials": count,
        "version": __version__,
        "made_by": hash_of_sources(_MADE_BY),
        "judge": hash_of_judge(),
    }
    _claim(folder, protocol)
    tell = _Teller(3 * count + len(LENGTHS_S) * len(chosen(drawn)), progress)
    if not (folder / SEALS).exists():
        hashes = dict(_each(_sealed_trial, [(trial, folder) for trial in drawn], jobs, tell))
        published = {"protocol": protocol, "truths": hashes, "recordings": _recordings(folder, drawn)}
        (folder / SEALS).write_text(json.dumps(published, indent=1, sort_keys=True), encoding="utf-8")
    tell.reach(count)
    published = json.loads((folder / SEALS).read_text(encoding="utf-8"))
    _ask([(_recording(folder, trial), _answer(folder, trial)) for trial in drawn], jobs, tell)
    if _recordings(folder, drawn) != published["recordings"]:
        raise InputError(f"{folder}: a recording is not the one that was sealed")
    _ask_of_beginnings(folder, drawn, jobs, tell)
    by = hash_of_sources(_SCORED_BY)
    found = list(_each(_scored_trial, [(trial, folder, published["truths"], by) for trial in drawn], jobs, tell))
    found.sort(key=lambda one: one["number"])
    result = {"protocol": protocol, "summary": summary(found), "trials": found}
    (folder / SCORES).write_text(json.dumps(result, indent=1), encoding="utf-8")
    return result


class _Teller:
    """Counts what is done, of three steps a trial."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def one(self) -> None:
        """One step more."""
        self.reach(self._done + 1)

    def reach(self, done: int) -> None:
        """So many steps."""
        self._done = max(done, self._done)
        if self._progress is not None:
            self._progress(self._done, self._total)


def _claim(folder: Path, protocol: dict[str, Any]) -> None:
    path = folder / "protocol.json"
    if not path.exists():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(protocol, indent=1), encoding="utf-8")
        except OSError as error:
            raise MachineError(f"{folder}: can't write results here: {error.strerror or error}") from error
    there = json.loads(path.read_text(encoding="utf-8"))
    other = [key for key in protocol if there.get(key) != protocol[key]]
    if other:
        what = ", ".join(f"{key} {there.get(key)}" for key in other)
        raise ConfigError("can't prove", [Fault("-o", f"{folder} holds another proof ({what}); expected a new folder")])


def _recording(folder: Path, trial: Trial) -> Path:
    return folder / "recordings" / f"{trial.number:05d}"


def _answer(folder: Path, trial: Trial) -> Path:
    return folder / "answers" / f"{trial.number:05d}"


def _truth(folder: Path, trial: Trial) -> Path:
    return folder / "sealed" / f"{trial.number:05d}.json"


def _recordings(folder: Path, drawn: Iterable[Trial]) -> dict[str, str]:
    return {f"{trial.number:05d}": hash_of(_recording(folder, trial).iterdir()) for trial in drawn}


def _sealed_trial(task: tuple[Trial, Path]) -> tuple[str, str]:
    trial, folder = task
    path = _truth(folder, trial)
    if path.exists():
        return f"{trial.number:05d}", hash_of_text(path)
    truth, profiles = made(trial, _recording(folder, trial))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_columns(profiles, path.with_suffix(".parquet"))
    return f"{trial.number:05d}", sealed(truth | {"profiles": hash_of([path.with_suffix(".parquet")])}, path)


def _scored_trial(task: tuple[Trial, Path, dict[str, str], str]) -> dict[str, Any]:
    trial, folder, published, by = task
    path = _truth(folder, trial)
    truth, profiles = opened(path, published[f"{trial.number:05d}"]), path.with_suffix(".parquet")
    if hash_of([profiles]) != truth["profiles"]:
        raise InputError(f"{profiles}: not what was sealed")
    # As this version scores.
    kept = _answer(folder, trial) / f"score-{by[:12]}.json"
    if kept.exists():
        one: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8"))
        return one
    one = scored(truth, _answer(folder, trial), profiles)
    beginnings = {length_s: _of_beginning(folder, trial, length_s) for length_s in LENGTHS_S}
    one["first_of"] = {
        f"{length_s:g}": is_first(truth, answer) for length_s, answer in beginnings.items() if answer.exists()
    }
    kept.write_text(json.dumps(one), encoding="utf-8")
    return one


def _each(function: Callable[[Any], Any], tasks: Sequence[Any], jobs: int | None, tell: _Teller) -> Iterator[Any]:
    # Fresh processes: a fork of one with threads may hang.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(function, task) for task in tasks]
        try:
            for future in as_completed(running):
                yield future.result()
                tell.one()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _ask_of_beginnings(folder: Path, drawn: Sequence[Trial], jobs: int | None, tell: _Teller) -> None:
    """The same of the first part of some recordings, before any seal is opened."""
    asked = []
    for trial in chosen(drawn):
        for length_s in LENGTHS_S:
            recording = folder / "beginnings" / name_of(trial, length_s)
            begin(_recording(folder, trial), length_s, recording)
            asked.append((recording, _of_beginning(folder, trial, length_s)))
    _ask(asked, jobs, tell)


def _of_beginning(folder: Path, trial: Trial, length_s: float) -> Path:
    return folder / "answers" / name_of(trial, length_s)


def _ask(asked: Sequence[tuple[Path, Path]], jobs: int | None, tell: _Teller) -> None:
    """Processes that are given folders of recordings, and folders for their answers, and nothing else."""
    waiting: Queue[tuple[Path, Path]] = Queue()
    for recording, answer in asked:
        # Written last.
        if (answer / SECONDS).exists():
            tell.one()
        else:
            waiting.put((recording, answer))
    workers = min(jobs or _cpus(), max(waiting.qsize(), 1))
    with ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(_served, waiting, tell) for _ in range(workers)]:
            done.result()


def _cpus() -> int:
    return os.cpu_count() or 1


def _served(waiting: Queue[tuple[Path, Path]], tell: _Teller) -> None:
    """One such process, fed until nothing waits."""
    command = [sys.executable, "-m", "dsz_daemon.runs.blind"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as worker:  # noqa: S603 - our own program
        while True:
            try:
                recording, answer = waiting.get_nowait()
            except Empty:
                break
            if worker.stdin is None or worker.stdout is None:
                raise MachineError("the process that answers has no pipes")
            worker.stdin.write(f"{recording}\t{answer}\n")
            worker.stdin.flush()
            said = worker.stdout.readline()
            if not said:
                raise MachineError(f"the process that answers ended at {recording / PACKED}")
            (answer / SECONDS).write_text(said.rpartition("\t")[2].strip(), encoding="utf-8")
            tell.one()
        if worker.stdin is not None:
            worker.stdin.close()
