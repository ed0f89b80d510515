"""Soak: hours of bus time through decoder, loop and encoder as fast as they go; memory flat, counts consistent.

`python tests/soak/soak.py --hours 24` (an hour of bus time takes some minutes). A simulated drive of a minute
is repeated with stamps that go on. `live_soak.py` watches a running daemon in the same way.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import sys
import tempfile
import time
from array import array
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
for folder in (ROOT, Path(__file__).resolve().parent):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

from memory_trend import rss_bytes, trend  # noqa: E402

from dsz_daemon.edge.scenario_files import write_scenario  # noqa: E402
from dsz_daemon.pipeline.frames import Frame  # noqa: E402
from dsz_daemon.pipeline.loop import Loop  # noqa: E402
from dsz_daemon.runs.setup import set_up  # noqa: E402
from dsz_daemon.sim.scenario import simulate  # noqa: E402

_LAP_S = 60
# What the growth of a day may be: restarting for it once in ten years.
MOST_GROWTH_BYTES = 2**20


@dataclass
class Soaked:
    """What a soak counted; `rss` are (hours of bus time, bytes), `blocks` Python's own blocks after each lap."""

    hours: float = 0.0
    took_s: float = 0.0
    frames: int = 0
    rows: int = 0
    sent: int = 0
    faults: list[str] = field(default_factory=list)
    rss: list[tuple[float, int]] = field(default_factory=list)
    blocks: list[int] = field(default_factory=list)
    last_rss_bytes: int = 0


def soak(
    hours: float, tell: Callable[[Soaked], None] = lambda _: None, lap_s: int = _LAP_S, rate_hz: int = 100
) -> Soaked:
    """Runs `hours` of bus time in laps of `lap_s`; `tell` hears of each."""
    drive = simulate("sine_steer", 7)
    with tempfile.TemporaryDirectory() as folder:
        write_scenario(drive, Path(folder))
        config = Path(folder) / "config.yaml"
        with config.open("a", encoding="utf-8") as text:
            text.write(f"loop: {{rate_hz: {rate_hz}}}\n")
        setup = set_up(config)
    encoder = setup.encoder()
    decoder = setup.decoder(encoder)
    loop = setup.loop(decoder)
    wanted = decoder.wanted_ids()
    start_ns = drive.frames[0].t_ns
    lap = [f for f in drive.frames if (f.can_id, f.is_extended) in wanted and f.t_ns < start_ns + lap_s * 10**9]
    del drive
    gc.collect()
    # What the simulation used is given back: a leak must not hide in it.
    ctypes.CDLL(None).malloc_trim(0)
    done, began_s, lap_ns = Soaked(), time.monotonic(), lap_s * 10**9
    laps = max(1, round(hours * 3600 / lap_s))
    # Room for all samples is taken, and touched, before the first: what is measured must not grow by being measured.
    sizes, blocks = array("q", [1] * laps), array("q", [1] * laps)
    for number in range(laps):
        for frame in lap:
            rows = loop.frame(frame._replace(t_ns=frame.t_ns + number * lap_ns))
            for row in rows:
                done.sent += len(encoder.encode(row))
            done.rows += len(rows)
        done.frames += len(lap)
        gc.collect()
        done.hours, done.took_s = (number + 1) * lap_s / 3600, time.monotonic() - began_s
        sizes[number] = done.last_rss_bytes = rss_bytes()
        blocks[number] = sys.getallocatedblocks()
        tell(done)
    done.rss = [((number + 1) * lap_s / 3600, size) for number, size in enumerate(sizes)]
    done.blocks = blocks.tolist()
    done.rows += len(loop.finish())
    done.faults = _inconsistencies(done, decoder.counters, loop, (lap[0], lap[-1]), (laps - 1) * lap_ns)
    return done


def _inconsistencies(done: Soaked, counters: Any, loop: Loop, ends: tuple[Frame, Frame], shift_ns: int) -> list[str]:
    """What does not add up: counts are checked against what was fed, not against each other alone."""
    period_ns = loop.settings.period_ns
    last_ns = ends[1].t_ns + shift_ns
    # Ticks lie on whole multiples of the period, from the first frame's to the last one's.
    ticks = last_ns // period_ns - -(-ends[0].t_ns // period_ns) + 1
    used = sum(message.frames for message in counters.messages.values())
    refused = sum(message.refused for message in counters.messages.values())
    others = counters.unwanted + counters.own + counters.remote + counters.error_frames + counters.ambiguous
    values = sum(counts.samples + counts.rejected + counts.not_present for counts in counters.roles.values())
    seen = loop.memory.counters
    pairs = [
        ("rows, ticks from first to last frame", done.rows, ticks),
        ("frames decoded, fed", counters.frames, done.frames),
        ("frames used, refused and others, fed", used + refused + others, done.frames),
        ("frames that were used, all being wanted", used, done.frames),
        ("samples, accepted values", seen.samples, counters.samples),
        ("values accepted or rejected, decoded", values, counters.samples + counters.rejected - refused),
        ("gaps", seen.gaps, 0),
        ("clock steps", seen.clock_steps, 0),
    ]
    return [f"{what}: {one} and {other}" for what, one, other in pairs if one != other]


def conclusion(done: Soaked) -> tuple[bool, str]:
    """Whether all is well, and the words."""
    line = trend(done.rss)
    flat = line.is_flat(MOST_GROWTH_BYTES)
    speed = done.hours * 3600 / done.took_s
    words = [
        f"{done.hours:.2f} h of bus time in {done.took_s / 60:.1f} min ({speed:.1f} times real time)",
        f"{done.frames:,} frames in, {done.rows:,} rows, {done.sent:,} frames out",
        f"RSS {done.rss[0][1] / 2**20:.1f} MiB after a minute, {done.rss[-1][1] / 2**20:.1f} MiB at the end; "
        f"after the first tenth {line.bytes_per_hour / 1024:+.2f} +- {line.error_bytes_per_hour / 1024:.2f} KiB/h, "
        f"{line.growth_bytes / 1024:+.0f} KiB in all: {'flat' if flat else 'IT GROWS'}",
        *(f"NOT CONSISTENT: {fault}" for fault in done.faults),
    ]
    if not done.faults:
        words.append("counters consistent")
    return flat and not done.faults, "\n".join(words)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the soak; 0 if memory is flat and all counts add up."""
    parser = argparse.ArgumentParser(description="Hours of bus time, as fast as they go.")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rate", type=int, default=100, metavar="HZ", help="20 takes a third of the time")
    parser.add_argument("--lap", type=int, default=_LAP_S, metavar="S", help="how much of the drive is repeated")
    parser.add_argument("-o", "--output", type=Path, help="also write the result as JSON, after every hour")
    arguments = parser.parse_args(argv)

    def tell(done: Soaked) -> None:
        if round(done.hours * 60) % 60 == 0:
            print(
                f"{done.hours:.0f} h in {done.took_s / 60:.1f} min, RSS {done.last_rss_bytes / 2**20:.2f} MiB",
                flush=True,
            )
            if arguments.output is not None:
                arguments.output.write_text(json.dumps(asdict(done)), encoding="utf-8")

    done = soak(arguments.hours, tell, arguments.lap, arguments.rate)
    if arguments.output is not None:
        arguments.output.write_text(json.dumps(asdict(done)), encoding="utf-8")
    good, words = conclusion(done)
    print(words)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
