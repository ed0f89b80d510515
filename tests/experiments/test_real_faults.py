"""One fault in the payloads of a real recording: named beside what is named without it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import real_faults

from dsz_daemon.edge.samples_file import read_samples
from dsz_daemon.runs.diagnose import Beside, diagnose
from tests.real.recordings import NO_OPENDBC

WITHOUT = {"road_grade", "wheel_slip"}


@pytest.mark.real
@pytest.mark.skipif(not real_faults.DATA.is_dir(), reason="the real recordings are not beside the project")
@pytest.mark.parametrize(
    ("fault", "cause", "may"),
    [
        ("accelerometer y the wrong way round", "axis_fault", set[str]()),
        ("steering the wrong way round", "axis_fault", set[str]()),
        # That road may bank by some 0.004 rad: nobody has measured it.
        ("rear left wheel 2 % smaller", "wheel_radius", {"road_bank"}),
        ("accelerometer z drifts by 0.01 m/s2 a second", "bias_drift", set[str]()),
    ],
)
def test_a_fault_in_a_real_recording_is_named(fault: str, cause: str, may: set[str]) -> None:
    causes, shapes, _, _ = real_faults.said(fault)
    assert set(causes) - may == WITHOUT | {cause}
    assert shapes == []


@pytest.mark.real
@pytest.mark.skipif(not real_faults.DATA.is_dir(), reason="the real recordings are not beside the project")
def test_a_reference_of_speed_tells_the_wheels_common_factor(tmp_path: Path) -> None:
    """Of that car's wheels it is 1.0097, by a smoother of GNSS, INS and vision (`data/README.md`)."""
    folder, speed = real_faults.DATA, tmp_path / "speed.csv"
    with (folder / "reference.csv").open() as file, speed.open("w", newline="") as out:
        only = csv.DictWriter(out, ["time_s", "speed_mps"], extrasaction="ignore")
        only.writeheader()
        only.writerows(csv.DictReader(file))
    config = real_faults.CONFIG
    found = diagnose([folder / "recording.log"], config, tmp_path / "out", beside=Beside(reference=speed))
    causes = {cause["effect"]: cause["parameters"] for cause in found["causes"]}
    assert set(causes) == WITHOUT | {"wheel_radius"}
    for value in causes["wheel_radius"].values():
        assert value["value"] == pytest.approx(1.0097, abs=1e-3)


@pytest.mark.real
@pytest.mark.skipif(not real_faults.DATA.is_dir(), reason="the real recordings are not beside the project")
@pytest.mark.parametrize("is_reversed", [False, True])
def test_by_the_cars_own_three_channels_hills_are_named_and_the_reversed_axis(
    tmp_path: Path, is_reversed: bool
) -> None:
    """No pitch gyro feels them: the accelerometer alone, as a function of place. The reference is not read before."""
    config = (real_faults.ROOT / "config" / "cars" / "toyota_rav4_2017.yaml").read_text(encoding="utf-8")
    config = config.replace("../../", f"{real_faults.ROOT}/").replace("dbc: [", f"dbc: [{real_faults.DATA}/../")
    put_right = next(line for line in config.splitlines() if line.strip().startswith("accel_x"))
    if is_reversed:
        config = config.replace(put_right, put_right.replace(", sign: -1", ""))
    (tmp_path / "car.yaml").write_text(config, encoding="utf-8")
    found = diagnose([real_faults.DATA / "recording.log"], tmp_path / "car.yaml", tmp_path / "out")
    causes = {cause["effect"] for cause in found["causes"]}
    assert causes == WITHOUT | ({"axis_fault"} if is_reversed else set())
    with (real_faults.DATA / "reference.csv").open() as file:
        rows = list(csv.DictReader(file))
    time_s, grade = (np.array([float(row[name]) for row in rows]) for name in ("time_s", "grade_up_rad"))
    columns = read_samples(tmp_path / "out" / "fit.parquet")
    told = np.interp(time_s, columns["time_s"], columns["road_grade_up_rad"])
    assert np.corrcoef(told, grade)[0, 1] > 0.9
    assert np.std(told - grade) < np.radians(0.8)


@pytest.mark.real
@pytest.mark.skipif(NO_OPENDBC is not None, reason=NO_OPENDBC or "")
@pytest.mark.skipif(not real_faults.DATA.is_dir(), reason="the real recordings are not beside the project")
def test_rear_wheels_that_spin_at_three_starts_are_said(tmp_path: Path) -> None:
    """From the messages themselves: the rear wheels are 1.5 m/s ahead of the front ones at 38, 50 and 60 s."""
    log = real_faults.DATA.parent / "mustang" / "recording.log"
    found = diagnose([log], real_faults.ROOT / "config" / "cars" / "ford_mustang_s550.yaml", tmp_path / "out")
    assert (found["verdict"], found["causes"]) == ("unexplained", [])
    for wheel in ("wheel_speed_rl", "wheel_speed_rr"):
        mine = [shape for shape in found["unlisted"] if shape["channel"] == wheel]
        starts = [float(shape["shape"].split()[2]) for shape in mine]
        assert starts == [pytest.approx(start_s, abs=1.0) for start_s in (38.0, 50.0, 60.5)]
        assert all(0.15 < shape["coefficient"]["value"] < 0.4 for shape in mine)
    assert len(found["unlisted"]) == 6
