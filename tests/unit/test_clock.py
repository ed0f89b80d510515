"""Bus time when somebody sets the machine's clock, on a machine whose clocks the test holds in its hand."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from dsz_daemon.edge import clock as clock_room
from dsz_daemon.edge.clock import WallClock

EPOCH_NS = 1_760_000_000_000_000_000
S = 1_000_000_000


@dataclass
class Machine:
    """Its boot clock and how far its wall clock is ahead; `held_up_ns` passes between any two readings."""

    boot_ns: int = 50 * S
    ahead_ns: int = EPOCH_NS
    held_up_ns: int = 0

    CLOCK_BOOTTIME = 7

    def clock_gettime_ns(self, _which: int) -> int:
        self.boot_ns += self.held_up_ns
        return self.boot_ns

    def time_ns(self) -> int:
        self.boot_ns += self.held_up_ns
        return self.boot_ns + self.ahead_ns


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    made = Machine()
    monkeypatch.setattr(clock_room, "time", made)
    return made


@pytest.mark.parametrize("step_ns", [3600 * S, -3600 * S, 20_000_000, -20_000_000])
def test_bus_time_goes_on_when_the_clock_is_set(machine: Machine, step_ns: int) -> None:
    clock = WallClock()
    before_ns = clock.now_ns()
    machine.boot_ns += S
    machine.ahead_ns += step_ns
    assert clock.look() == step_ns
    assert clock.now_ns() - before_ns == S
    assert clock.look() == 0
    assert clock.steps == 1
    assert clock.seconds_until(before_ns + 3 * S) == 2.0


@pytest.mark.parametrize("step_ns", [3600 * S, -3600 * S])
@pytest.mark.parametrize("looked", [True, False])
def test_stamps_from_before_and_after_the_step_stand_where_they_were_taken(
    machine: Machine, step_ns: int, looked: bool
) -> None:
    clock = WallClock()
    start_ns = clock.now_ns()
    old_stamp_ns = machine.time_ns()
    machine.boot_ns += 30_000_000
    machine.ahead_ns += step_ns
    new_stamp_ns = machine.time_ns()
    machine.boot_ns += 1_000_000
    if looked:
        clock.look()
    # A frame of the new time may be read before anybody has looked whether the clock was set.
    assert clock.bus_time_ns(new_stamp_ns, clock.now_ns()) == start_ns + 30_000_000
    assert clock.bus_time_ns(old_stamp_ns, clock.now_ns()) == start_ns
    machine.boot_ns += 10 * S
    assert clock.bus_time_ns(machine.time_ns(), clock.now_ns()) == start_ns + 10 * S + 31_000_000


def test_slewing_is_followed_and_is_no_step(machine: Machine) -> None:
    clock = WallClock()
    for _ in range(1000):
        machine.boot_ns += 10_000_000
        machine.ahead_ns += 5_000
        assert clock.look() == 0
    assert clock.now_ns() == machine.time_ns()


def test_being_held_up_between_two_readings_is_no_step(machine: Machine) -> None:
    clock = WallClock()
    machine.held_up_ns = 400_000_000
    assert clock.look() == 0
    machine.held_up_ns = 0
    assert clock.look() == 0
    assert clock.steps == 0
