"""Inside: a program that does nothing but wake every 2 ms, before all others: when it was late, the machine was.

    python tests/vcan/hitches.py OUT

On SIGTERM it writes OUT: a JSON list of [due, woken] in ns of CLOCK_REALTIME, where it woke more than 4 ms late.
A virtual machine's host takes its CPU away for tens of ms at times; no program in it can be on time then.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import time
from pathlib import Path

_PERIOD_NS, _LATE_NS = 2_000_000, 4_000_000


def main(out: str) -> None:
    os.nice(-20)
    stop: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(1))
    found = []
    gc.disable()
    due_ns = time.monotonic_ns()
    while not stop:
        due_ns = max(due_ns + _PERIOD_NS, time.monotonic_ns())
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        late_ns = time.monotonic_ns() - due_ns
        if late_ns > _LATE_NS:
            now_ns = time.time_ns()
            found.append([now_ns - late_ns, now_ns])
    Path(out).write_text(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
