"""Inside: `dsz run` on vcan0 that writes OUT/ready once its sockets are open, and OUT/summary.json at its end.

The summary's live.missed_rows are [due, published or dropped] in ns, of rows that came a whole period late or more.

    python tests/vcan/live_on.py CONFIG OUT STATUS

It answers at the socket STATUS, as the service does.
"""

from __future__ import annotations

import json
import sys
import time
from array import array
from pathlib import Path

from dsz_daemon.edge.realtime import calm_collector
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.runs.live import Live, LiveOptions
from dsz_daemon.runs.service import Paths, Service
from dsz_daemon.runs.setup import set_up
from dsz_daemon.runs.summary import finite


def main(config: str, out: str, status: str) -> None:
    setup = set_up(Path(config), ["can0=socketcan:vcan0", *_others(config)], live=True)
    with Service(Paths(status=Path(status))) as service:
        # Its room is taken at once: this daemon's memory is watched.
        late = array("q", bytes(16 * 1000))
        count = 0

        def look(row: Row) -> None:
            nonlocal count
            now_ns = time.time_ns()
            if now_ns - row.t_ns > 1e9 * (1.0 / setup.settings.loop.rate_hz + setup.settings.loop.guard_s):
                late[count % 2000], late[(count + 1) % 2000] = row.t_ns, now_ns
                count += 2

        live = Live(setup, LiveOptions(on_ready=Path(out, "ready").touch, on_row=look), service)
        calm_collector()
        summary = live.run()
    summary["live"]["missed_rows"] = [list(pair) for pair in zip(late[::2], late[1::2], strict=True) if pair[0]]
    summary["live"]["lateness_us"]["bins"] = live.facts().lateness.bins()
    Path(out, "summary.json").write_text(json.dumps(finite(summary)))


def _others(config: str) -> list[str]:
    """Further buses that the configuration names, all on vcan1."""
    names = set_up(Path(config)).settings.buses
    return [f"{name}=socketcan:vcan1" for name in names if name != "can0"]


if __name__ == "__main__":
    main(*sys.argv[1:])
