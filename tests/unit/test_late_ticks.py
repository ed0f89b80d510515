"""What is published after the machine held the loop up: the newest two rows; the alive counter tells of the others."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from dsz_daemon.config.settings import BusSettings
from dsz_daemon.edge.bus import Buses
from dsz_daemon.edge.dbc import load_dbc
from dsz_daemon.edge.log_report import LogReport
from dsz_daemon.edge.logs import read_frames
from dsz_daemon.runs.live import Live, LiveOptions
from dsz_daemon.runs.setup import set_up
from dsz_daemon.shipped import shipped

GOLDEN = Path(__file__).parents[1] / "golden"
MS = 1_000_000


class Hitched:
    """A clock that a test sets."""

    def __init__(self, now_ns: int) -> None:
        self.now = now_ns

    def now_ns(self) -> int:
        return self.now

    def seconds_until(self, _t_ns: int) -> float:
        return 0.0

    def look(self) -> int:
        return 0

    def bus_time_ns(self, _stamp_ns: int, now_ns: int, /) -> int:
        return now_ns


@pytest.mark.parametrize(("late_ms", "missed"), [(10, 0), (20, 0), (30, 1), (70, 5)])
def test_the_newest_two_rows_are_published(late_ms: int, missed: int) -> None:
    frames = list(read_frames([GOLDEN / "sine_steer.log.gz"], LogReport()))
    bus = BusSettings(interface="virtual", channel=f"late-{late_ms}")
    clock = Hitched(frames[0].t_ns)
    steps = iter([10] * 40 + [late_ms] + [10] * 20)
    waiting = iter(frames)
    ahead = next(waiting)
    with Buses({"can0": bus.arguments}) as others:

        def play() -> bool:
            nonlocal ahead
            step_ms = next(steps, None)
            if step_ms is None:
                return True
            clock.now += step_ms * MS
            while ahead.t_ns <= clock.now:
                others.send(ahead)
                ahead = next(waiting)
            return False

        options = LiveOptions(clock=clock, should_stop=play)
        summary = Live(set_up(GOLDEN / "sine_steer/config.yaml").on_buses({"can0": bus}), options).run()
        heard = others.receive(10_000)
    rates = load_dbc(str(shipped("dbc/dsz.dbc")), Path()).database.get_message_by_name("DSZ_RATES")
    counters = [rates.decode(frame.data)["E2E_COUNTER"] for frame in heard if frame.can_id == rates.frame_id]
    leaps = [(int(later) - int(earlier)) % 16 for earlier, later in pairwise(counters)]
    assert summary["counts"]["missed"] == missed
    assert len(counters) == summary["rows"] - missed
    assert [leap for leap in leaps if leap != 1] == ([missed + 1] if missed else [])
    # The row before the newest came a period late, and its lateness counts as well.
    assert summary["live"]["lateness_us"]["max"] == pytest.approx(8000.0 + min(late_ms - 10, 10) * 1000.0, abs=3000.0)
