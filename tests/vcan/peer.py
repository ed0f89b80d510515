"""Inside: the job the usual way, as a yardstick: python-can's Notifier thread, cantools, time.sleep.

    python tests/vcan/peer.py CONFIG OUT

It does without the estimator: it decodes every wanted message with cantools and publishes the latest raw values in
DSZ_RATES and DSZ_ACCEL at 100 Hz. OUT/summary.json gets its lateness and the number of frames it saw.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import can

from dsz_daemon.edge.dbc import load_dbc
from dsz_daemon.edge.realtime import calm_collector
from dsz_daemon.pipeline.lateness import Lateness
from dsz_daemon.runs.setup import set_up
from dsz_daemon.shipped import shipped

PERIOD_NS = 10_000_000


def main(config: str, out: str) -> None:
    setup = set_up(Path(config), ["can0=socketcan:vcan0"])
    resolved = setup.checked.resolved
    wanted = {resolved.messages[source.message].frame_id for source in resolved.sources}
    messages = {message.frame_id: message for message in resolved.messages.values()}
    output = load_dbc(str(shipped("dbc/dsz.dbc")), Path()).database
    latest: dict[str, Any] = {}
    seen = [0]

    def take(message: can.Message) -> None:
        seen[0] += 1
        if message.arbitration_id in wanted:
            latest.update(messages[message.arbitration_id].decode(bytes(message.data), decode_choices=False))

    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    late, sent = Lateness(), 0
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        notifier = can.Notifier(bus, [take])
        Path(out, "ready").touch()
        calm_collector()
        due_ns = time.monotonic_ns() // PERIOD_NS * PERIOD_NS
        while not stop.is_set():
            due_ns += PERIOD_NS
            time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
            rate = float(latest.get("YAW_RATE", 0.0))
            for name, values in (("DSZ_RATES", ("P", "Q", "R")), ("DSZ_ACCEL", ("AX", "AY", "AZ"))):
                described = output.get_message_by_name(name)
                zeros = dict.fromkeys((signal.name for signal in described.signals), 0)
                data = described.encode({**zeros, **dict.fromkeys(values, rate)}, scaling=True)
                bus.send(can.Message(arbitration_id=described.frame_id, data=data, is_extended_id=False))
                sent += 1
            late.add((time.monotonic_ns() - due_ns) * 1e-3)
        notifier.stop()
    lateness = {"p50": late.percentile_us(50), "p99": late.percentile_us(99), "max": late.max_us}
    Path(out, "summary.json").write_text(json.dumps({"lateness_us": lateness, "received": seen[0], "sent": sent}))


if __name__ == "__main__":
    main(*sys.argv[1:])
