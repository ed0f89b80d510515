"""One fault in the payloads of a real recording: named beside what is named without it."""

from __future__ import annotations

import pytest
import real_faults

WITHOUT = {"road_grade", "wheel_slip"}


@pytest.mark.real
@pytest.mark.skipif(not real_faults.DATA.is_dir(), reason="the real recordings are not beside the project")
@pytest.mark.parametrize(
    ("fault", "cause", "may"),
    [
        ("accelerometer y the wrong way round", "axis_fault", set[str]()),
        # That road may bank by some 0.004 rad: nobody has measured it.
        ("rear left wheel 2 % smaller", "wheel_radius", {"road_bank"}),
        ("accelerometer z drifts by 0.01 m/s2 a second", "bias_drift", set[str]()),
    ],
)
def test_a_fault_in_a_real_recording_is_named(fault: str, cause: str, may: set[str]) -> None:
    causes, shapes, _, _ = real_faults.said(fault)
    assert set(causes) - may == WITHOUT | {cause}
    assert shapes == []
