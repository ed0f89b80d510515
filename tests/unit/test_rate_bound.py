"""The rate bound: by hand, and against a bucket of tokens kept in exact fractions."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsz_daemon.pipeline.decode_counters import Sender
from dsz_daemon.pipeline.rate_bound import RateBound

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000


def admitted(bound: RateBound, stamps: list[int]) -> list[bool]:
    sender = Sender()
    return [bound.admits(sender, t_ns) for t_ns in stamps]


def test_settings_in_hz_and_seconds() -> None:
    assert RateBound.of(2000.0, 0.5, 1.0) == RateBound(500_000, 500_000_000, 1_000_000_000)


def test_exactly_the_limit_passes_for_ever() -> None:
    assert all(admitted(RateBound.of(100.0, 0.0, 1.0), [START_NS + n * 10 * MS for n in range(1000)]))


def test_without_a_burst_every_frame_that_comes_too_early_is_refused() -> None:
    stamps = [START_NS + n * 5 * MS for n in range(100)]
    assert admitted(RateBound.of(100.0, 0.0, 1.0), stamps) == [True, False] * 50


def test_a_burst_at_once() -> None:
    """0.5 s at 2 kHz: 1000 frames, and the one that was due."""
    found = admitted(RateBound.of(2000.0, 0.5, 1.0), [START_NS] * 3000)
    assert found == [True] * 1001 + [False] * 1999


def test_a_hundredfold_rate_is_cut_to_the_bound() -> None:
    """10 kHz for 10 s: 2 kHz of it, and the burst once."""
    stamps = [START_NS + n * 100_000 for n in range(100_000)]
    assert sum(admitted(RateBound.of(2000.0, 0.5, 1.0), stamps)) == pytest.approx(20_000 + 1001, abs=2)


@pytest.mark.parametrize("step_s", [-3600.0, -2.0, 3600.0])
def test_a_step_of_the_clock_starts_anew(step_s: float) -> None:
    """Also one stamp far ahead: it must not silence what comes after it."""
    bound, sender = RateBound.of(1000.0, 0.1, 1.0), Sender()
    assert all(bound.admits(sender, START_NS + n * MS) for n in range(100))
    assert bound.admits(sender, START_NS + round(step_s * 1e9))
    assert all(bound.admits(sender, START_NS + n * 10 * MS) for n in range(10, 100))


def test_a_little_disorder_is_no_step() -> None:
    """Frames stamped 20 ms early and late in turn, at a fifth of the bound."""
    stamps = [START_NS + n * 5 * MS + (20 * MS if n % 2 else 0) for n in range(1000)]
    assert all(admitted(RateBound.of(1000.0, 0.1, 1.0), stamps))


@given(
    gaps=st.lists(st.sampled_from([0, 0, 1, 100, 999, 1000, 1001, 5000, 100_000]), max_size=200),
    period=st.integers(1, 3000),
    burst=st.integers(0, 20_000),
)
def test_it_is_a_token_bucket(gaps: list[int], period: int, burst: int) -> None:
    """Tokens: burst / period + 1 at most, one more every period, one taken by each frame that is let in."""
    bound, sender = RateBound(period, burst, 10**9), Sender()
    most = Fraction(burst, period) + 1
    tokens, t_ns = most, START_NS
    for gap in gaps:
        t_ns += gap
        tokens = min(most, tokens + Fraction(gap, period))
        expected = tokens >= 1
        tokens -= expected
        assert bound.admits(sender, t_ns) == expected
