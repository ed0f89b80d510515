"""The paper's claims on one drawn IMU: those that hold must go on to, and the one that can't is seen not to."""

from __future__ import annotations

import pytest
from claims import Claim, claims


@pytest.fixture(scope="module")
def found() -> list[Claim]:
    return list(claims(1))


def named(found: list[Claim], figure: str, start: str) -> Claim:
    (claim,) = (claim for claim in found if claim.figure == figure and claim.text.startswith(start))
    return claim


@pytest.mark.parametrize("channel", ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"])
def test_offsets_are_removed_on_the_flat(found: list[Claim], channel: str) -> None:
    assert named(found, "2, 5", channel).held == [True]


def test_lateral_zeroing_waits_for_its_gate(found: list[Claim]) -> None:
    assert named(found, "3", "a_y").held == [True]
    assert named(found, "8", "a_y").held == [True]


@pytest.mark.parametrize("channel", ["accel_x", "accel_y", "accel_z"])
def test_references_are_not_believed_in_the_manoeuvre(found: list[Claim], channel: str) -> None:
    assert named(found, "4", f"{channel}: and is not learnt").held == [True]


def test_a_hill_moves_the_longitudinal_offset_and_the_spread_says_so(found: list[Claim]) -> None:
    """Nothing in (1), (4), (21) tells a grade from an offset: whoever claims otherwise has not measured."""
    claim = named(found, "9", "accel_x")
    assert claim.held == [False]
    ((_, off, says),) = claim.values
    assert abs(off) < says
