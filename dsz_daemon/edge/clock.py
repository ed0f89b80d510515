"""Where time comes from, as an object that is handed in: the machine's clock, or a scaled one for replay."""

from __future__ import annotations

import time
from typing import Protocol

# A step is what no slewing does between two looks; slews (500 ppm) are followed.
_STEP_NS = 5_000_000
# Two clocks are compared only where reading them took no longer than this.
_BRACKET_NS = 200_000
_TRIES = 5
# So long after a step, frames with stamps from before it may still wait in a queue.
_MIXED_NS = 2_000_000_000
# Stamps older than this (or from the future) make us look whether the clock was set.
_NEAR_NS = 500_000_000


class Clock(Protocol):
    """A clock on the bus's time: integer nanoseconds since the epoch."""

    def now_ns(self) -> int:
        """Now."""
        ...

    def seconds_until(self, t_ns: int) -> float:
        """How long (real seconds, never negative) until t_ns."""
        ...

    def look(self) -> int:
        """Whether somebody set the clock since the last look: by how many ns, 0 if not."""
        ...

    def bus_time_ns(self, stamp_ns: int, now_ns: int, /) -> int:
        """Bus time of a frame's stamp; `now_ns`: asked after the frame was taken."""
        ...


class WallClock:
    """The machine's clock, what the kernel stamps frames with, without its steps.

    When somebody sets the clock (GNSS, NTP, a user), bus time goes on as if nothing had happened:
    `look` sees the step against the boot clock, which counts through suspend as well, and later
    times and stamps are corrected by it. `steps` counts them.
    """

    def __init__(self) -> None:
        self.correction_ns = 0
        self.steps = 0
        self._before_ns = 0
        self._stepped_ns: int | None = None
        self._ahead_ns = _ahead_ns() or 0

    def now_ns(self) -> int:
        """Now, in ns since the epoch as it was counted when we began; deaf to a step even before `look` sees it."""
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME) + self._ahead_ns + self.correction_ns

    def seconds_until(self, t_ns: int) -> float:
        """Real seconds until t_ns, 0 if it has passed."""
        return max(0, t_ns - self.now_ns()) * 1e-9

    def boot_ns(self, t_ns: int) -> int:
        """The same moment on CLOCK_BOOTTIME, for the kernel's timers."""
        return t_ns - self._ahead_ns - self.correction_ns

    def look(self) -> int:
        """The step since the last look in ns, forward positive; 0 if none."""
        ahead_ns = _ahead_ns()
        if ahead_ns is None:
            return 0
        step_ns, self._ahead_ns = ahead_ns - self._ahead_ns, ahead_ns
        if abs(step_ns) < _STEP_NS:
            return 0
        self._before_ns = self.correction_ns
        self.correction_ns -= step_ns
        self._stepped_ns = self.now_ns()
        self.steps += 1
        return step_ns

    def bus_time_ns(self, stamp_ns: int, now_ns: int, /) -> int:
        """The stamp in bus time; soon after a step it may still be one of the clock before."""
        t_ns = stamp_ns + self.correction_ns
        is_mixed = self._stepped_ns is not None and now_ns - self._stepped_ns < _MIXED_NS
        if not is_mixed and -_STEP_NS < now_ns - t_ns < _NEAR_NS:
            return t_ns
        if not self.look() and not is_mixed:
            return t_ns
        # A frame can't come from the future: of the two readings, the later one that does not.
        readings = {stamp_ns + self.correction_ns, stamp_ns + self._before_ns}
        return max((t for t in readings if t <= self.now_ns()), default=min(readings))


def _ahead_ns() -> int | None:
    """How far the wall clock is ahead of the boot clock; None if we were held up at every try."""
    for _ in range(_TRIES):
        before_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        wall_ns = time.time_ns()
        after_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        if after_ns - before_ns < _BRACKET_NS:
            return wall_ns - (before_ns + after_ns) // 2
    return None


class ScaledClock:
    """A recording's time, begun at `start_ns` and running `speed` times as fast as the wall's."""

    def __init__(self, start_ns: int, speed: float) -> None:
        self._start_ns, self._speed = start_ns, speed
        self._origin_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Now, in the recording's ns."""
        return self._start_ns + round((time.monotonic_ns() - self._origin_ns) * self._speed)

    def seconds_until(self, t_ns: int) -> float:
        """Real seconds until the recording's t_ns, 0 if it has passed."""
        return max(0, t_ns - self.now_ns()) * 1e-9 / self._speed

    def look(self) -> int:
        """Nobody sets this clock."""
        return 0

    def bus_time_ns(self, stamp_ns: int, _now_ns: int, /) -> int:
        """The stamp itself."""
        return stamp_ns


class PlayedClock:
    """The time of a bus that a player feeds: no later than the last frame that it has sent.

    A daemon on this clock can't run ahead of a player that the machine holds up.
    """

    def __init__(self, start_ns: int, speed: float) -> None:
        self.sent_ns = start_ns
        self._speed = speed

    def now_ns(self) -> int:
        """The stamp of the last frame sent."""
        return self.sent_ns

    def seconds_until(self, t_ns: int) -> float:
        """Real seconds that the player will need to get to t_ns, 0 if it has."""
        return max(0, t_ns - self.sent_ns) * 1e-9 / self._speed

    def look(self) -> int:
        """Nobody sets this clock."""
        return 0

    def bus_time_ns(self, stamp_ns: int, _now_ns: int, /) -> int:
        """The stamp itself."""
        return stamp_ns
