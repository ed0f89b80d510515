"""`samples.parquet`: its columns, what survives an interrupt, what is said when it can't be."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from dsz_daemon.core.outputs import ChannelOutput, ChannelState, Reason, StepOutput
from dsz_daemon.edge.samples_file import SamplesWriter, read_samples
from dsz_daemon.errors import InputError, MachineError
from dsz_daemon.pipeline.rows import Counters, Row

NAN = math.nan
NOT_MAPPED = ChannelOutput(NAN, NAN, NAN, NAN, ChannelState.INVALID, False, Reason.NOT_MAPPED)
YAW = ChannelOutput(0.5, 0.3, 0.2, 0.01, ChannelState.LEARNING, True, Reason.NONE)
LATERAL = ChannelOutput(1.5, 1.75, -0.25, 0.02, ChannelState.HOLDING, False, Reason.STEERING_LARGE)
# Every number after the channels is another one, so that a swapped column shows.
NUMBERS = tuple(float(n) for n in range(101, 116))
STEP_COLUMNS = (
    "speed_mps",
    "sideslip_rad",
    "lateral_velocity_mps",
    "yaw_rate_model_radps",
    "road_wheel_angle_rad",
    "accel_x_kinematic_mps2",
    "accel_y_kinematic_mps2",
    "accel_z_kinematic_mps2",
    "tau",
    "roll_rad",
    "pitch_rad",
    "suspension_roll_rad",
    "suspension_pitch_rad",
    "front_cornering_stiffness_n_per_rad",
    "rear_cornering_stiffness_n_per_rad",
)
ROLES = ("brake", "gyro_z", "accel_y", "wheel_speed_fl", "road_wheel_angle", "accel_x_reference")


def row(t_ns: int = 1_500_000_000_010_000_000, event: str = "", gyro_z: ChannelOutput = YAW) -> Row:
    output = StepOutput(NOT_MAPPED, NOT_MAPPED, gyro_z, NOT_MAPPED, LATERAL, NOT_MAPPED, *NUMBERS, standstill=True)
    inputs = {"brake": 1.0, "wheel_speed_fl": 12.5, "road_wheel_angle": 0.125, "accel_x_reference": 7.0}
    ages = {"brake": 0.25, "gyro_z": 0.002}
    return Row(t_ns, output, inputs, ages, Counters(), event)


def write(path: Path, rows: Iterable[Row]) -> None:
    with SamplesWriter(path, ("gyro_z", "accel_y"), ROLES) as writer:
        for each in rows:
            writer.write(each)


def written(path: Path, *rows: Row) -> dict[str, np.ndarray]:
    write(path, rows)
    return read_samples(path)


def test_every_column_carries_its_own_quantity(tmp_path: Path) -> None:
    samples = written(tmp_path / "samples.parquet", row(event="start"))
    expected = {
        "time_s": 1500000000.01,
        "gyro_z_raw_radps": 0.5,
        "gyro_z_radps": 0.3,
        "gyro_z_offset_radps": 0.2,
        "gyro_z_offset_std_radps": 0.01,
        "gyro_z_state": "learning",
        "gyro_z_gate": True,
        "gyro_z_reason": "none",
        "accel_y_raw_mps2": 1.5,
        "accel_y_mps2": 1.75,
        "accel_y_offset_mps2": -0.25,
        "accel_y_offset_std_mps2": 0.02,
        "accel_y_state": "holding",
        "accel_y_gate": False,
        "accel_y_reason": "steering_large",
        **dict(zip(STEP_COLUMNS, NUMBERS, strict=True)),
        "standstill": True,
        "event": "start",
        "wheel_speed_fl_mps": 12.5,
        "road_wheel_angle_input_rad": 0.125,
        "brake": 1.0,
        "accel_x_reference_mps2": 7.0,
        "gyro_z_age_s": 0.002,
        "accel_y_age_s": NAN,
        "wheel_speed_fl_age_s": NAN,
        "road_wheel_angle_age_s": NAN,
        "brake_age_s": 0.25,
        "accel_x_reference_age_s": NAN,
    }
    assert list(samples) == list(expected)
    for name, value in expected.items():
        np.testing.assert_equal(samples[name][0], value, err_msg=name)


def test_numbers_are_float64_switches_bool_and_words_plain_strings_to_any_reader(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    written(tmp_path / "samples.parquet", row())
    kinds = {field.name: str(field.type) for field in pq.read_schema(tmp_path / "samples.parquet")}
    assert (kinds["time_s"], kinds["gyro_z_radps"], kinds["tau"]) == ("double", "double", "double")
    assert (kinds["gyro_z_gate"], kinds["standstill"]) == ("bool", "bool")
    assert (kinds["gyro_z_state"], kinds["gyro_z_reason"], kinds["event"]) == ("string",) * 3


def test_a_channel_that_is_not_mapped_has_no_columns(tmp_path: Path) -> None:
    names = list(written(tmp_path / "samples.parquet", row()))
    for channel in ("gyro_x", "gyro_y", "accel_z"):
        assert not [name for name in names if name.startswith(channel) and "kinematic" not in name]
    assert [n for n in names if n.startswith("accel_x")] == [
        "accel_x_kinematic_mps2",
        "accel_x_reference_mps2",
        "accel_x_reference_age_s",
    ]


def test_what_has_no_value_is_nan_and_stays_nan(tmp_path: Path) -> None:
    gone = ChannelOutput(NAN, NAN, 0.2, 0.01, ChannelState.INVALID, False, Reason.STALE)
    samples = written(tmp_path / "samples.parquet", row(), row(gyro_z=gone))
    np.testing.assert_array_equal(samples["gyro_z_raw_radps"], [0.5, NAN])
    np.testing.assert_array_equal(samples["gyro_z_offset_radps"], [0.2, 0.2])
    assert samples["gyro_z_state"].tolist() == ["learning", "invalid"]


def test_every_state_and_reason_is_written_as_its_lower_case_name(tmp_path: Path) -> None:
    rows = [row(gyro_z=YAW._replace(reason=reason)) for reason in Reason]
    rows += [row(gyro_z=YAW._replace(state=state)) for state in ChannelState]
    samples = written(tmp_path / "samples.parquet", *rows)
    assert samples["gyro_z_reason"].tolist()[: len(Reason)] == [name.lower() for name in Reason.__members__]
    assert samples["gyro_z_state"].tolist()[len(Reason) :] == ["invalid", "holding", "learning", "converged"]


def test_long_runs_go_to_disk_in_pieces_without_losing_or_doubling_a_row(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    path = tmp_path / "samples.parquet"
    samples = written(path, *(row(1_600_000_000_000_000_000 + 10_000_000 * i) for i in range(12_345)))
    # The same times by way of their decimal text, as a log has them.
    expected = [float(f"{1_600_000_000 + i // 100}.{i % 100:02d}") for i in range(12_345)]
    np.testing.assert_array_equal(samples["time_s"], expected)
    sizes = [pq.ParquetFile(path).metadata.row_group(i).num_rows for i in range(3)]
    assert sizes == [6000, 6000, 345]


@pytest.mark.parametrize("rows", [0, 7, 6007])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
def test_after_an_interrupt_all_rows_so_far_are_readable(tmp_path: Path, rows: int, stop: type[BaseException]) -> None:
    path = tmp_path / "samples.parquet"

    def interrupted() -> Iterator[Row]:
        yield from (row(i * 1_000_000_000) for i in range(rows))
        raise stop

    with pytest.raises(stop):
        write(path, interrupted())
    np.testing.assert_array_equal(read_samples(path)["time_s"], np.arange(rows, dtype=float))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["samples.parquet"]


def test_while_it_is_written_nothing_stands_under_the_final_name(tmp_path: Path) -> None:
    path = tmp_path / "samples.parquet"
    written(path, row())
    with SamplesWriter(path, ("gyro_z",), ROLES) as writer:
        writer.write(row())
        # An older run's samples must not stand beside a newer run's log.
        assert sorted(p.name for p in tmp_path.iterdir()) == ["samples.parquet.part"]
    # Whole as soon as the block is left, not only once the writer is collected.
    assert len(read_samples(path)["time_s"]) == 1


def test_a_file_without_its_footer_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "samples.parquet"
    written(path, *(row() for _ in range(50)))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"samples\.parquet: not a complete Parquet file"):
        read_samples(path)
    with pytest.raises(InputError, match=r"nowhere\.parquet: no such file"):
        read_samples(tmp_path / "nowhere.parquet")


def test_a_folder_that_cannot_be_written_is_a_machine_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    path = tmp_path / "file" / "samples.parquet"
    with pytest.raises(MachineError, match=r"samples\.parquet: can't write the samples"):
        written(path, row())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a disk that is always full")
def test_a_full_disk_is_a_machine_error(tmp_path: Path) -> None:
    (tmp_path / "samples.parquet.part").symlink_to("/dev/full")
    with pytest.raises(MachineError, match="No space left on device"):
        written(tmp_path / "samples.parquet", row())


def test_without_pyarrow_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MachineError, match=r"pip install dsz-daemon\[desk\]"):
        SamplesWriter(tmp_path / "samples.parquet", ("gyro_z",), ROLES)
    with pytest.raises(MachineError, match=r"pip install dsz-daemon\[desk\]"):
        read_samples(tmp_path / "samples.parquet")


def test_a_foreign_file_with_dictionary_words_integers_and_nulls_is_read(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(
        {
            "word": pa.array(["a", "b", "a"]).dictionary_encode(),
            "count": pa.array([1, None, 3]),
            "flag": pa.array([True, None, False]),
        }
    )
    pq.write_table(table, tmp_path / "truth.parquet")
    found = read_samples(tmp_path / "truth.parquet")
    assert found["word"].tolist() == ["a", "b", "a"]
    np.testing.assert_array_equal(found["count"], [1.0, NAN, 3.0])
    np.testing.assert_array_equal(found["flag"], [1.0, NAN, 0.0])
