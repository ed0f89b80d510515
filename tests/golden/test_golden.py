"""The estimator still makes of the fixed log what it made when somebody last looked."""

from __future__ import annotations

import json

import pytest

from tests.golden.golden import ABSOLUTE, EXPECTED, RELATIVE, observed


def test_the_golden_replay_has_not_moved() -> None:
    expected, now = json.loads(EXPECTED.read_text(encoding="utf-8")), observed()
    assert len(now) == len(expected)
    for before, after in zip(expected, now, strict=True):
        assert after.keys() == before.keys()
        for key, value in before.items():
            numbers = value[:2] if isinstance(value, list) else [value]
            found = after[key][:2] if isinstance(value, list) else [after[key]]
            assert found == pytest.approx(numbers, rel=RELATIVE, abs=ABSOLUTE), f"{key} at {before['second']} s"
            if isinstance(value, list):
                assert after[key][2] == value[2], f"{key} at {before['second']} s"
