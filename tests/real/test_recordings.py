"""Real cars: the RAV4, the Fusion and the Mustang beside the project, against independent references."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.real.recordings import ABSENT, CARS, DATA, FUSION_LOGS, NO_OPENDBC, ROOT, rav4_offsets, replayed

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(ABSENT is not None, reason=ABSENT or ""),
]
needs_opendbc = pytest.mark.skipif(NO_OPENDBC is not None, reason=NO_OPENDBC or "")
DEG = math.pi / 180.0


def offset_degps(summary: dict[str, Any], name: str) -> tuple[float, float]:
    row = summary["channels"][name]
    return row["offset"] / DEG, row["offset_std"] / DEG


@needs_opendbc
def test_rav4_own_sensors(tmp_path: Path) -> None:
    log = DATA / "rav4_highway" / "recording.log"
    summary, samples = replayed([log], CARS / "toyota_rav4_2017.yaml", tmp_path)
    offset, std = offset_degps(summary, "gyro_z")
    # -0.41 deg/s: YAW_RATE against the GNSS course rate, measured when the recording was chosen.
    assert offset == pytest.approx(-0.41, abs=0.10)
    assert abs(offset + 0.41) < 1.96 * std
    reference = rav4_offsets(samples)
    assert reference["gyro_z"] / DEG == pytest.approx(-0.41, abs=0.02)
    for name in ("accel_x", "accel_y"):
        # The reference knows the grade and not the bank; the spread must cover what we can't know.
        row = summary["channels"][name]
        assert abs(row["offset"] - reference[name]) < 1.96 * row["offset_std"]
        assert row["offset_std"] < 0.3
    assert "gyro_x_radps" not in samples
    assert not summary["warnings"]


def test_rav4_phone_imu_in_its_own_axes(tmp_path: Path) -> None:
    log = DATA / "rav4_highway" / "recording.log"
    summary, samples = replayed([log], ROOT / "tests" / "real" / "rav4_phone.yaml", tmp_path)
    # Forward, right, down, as the phone recorded its own bias; the configuration turns right and down over.
    for name, own, sign in (("gyro_x", -0.56, 1.0), ("gyro_y", -2.01, -1.0), ("gyro_z", 3.92, -1.0)):
        offset, std = offset_degps(summary, name)
        assert sign * offset == pytest.approx(own, abs=0.15), name
        assert abs(sign * offset - own) < 1.96 * std, name
    reference = rav4_offsets(samples)
    for name in ("accel_x", "accel_y"):
        row = summary["channels"][name]
        assert abs(row["offset"] - reference[name]) < 1.96 * row["offset_std"], name


@needs_opendbc
def test_rav4_reversed_accelerometer_is_said(tmp_path: Path) -> None:
    """The DBC's own sign of ACCEL_X is wrong; mapped without `sign: -1`, that must be noticed."""
    text = (CARS / "toyota_rav4_2017.yaml").read_text(encoding="utf-8")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace("signal: ACCEL_X, unit: m/s^2, sign: -1", "signal: ACCEL_X, unit: m/s^2"))
    assert wrong.read_text(encoding="utf-8") != text
    summary, _ = replayed([DATA / "rav4_highway" / "recording.log"], wrong, tmp_path / "out")
    assert any(word.startswith("accel_x runs against the wheels'") for word in summary["warnings"])


@needs_opendbc
@pytest.mark.parametrize("name", FUSION_LOGS)
def test_fusion_runs_and_compares_with_the_maker(name: str, tmp_path: Path) -> None:
    summary, _ = replayed([DATA / "fusion" / f"{name}.log"], CARS / "ford_fusion_2017.yaml", tmp_path)
    assert summary["rows"] > 390
    for channel in ("gyro_z", "accel_x", "accel_y"):
        other = summary["channels"][channel]["reference"]
        assert other["rows"] > 100
        # Raw minus maker, as measured when the logs were chosen: 0.02-0.35 deg/s, 0.05-0.29 m/s^2.
        raw = abs(other["raw_mean"] - other["reference_mean"])
        assert raw < (0.40 * DEG if channel == "gyro_z" else 0.32)
        # Seconds of driving can't teach much; what is claimed must cover the maker's own opinion.
        row = summary["channels"][channel]
        assert abs(other["compensated_mean"] - other["reference_mean"]) < 1.96 * row["offset_std"] + raw


@needs_opendbc
def test_fusion_at_standstill_has_no_yaw_rate(tmp_path: Path) -> None:
    summary, samples = replayed([DATA / "fusion" / "nothing.log"], CARS / "ford_fusion_2017.yaml", tmp_path)
    assert float(np.nanmax(samples["speed_mps"])) < 0.01
    after_a_second = samples["time_s"] > samples["time_s"][0] + 1.5
    assert abs(float(np.nanmean(samples["gyro_z_radps"][after_a_second]))) / DEG < 0.05
    assert summary["channels"]["gyro_z"]["state"] == "converged"


@needs_opendbc
def test_mustang_runs_through_and_says_what_is_missing(tmp_path: Path) -> None:
    summary, samples = replayed([DATA / "mustang" / "recording.log"], CARS / "ford_mustang_s550.yaml", tmp_path)
    assert summary["duration_s"] > 69.0
    assert any("no gyro_z" in note for note in summary["notes"])
    assert any("frames" in word and "missing from its cycle" in word for word in summary["warnings"])
    assert summary["counts"]["lost_on_the_way"] > 100
    assert "gyro_z_radps" not in samples
    assert np.nanmax(samples["speed_mps"]) > 5.0
    # The rear wheels spin (to 4.6 m/s): the reference speed must not follow them.
    spin = samples["wheel_speed_rl_mps"] - samples["wheel_speed_fl_mps"]
    worst = int(np.nanargmax(spin))
    assert spin[worst] > 2.0
    assert samples["speed_mps"][worst] - samples["wheel_speed_fl_mps"][worst] < 0.5 * spin[worst]
