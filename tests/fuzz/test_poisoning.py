"""The measurement of poisoned offsets: it sees an attack, and an attack moves a known offset little."""

from __future__ import annotations

import math

import poisoning
import pytest
from poisoning import ATTACKS, CONFIG, measured

from dsz_daemon.runs.setup import set_up

DEG = math.pi / 180.0
pytestmark = pytest.mark.long


def test_a_minute_of_honest_driving_withstands_ten_seconds_of_five_degrees() -> None:
    attack = ATTACKS[0]
    assert attack.channel == "gyro_z"
    nothing = poisoning.Attack("gyro_z", "nothing at all", lambda _t, values: values)
    attacked, honest = measured(set_up(CONFIG), 60.0, 10.0, (attack, nothing))
    # Seen: more than what moves by itself. Withstood: less than a fifth of what was put on.
    assert attacked.total > 5.0 * honest.total
    assert honest.total < 0.05 * DEG
    assert attacked.total < 1.0 * DEG
    assert poisoning.table([attacked], 60.0, 10.0).endswith(f"| {attacked.total / DEG:.3f} |")
