"""The fuzzers: `python tests/fuzz/fuzz.py` runs all of them in full, `--quick` a little of each.

Deterministic: a chunk's inputs follow from target, seed and number alone. A failure is saved and told with
the command that repeats it. `--resume` passes over chunks that the results file has already.
"""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from itertools import combinations
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
for folder in (HERE, ROOT):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

from fuzz_chunk import ChunkResult, Target, run_chunk, run_one  # noqa: E402

MODULES = ("frames", "lines", "configs", "dbcs", "states", "recordings", "status")
SEED = 20261121
# What all inputs of a target together may leave in memory.
MOST_GROWTH_BYTES = 16 * 2**20
# What a worker may hold at any time: Python, cantools' largest networks, and one input.
MOST_PEAK_BYTES = 512 * 2**20
_MOST_MEMORY_BYTES = 3 * 2**30


def target_named(name: str) -> Target:
    """The target of `fuzz_NAME.py`."""
    target: Target = importlib.import_module(f"fuzz_{name}").TARGET
    return target


def _worker_starts() -> None:
    """A memory bomb must fail as a MemoryError here, not take the machine along."""
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY_BYTES, _MOST_MEMORY_BYTES))


def _chunk(name: str, seed: int, chunk: int, inputs: int, failures: str) -> ChunkResult:
    return run_chunk(target_named(name), seed, chunk, inputs, Path(failures))


def chunks(target: Target, scale: float, quick: bool) -> list[tuple[int, int]]:
    """(number, inputs) of all chunks; a smaller scale runs the first ones."""
    if quick:
        return [(0, target.quick)]
    left, found = max(1, round(target.amount * scale)), []
    while left > 0:
        found.append((len(found), min(left, target.per_chunk)))
        left -= found[-1][1]
    return found


def growth_bytes(results: Sequence[ChunkResult]) -> tuple[float, float]:
    """(growth over all inputs, bytes an input) of resident memory.

    Theil and Sen's slope (the median over all pairs of samples) of each chunk without its first quarter, and of
    those the median: a leak shows in most chunks, the one large input that leaves the heap larger in one only.
    """
    slopes = []
    for result in results:
        late = result.rss[len(result.rss) // 4 :]
        pairs = [(y2 - y1) / (x2 - x1) for (x1, y1), (x2, y2) in combinations(late, 2) if x2 > x1]
        slopes += [median(pairs)] if pairs else []
    slope = median(slopes) if slopes else 0.0
    return slope * sum(result.inputs for result in results), slope


def _run(target: Target, wanted: Sequence[tuple[int, int]], arguments: argparse.Namespace) -> Iterator[ChunkResult]:
    """The chunks' results as they come; a worker that died is a failure of its chunk. No jobs: in this process."""
    failures = str(arguments.out / "failures")
    if not wanted or not arguments.jobs:
        yield from (_chunk(target.name, arguments.seed, n, size, failures) for n, size in wanted)
        return
    context = multiprocessing.get_context("spawn")
    jobs = min(arguments.jobs, len(wanted))
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_worker_starts) as pool:
        runs = {pool.submit(_chunk, target.name, arguments.seed, n, size, failures): n for n, size in wanted}
        for run in as_completed(runs):
            try:
                yield run.result()
            except BrokenProcessPool:
                result = ChunkResult(target.name, arguments.seed, runs[run])
                again = f"python tests/fuzz/fuzz.py --target {target.name} --seed {arguments.seed} --chunk {runs[run]}"
                result.failures.append(f"a worker died (hung in C code, or out of memory)\n    again: {again}")
                yield result


def _told(target: Target, results: Sequence[ChunkResult], wall_s: float, quick: bool) -> bool:
    """Prints what became of a target; False if it failed.

    A quick run's few inputs don't tell what is growth from what is read once and kept.
    """
    inputs, cpu_s = sum(r.inputs for r in results), sum(r.cpu_s for r in results)
    outcomes: Counter[str] = Counter()
    for result in results:
        outcomes.update(result.outcomes)
    growth, slope = growth_bytes(results)
    failures = [failure for result in results for failure in result.failures]
    if growth > MOST_GROWTH_BYTES and not quick:
        failures.append(f"memory grew by {growth / 2**20:.1f} MiB, {slope:.2f} bytes an input")
    peak = max(r.peak_bytes for r in results)
    if peak > MOST_PEAK_BYTES:
        failures.append(f"{peak / 2**20:.0f} MiB of memory at a time")
    rate = f"{cpu_s / max(1, inputs) * 1e6:.1f} us each"
    print(f"{target.name}: {inputs:,} {target.meaning}")
    slowest_s = max(r.slowest_s for r in results)
    print(f"  {len(results)} chunks, {wall_s:.0f} s; {cpu_s:.0f} s of CPU ({rate}), slowest step {slowest_s:.2f} s")
    print(f"  outcomes: {', '.join(f'{name} {count:,}' for name, count in sorted(outcomes.items()))}")
    trend = f"{growth / 2**20:+.1f} MiB in all ({slope:+.2f} bytes an input)"
    print(f"  memory: {trend}, peak {peak / 2**20:.0f} MiB")
    for failure in failures:
        print(f"  FAILED {failure}")
    print(f"  {'FAILED' if failures else 'passed'}: {len(failures)} failures", flush=True)
    return not failures


def _known(path: Path, seed: int) -> dict[tuple[str, int, int], ChunkResult]:
    """Results without failures of this seed by (target, chunk, inputs)."""
    if not path.exists():
        return {}
    found = [ChunkResult(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]
    return {(r.target, r.chunk, r.inputs): r for r in found if r.seed == seed and not r.failures}


def _parsed(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--target", action="append", choices=MODULES, help="only this one; may be repeated")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--quick", action="store_true", help="some seconds a target")
    parser.add_argument("--scale", type=float, default=1.0, help="times the full amounts")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2); 0: none but this one")
    parser.add_argument("--chunk", type=int, help="only the chunk of this number")
    parser.add_argument("--input", type=Path, help="only this saved input, with its traceback")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="results and failures (default out/fuzz)")
    parser.add_argument("--resume", action="store_true", help="pass over chunks that OUT/results.jsonl has already")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs what is asked; 0 if nothing was found."""
    arguments = _parsed(argv)
    names = arguments.target or MODULES
    if arguments.input is not None:
        run_one(target_named(names[0]), arguments.input.read_bytes())
        print("passed")
        return 0
    if not arguments.jobs:
        _worker_starts()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "results.jsonl"
    known = _known(path, arguments.seed) if arguments.resume else {}
    print(f"seed {arguments.seed}, {arguments.jobs} jobs, Python {sys.version.split()[0]}")
    good = True
    with path.open("a" if arguments.resume else "w", encoding="utf-8") as file:
        for name in names:
            target, began_s = target_named(name), time.monotonic()
            asked = chunks(target, arguments.scale, arguments.quick)
            if arguments.chunk is not None:
                asked = [(n, size) for n, size in asked if n == arguments.chunk]
            results = [known[name, n, size] for n, size in asked if (name, n, size) in known]
            for result in _run(target, [(n, size) for n, size in asked if (name, n, size) not in known], arguments):
                file.write(result.line() + "\n")
                file.flush()
                results.append(result)
            good = (bool(results) and _told(target, results, time.monotonic() - began_s, arguments.quick)) and good
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
