"""One fault in the payloads of a real recording: named beside what is named without it."""

from __future__ import annotations

import pytest
import real_faults

WITHOUT = {"road_grade", "wheel_slip"}


@pytest.mark.real
@pytest.mark.skipif(not real_faults.DATA.is_dir(), reason="the real recordings are not beside the project")
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("accelerometer y the wrong way round", "axis_fault"),
        ("rear left wheel 2 % smaller", "wheel_radius"),
        ("accelerometer z drifts by 0.01 m/s2 a second", "bias_drift"),
    ],
)
def test_a_fault_in_a_real_recording_is_named(fault: str, cause: str) -> None:
    causes, shapes, _, _ = real_faults.said(fault)
    # That road may bank by some 0.004 rad: nobody has measured it.
    assert set(causes) - {"road_bank"} == WITHOUT | {cause}
    assert shapes == []
