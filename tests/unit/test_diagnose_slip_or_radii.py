"""What of slipping wheels radii might be as well: the front wheels' share at a steady speed, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core_cases import TUCSON

from dsz_daemon.diagnose.recordings.recording import DT_S, Recording
from dsz_daemon.diagnose.residuals.comparison import rows_of
from dsz_daemon.diagnose.residuals.drives import drive_of
from dsz_daemon.diagnose.simulation.drive import Drive
from dsz_daemon.diagnose.verdict.aliases import same_as_slip
from dsz_daemon.diagnose.verdict.answer import _names_slip_alone

N = 9000
T = DT_S * np.arange(N)
V = 15.0 + 4.0 * np.sin(0.3 * T) + 1.5 * np.sin(0.07 * T)
PULL = np.gradient(V, DT_S)


def drive(front: np.ndarray, steer: np.ndarray | None = None, noise_mps: float = 5e-3) -> Drive:
    """Front wheels that turn faster by a share (n,), of a car that goes straight ahead if nothing else is said."""
    steer = np.zeros(N) if steer is None else steer
    wheels = np.column_stack([V * (1.0 + front) / np.cos(steer)] * 2 + [V] * 2)
    wheels += noise_mps * np.random.default_rng(3).normal(size=wheels.shape)
    return drive_of(Recording(T, steer, wheels, np.zeros((N, 6)), np.full(10, 1e-3)), TUCSON, 16.0)


def said(one: Drive) -> Any:
    return same_as_slip(one, rows_of(one))


def test_what_is_there_at_a_steady_speed_is_told_apart_from_drive_and_brakes() -> None:
    """0.22 % all the way, and a slip that is twice as steep when driven as when braked."""
    front = 0.0022 + np.where(PULL > 0.0, 0.004, 0.002) * PULL
    (one,) = said(drive(front))
    assert one.when_steady == pytest.approx(0.0022, abs=3.0 * one.std + 2e-5)
    assert one.std < 1e-4
    moving = slice(100, -100)
    assert one.front_over_rear == pytest.approx(float(np.mean(front[moving])), abs=5e-5)
    assert one.effect == "wheel_radius"
    told = f"The front wheels turn {one.front_over_rear:.2%} faster than the rear ones, {one.when_steady:.2%} where"
    assert one.statement.startswith(told)


def test_rear_wheels_may_be_the_faster_ones() -> None:
    (one,) = said(drive(np.full(N, -0.003)))
    assert one.when_steady == pytest.approx(-0.003, abs=2e-5)
    assert "The rear wheels turn 0.30% faster than the front ones, 0.30% where" in one.statement


def test_slip_that_goes_with_drive_and_brakes_alone_is_no_radius() -> None:
    assert said(drive(0.004 * PULL)) == []


def test_front_wheels_go_further_round_in_a_bend() -> None:
    assert said(drive(np.zeros(N), np.full(N, 0.08))) == []


def test_less_than_a_radius_has_a_name_for_is_not_told() -> None:
    assert said(drive(np.full(N, 0.0007))) == []
    assert said(drive(np.full(N, 0.0009)))


def test_what_wanders_from_block_to_block_is_told_by_no_more_than_it_wanders() -> None:
    assert said(drive(0.0012 + 0.01 * np.sin(0.21 * T))) == []


@pytest.mark.parametrize(
    ("effects", "told"),
    [(["wheel_slip"], True), (["wheel_slip", "wheel_radius"], False), (["road_grade"], False), ([], False)],
)
def test_it_is_told_beside_slip_that_is_named_alone(effects: list[str], told: bool) -> None:
    causes: Any = [SimpleNamespace(effect=effect) for effect in effects]
    assert _names_slip_alone(causes) is told


def test_of_dead_wheels_nothing_is_told() -> None:
    one = drive(np.full(N, 0.003))
    one.wheels[:, 2:] = 0.0
    assert said(one) == []
