"""Where time comes from, as an object that is handed in: the wall clock, or a scaled one for replay."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock on the bus's time: integer nanoseconds since the epoch."""

    def now_ns(self) -> int:
        """Now."""
        ...

    def seconds_until(self, t_ns: int) -> float:
        """How long (real seconds, never negative) until t_ns."""
        ...


class WallClock:
    """The machine's own clock: what python-can stamps frames with."""

    def now_ns(self) -> int:
        """Now, in ns since the epoch."""
        return time.time_ns()

    def seconds_until(self, t_ns: int) -> float:
        """Real seconds until t_ns, 0 if it has passed."""
        return max(0, t_ns - time.time_ns()) * 1e-9


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
