"""Wheel speeds from pole counting, against edges counted by hand and motion in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from dsz_daemon.sim.wheel_sensors import counted_speed_mps, edge_times_s, pitch_m, wheel_speed_counts

PITCH_M = 0.04
AT_S = np.arange(0.02, 3.0, 0.02)


def times(duration_s: float = 3.0) -> NDArray[np.float64]:
    return np.arange(round(duration_s / 0.002) + 1) * 0.002


def test_wheel_speeds_come_in_quanta() -> None:
    # 10 m/s = 36 km/h = 1152 quanta; below 1 km/h nothing; direction is not seen.
    assert wheel_speed_counts(np.array([10.0, 0.27, 0.28, -10.0])).tolist() == [1152, 0, 32, 1152]
    # A wheel that spins on ice: 14 bits are full at 512 km/h.
    assert wheel_speed_counts(np.array([142.0, 143.0, -1e6])).tolist() == [16358, 16383, 16383]


def test_pitch_is_the_rims_way_over_the_poles() -> None:
    assert pitch_m(0.337, 48) == pytest.approx(2.0 * 3.14159265 * 0.337 / 48.0)


def test_edges_at_steady_speed_are_a_pitch_apart() -> None:
    t = times()
    edges = edge_times_s(t, np.full(len(t), 10.0), PITCH_M, 0.25)
    # The first after three quarters of a pitch, 30 mm; 30 m make 750 of them.
    assert edges[:3] == pytest.approx([0.003, 0.007, 0.011])
    assert len(edges) == 750


def test_edges_of_a_start_from_rest_follow_the_square_of_time() -> None:
    t = times()
    edges = edge_times_s(t, 2.0 * t, PITCH_M, 0.5)
    # s = t^2: edge k at sqrt((k + 1/2) pitch).
    way = (np.arange(len(edges)) + 0.5) * PITCH_M
    assert edges == pytest.approx(np.sqrt(way), abs=1e-5)
    assert len(edges) == math.floor(9.0 / PITCH_M + 0.5)


def test_an_edge_passed_forward_is_passed_again_backward() -> None:
    t = times()
    # 0.1 m ahead and back: a cosine's way; starts mid-pitch, edges at 0.02, 0.06 m and (never) 0.10.
    way = 0.045 * (1.0 - np.cos(2.0 * math.pi * t / 3.0))
    speed = 0.045 * 2.0 * math.pi / 3.0 * np.sin(2.0 * math.pi * t / 3.0)
    edges = edge_times_s(t, speed, PITCH_M, 0.5)
    assert len(edges) == 4
    assert np.interp(edges, t, way) == pytest.approx([0.02, 0.06, 0.06, 0.02], abs=1e-5)
    # From rest into reverse: the edge behind comes after a quarter of a pitch.
    back = edge_times_s(t, np.full(len(t), -1.0), PITCH_M, 0.25)
    assert back[:2] == pytest.approx([0.01, 0.05])
    assert edge_times_s(t, np.zeros(len(t)), PITCH_M, 0.5).size == 0


def test_several_edges_in_one_step_are_all_there() -> None:
    edges = edge_times_s(np.array([0.0, 1.0, 2.0]), np.array([0.1, 0.1, -0.1]), PITCH_M, 0.5)
    assert edges[:2] == pytest.approx([0.2, 0.6])
    edges = edge_times_s(np.array([0.0, 1.0]), np.array([-0.1, -0.1]), PITCH_M, 0.5)
    assert edges == pytest.approx([0.2, 0.6])


def test_speed_is_the_way_of_the_counted_edges_over_their_time() -> None:
    # By hand: edges at 3, 12, 21.5, 29, 38, 52 ms; messages every 20 ms.
    edges = np.array([0.003, 0.012, 0.0215, 0.029, 0.038, 0.052])
    speed = counted_speed_mps(edges, 0.04, np.array([0.0, 0.02, 0.04, 0.06, 0.08]))
    # No edge yet; then one pitch in 9 ms (nothing before), three in 26, one in 14; then none,
    # and 28 ms without one can't bound it below 0.04 / 0.014.
    assert speed[:4] == pytest.approx([0.0, 0.04 / 0.009, 0.12 / 0.026, 0.04 / 0.014])
    assert speed[4] == pytest.approx(0.04 / 0.028)


def test_without_edges_the_last_speed_holds_until_time_bounds_it() -> None:
    edges = np.array([0.010, 0.050])
    at_s = np.array([0.02, 0.06, 0.08, 0.10, 0.14, 0.25])
    # One edge is no speed; then 0.04 / 0.04 = 1 m/s, held while the next edge may still come
    # in time (until 0.09), then no more than 0.04 / time since.
    assert counted_speed_mps(edges, 0.04, at_s) == pytest.approx([0.0, 1.0, 1.0, 0.8, 0.04 / 0.09, 0.2])


def test_after_a_standstill_two_edges_are_needed() -> None:
    edges = np.array([0.010, 0.050, 5.010, 5.050, 5.060])
    at_s = np.array([0.06, 5.02, 5.04, 5.06, 5.08])
    speed = counted_speed_mps(edges, 0.04, at_s)
    # 5.01 alone begins anew; 5.05 and 5.06 come within one message: 2 pitches in 50 ms.
    assert speed[:4] == pytest.approx([1.0, 0.0, 0.0, 0.08 / 0.05])
    assert counted_speed_mps(np.array([]), 0.04, at_s).tolist() == [0.0] * 5


@pytest.mark.parametrize("speed_mps", [0.4, 2.0, 10.0, 30.0])
def test_steady_speed_is_right_within_a_tick_of_the_timer(speed_mps: float) -> None:
    t = times()
    counted = counted_speed_mps(edge_times_s(t, np.full(len(t), speed_mps), PITCH_M, 0.3), PITCH_M, AT_S)
    settled = counted[AT_S > 0.3]
    # One tick of 1 us on the shortest time that is measured over.
    shortest_s = max(PITCH_M / speed_mps, 0.02 - PITCH_M / speed_mps)
    assert np.abs(settled / speed_mps - 1.0).max() < 1.1e-6 / shortest_s
    backward = edge_times_s(t, np.full(len(t), -speed_mps), PITCH_M, 0.7)
    assert counted_speed_mps(backward, PITCH_M, AT_S)[-1] == pytest.approx(speed_mps, rel=1e-4)


def test_speeding_up_reads_late_by_half_of_what_is_measured_over() -> None:
    t = times()
    counted = counted_speed_mps(edge_times_s(t, 3.0 + 4.0 * t, PITCH_M, 0.5), PITCH_M, AT_S)
    fast = AT_S > 1.5
    late_s = AT_S[fast] - (counted[fast] - 3.0) / 4.0
    # Half of 20 ms and, on average, half a pitch of waiting for the last edge.
    assert late_s.mean() == pytest.approx(0.01 + 0.5 * PITCH_M / 12.0, abs=5e-4)
    assert late_s.min() > 0.007
    assert late_s.max() < 0.02


def test_below_a_walking_pace_it_is_silent() -> None:
    t = times()
    slow = counted_speed_mps(edge_times_s(t, np.full(len(t), 0.2), PITCH_M, 0.5), PITCH_M, AT_S)
    assert not wheel_speed_counts(slow).any()
    # Stopping: the last edge's speed dies away instead of standing for ever.
    stopping = np.maximum(2.0 - 2.0 * t, 0.0)
    counts = wheel_speed_counts(counted_speed_mps(edge_times_s(t, stopping, PITCH_M, 0.5), PITCH_M, AT_S))
    assert counts[(AT_S > 0.03) & (AT_S < 0.8)].min() > 0
    assert not counts[AT_S > 1.2].any()


def test_edges_off_their_places_come_as_much_sooner_or_later() -> None:
    """Four edges, one of them a tenth of a pitch ahead on the ring: it comes a tenth of a pitch later, every turn."""
    t = np.arange(0.0, 1.0, 0.002)
    speed = np.full(len(t), 10.0)
    even = edge_times_s(t, speed, PITCH_M, 0.5)
    off = edge_times_s(t, speed, PITCH_M, 0.5, (0.0, 0.1, 0.0, 0.0))
    late = (off - even) * 10.0 / PITCH_M
    assert late[:8] == pytest.approx([0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0], abs=1e-9)
    # And so a steady speed is read with a ripple that comes again with each turn.
    at = np.arange(0.1, 1.0, 0.02)
    assert np.ptp(counted_speed_mps(even, PITCH_M, at)) < 0.02
    assert np.ptp(counted_speed_mps(off, PITCH_M, at)) > 0.05
    assert counted_speed_mps(off, PITCH_M, at).mean() == pytest.approx(10.0, rel=2e-3)
