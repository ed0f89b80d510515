"""How often one id may come: a token bucket in bus time, one for each message and channel.

A babbling sender (a broken node, or a wicked one) can fill a bus with a wanted id. Beyond the bound its
frames are refused before anything is decoded, so that they cost next to nothing. What the bound can't
do is tell a false sender from the true one: within it, false frames pass, and what they can do is
bounded by the values' range, by the largest jump and by how slowly offsets are learnt.
"""

from __future__ import annotations

from typing import NamedTuple

from dsz_daemon.pipeline.decode_counters import Sender


class RateBound(NamedTuple):
    """One frame per `period_ns` in the long run, and as many at once as would come in `burst_ns`.

    Kept as the one time `due_ns` at which the next frame would be on schedule (the generic cell rate
    algorithm of ITU-T I.371, equal to a bucket of burst_ns / period_ns + 1 tokens): integers, so that
    nothing is rounded. A stamp too early by more than all of this and `clock_step_ns` is a step of the
    clock and starts anew.
    """

    period_ns: int
    burst_ns: int
    clock_step_ns: int

    @classmethod
    def of(cls, limit_hz: float, burst_s: float, clock_step_s: float) -> RateBound:
        """A bound from settings in Hz and s."""
        return cls(round(1e9 / limit_hz), round(burst_s * 1e9), round(clock_step_s * 1e9))

    def admits(self, sender: Sender, t_ns: int) -> bool:
        """Whether a frame stamped t_ns is within the bound; if it is, `sender` is charged for it."""
        period_ns, burst_ns, clock_step_ns = self
        due_ns = sender.due_ns
        if due_ns is None or due_ns <= t_ns:
            sender.due_ns = t_ns + period_ns
            return True
        early_ns = due_ns - t_ns
        if early_ns <= burst_ns:
            sender.due_ns = due_ns + period_ns
            return True
        if early_ns > burst_ns + period_ns + clock_step_ns:
            sender.due_ns = t_ns + period_ns
            return True
        return False
