# ruff: noqa: RUF001  the page writes sigma as people do
"""The one sentence at the top of the page."""

from __future__ import annotations

import pytest

from dsz_daemon.report.results import ChannelResult, channel_result
from dsz_daemon.report.verdict import verdict


def result(channel: str, state: str, **more: object) -> ChannelResult:
    base = channel_result(
        channel, {}, {"channels": {channel: {"state": state, "offset": 0.5, "offset_std": 0.1}}}, None
    )
    return base._replace(**more)


@pytest.mark.parametrize(
    ("results", "sentence"),
    [
        ([], "No IMU channel is mapped, so there was nothing to zero."),
        (
            [
                result("gyro_x", "converged", converged_after_s=8.0),
                result("gyro_z", "converged", converged_after_s=61.3),
            ],
            "All 2 channels converged within 61.3 s.",
        ),
        ([result("gyro_z", "converged")], "The one mapped channel converged."),
        (
            [
                result("gyro_z", "converged"),
                result("accel_x", "holding", closed_share={"turning": 0.5, "stale": 0.1}),
                result("accel_y", "holding", closed_share={"turning": 0.4}),
                result("accel_z", "learning", closed_share={"turning": 0.4}),
            ],
            "1 of 4 channels converged; accel_x and accel_y hold their offsets (mostly turning); "
            "accel_z is still learning.",
        ),
        ([result("gyro_z", "invalid")], "None of 1 channel converged; gyro_z is invalid at the end."),
        (
            [result("gyro_x", "converged", true_offset=0.61), result("gyro_z", "converged", true_offset=0.25)],
            "All 2 channels converged; outside its 95 % spread of the truth: gyro_z (+2.5σ).",
        ),
        (
            [result("gyro_x", "converged", true_offset=0.61), result("gyro_z", "converged", true_offset=0.5)],
            "All 2 channels converged; every offset is within its 95 % spread of the truth.",
        ),
    ],
)
def test_the_verdict(results: list[ChannelResult], sentence: str) -> None:
    assert verdict(results, 100, 0) == sentence


def test_the_verdict_points_to_warnings() -> None:
    assert verdict([result("gyro_z", "converged")], 9, 2).endswith("; 2 warnings below.")
    assert verdict([result("gyro_z", "converged")], 9, 1).endswith("; 1 warning below.")
