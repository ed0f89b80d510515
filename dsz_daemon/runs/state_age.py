"""How old a saved state is: clocks of cars are set late, stand still while the car is parked, or lie."""

from __future__ import annotations

from typing import Any

from dsz_daemon.edge.boot import Boot

# Before this nobody can have saved one: a clock that was never set.
_EARLIEST_NS = 1_577_836_800_000_000_000  # 2020-01-01
# Where nothing is known: by then the spread of every channel is the data sheet's.
UNKNOWN_AGE_S = 30 * 86400.0
# Machines without a battery-backed clock take up the time where they were switched off, so that the
# night seems to have lasted seconds. A true restart of the machine within two minutes is rare, and
# costs no more than learning the spread again.
_SHORTEST_OFF_NS = 120_000_000_000
# Two clocks that both ran on, of which one was slewed or was read a moment later.
_SAME_RUN_NS = 2_000_000_000


def age(body: dict[str, Any], now_ns: int, boot: Boot) -> tuple[float, str]:
    """Age (s) of a saved state and, where it can't be known, why it is taken for `UNKNOWN_AGE_S`.

    Within one run of the machine its own steady clock counts, whatever was done to the time of day.
    """
    saved_ns, then = _whole(body.get("saved_ns")), _boot(body.get("boot"))
    if saved_ns is None or then is None:
        return UNKNOWN_AGE_S, _unknown("its time makes no sense")
    since_ns = boot.elapsed_ns - then.elapsed_ns
    if since_ns >= 0 and _same_run(then, boot, since_ns, now_ns - saved_ns):
        return since_ns * 1e-9, ""
    if saved_ns < _EARLIEST_NS or now_ns < _EARLIEST_NS:
        return UNKNOWN_AGE_S, _unknown("the clock was not set")
    if saved_ns > now_ns:
        return UNKNOWN_AGE_S, _unknown(f"it was saved {age_in_words((saved_ns - now_ns) * 1e-9)} ahead of now")
    if now_ns - boot.elapsed_ns - saved_ns < _SHORTEST_OFF_NS:
        return UNKNOWN_AGE_S, _unknown("the clock seems to have stood still while the machine was off")
    return (now_ns - saved_ns) * 1e-9, ""


def _same_run(then: Boot, now: Boot, since_ns: int, by_clock_ns: int) -> bool:
    if then.id and now.id:
        return then.id == now.id
    return abs(by_clock_ns - since_ns) <= _SAME_RUN_NS


def _unknown(why: str) -> str:
    return f"the saved state's age is unknown ({why}): taken for {age_in_words(UNKNOWN_AGE_S)}"


def _boot(value: Any) -> Boot | None:
    if not isinstance(value, dict) or not isinstance(value.get("id"), str):
        return None
    elapsed_ns = _whole(value.get("elapsed_ns"))
    return None if elapsed_ns is None else Boot(value["id"], elapsed_ns)


def _whole(value: Any) -> int | None:
    """A whole number of ns as clocks have them (64 bits), else None."""
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 63 else None


def age_in_words(seconds: float) -> str:
    """Seconds, minutes, hours or days.

    >>> age_in_words(11520.0)
    '3.2 h'
    """
    for length_s, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * length_s:
            return f"{seconds / length_s:.3g} {unit}"
    return f"{seconds:.3g} s"
