"""The user's states as CSV and Parquet: what is read, to the last digit, and what is said of a file that is no good."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from dsz_daemon.errors import InputError, MachineError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.runs.states_file import States, check_overlap, read_states

REFERENCE = Path(__file__).parents[3] / "shared/data/rav4_highway/reference.csv"


def csv_file(folder: Path, text: str | bytes, name: str = "states.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def parquet_file(folder: Path, **columns: object) -> Path:
    path = folder / "states.parquet"
    pq.write_table(pa.table(columns), path)
    return path


def refused(path: Path) -> str:
    with pytest.raises(InputError) as raised:
        read_states(path)
    assert str(path) in str(raised.value)
    return str(raised.value)


def rows(states: States, name: str) -> list[tuple[int, float]]:
    t_ns, values = states.signals[name]
    assert t_ns.dtype == np.int64
    return list(zip(t_ns.tolist(), values.tolist(), strict=True))


def test_a_csv_is_read_to_the_last_digit_of_its_time(tmp_path: Path) -> None:
    """A float of an epoch time ends at 240 ns."""
    path = csv_file(tmp_path, "time_s,speed_mps,note\n1533226496.547498001,7.5,a\n1533226496.597506,8.25,b\n")
    states = read_states(path)
    assert rows(states, "speed_mps") == [(1533226496547498001, 7.5), (1533226496597506000, 8.25)]
    assert (list(states.signals), states.unknown) == (["speed_mps"], ("note",))


def test_a_parquet_is_read_to_the_digits_of_a_float(tmp_path: Path) -> None:
    path = parquet_file(tmp_path, time_s=[1700000000.123456, 1700000000.123457], roll_rad=[0.25, 0.5], foo=[[1], [2]])
    states = read_states(path)
    assert states.unknown == ("foo",)
    for (t_ns, value), expected in zip(
        rows(states, "roll_rad"), [(1700000000123456000, 0.25), (1700000000123457000, 0.5)], strict=True
    ):
        assert abs(t_ns - expected[0]) < 240
        assert value == expected[1]


def test_whole_numbers_are_numbers(tmp_path: Path) -> None:
    states = read_states(parquet_file(tmp_path, time_s=[1, 2, 3], vx_mps=[4, None, 6]))
    assert rows(states, "vx_mps") == [(1_000_000_000, 4.0), (3_000_000_000, 6.0)]


def test_what_is_empty_is_left_out_column_by_column(tmp_path: Path) -> None:
    text = "time_s,vx_mps,vy_mps,ax_mps2\n1,10,,\n2,,0.5,\n3,30,nan,\n"
    states = read_states(csv_file(tmp_path, text))
    assert rows(states, "vx_mps") == [(1_000_000_000, 10.0), (3_000_000_000, 30.0)]
    assert rows(states, "vy_mps") == [(2_000_000_000, 0.5)]
    assert "ax_mps2" not in states.signals


def test_rows_are_sorted_and_the_first_value_of_a_time_counts(tmp_path: Path) -> None:
    text = "time_s,speed_mps,course_rad\n3,30,0.3\n1,10,\n2,20,0.2\n1,11,0.1\n"
    states = read_states(csv_file(tmp_path, text))
    assert rows(states, "speed_mps") == [(10**9, 10.0), (2 * 10**9, 20.0), (3 * 10**9, 30.0)]
    assert rows(states, "course_rad") == [(10**9, 0.1), (2 * 10**9, 0.2), (3 * 10**9, 0.3)]


@pytest.mark.parametrize("suffix", ["", "_unit"])
def test_the_imu_is_named_with_or_without_its_unit(tmp_path: Path, suffix: str) -> None:
    names = [("gyro_x", "radps"), ("accel_z", "mps2"), ("wheel_speed_rl", "mps")]
    columns = ",".join(f"{name}_{unit}" if suffix else name for name, unit in names)
    states = read_states(csv_file(tmp_path, f"time_s,{columns}\n1,0.5,9.75,20\n"))
    assert {name: signal.values.tolist() for name, signal in states.signals.items()} == {
        "gyro_x": [0.5],
        "accel_z": [9.75],
        "wheel_speed_rl": [20.0],
    }


@pytest.mark.parametrize("separator", [";", "\t", ","])
def test_a_spreadsheet_writes_it_its_own_way(tmp_path: Path, separator: str) -> None:
    """A mark at the start, another separator, spaces, empty lines, a separator at each end."""
    text = "\ufefftime_s, speed_mps,\r\n\r\n 1.5, 2.5,\r\n,,\r\n".replace(",", separator)
    states = read_states(csv_file(tmp_path, text, "STATES.CSV"))
    assert rows(states, "speed_mps") == [(1_500_000_000, 2.5)]
    assert states.unknown == ()


def test_all_that_is_wrong_is_said_at_once(tmp_path: Path) -> None:
    text = "time_s,speed_mps,grade_up_rad,gyro_z,vx_mps\n1,fast,2.5,0.1,1_0\n2,3,-1.75,90,4\n"
    said = refused(csv_file(tmp_path, text))
    assert "speed_mps, line 2: 'fast' is no number" in said
    assert "vx_mps, line 2: '1_0' is no number" in said
    assert "grade_up_rad, line 2: 2.5 rad can't be (degrees?); expected -1.6 to 1.6 rad (and 1 more)" in said
    assert "gyro_z, line 3: 90 rad/s can't be (deg/s?); expected -35 to 35 rad/s" in said


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is empty"),
        ("\n \n", "is empty"),
        ("time_s,speed_mps\n", "has no rows"),
        ("time,speed_mps\n1,2\n", "time_s: no such column; is time meant?"),
        ("time_s,speed\n1,2\n", "columns: speed; expected any of vx_mps, vy_mps"),
        ("time_s,speed_mps\n1,\n", "speed_mps: has no values"),
        ("time_s,speed_mps\n1,2,3\n", "line 2: has 3 fields; expected 2"),
        ("time_s,speed_mps,speed_mps\n1,2,3\n", "speed_mps: is there more than once"),
        ("time_s,gyro_x,gyro_x_radps\n1,2,3\n", "gyro_x_radps: is there as gyro_x, too"),
        ("time_s;speed_mps\n1;2,5\n", "speed_mps, line 2: '2,5' is no number"),
        ("time_s,speed_mps\n1,inf\n", "inf m/s can't be"),
        ("time_s,speed_mps\n1,1\n,2\n", "time_s, line 3: is empty"),
        ("time_s,speed_mps\n1533226496547,2\n", "time_s, line 2: 1.53323e+12; expected a time in seconds"),
        ("time_s,speed_mps\n" + "1.5e9,2\n" * 9, "8 of 9 rows repeat a time"),
        (b"\xff\xfet\x00i\x00", "is no CSV text"),
    ],
)
def test_a_csv_that_is_no_good_is_told(tmp_path: Path, text: str | bytes, expected: str) -> None:
    assert expected in refused(csv_file(tmp_path, text))


def test_files_that_are_none(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "absent.csv")
    assert "expected .csv or .parquet" in refused(csv_file(tmp_path, "time_s", "states.xlsx"))
    (tmp_path / "folder.csv").mkdir()
    assert "is no file" in refused(tmp_path / "folder.csv")
    assert "not a complete Parquet file" in refused(csv_file(tmp_path, b"PAR1 and then nothing", "cut.parquet"))
    assert "not a complete Parquet file" in refused(csv_file(tmp_path, b"", "empty.parquet"))


def test_parquet_columns_of_other_kinds_are_told(tmp_path: Path) -> None:
    path = parquet_file(tmp_path, time_s=pa.array([1, 2], pa.timestamp("s")), vx_mps=["1", "x"], roll_rad=[True, False])
    said = refused(path)
    assert "time_s, row 1: '1970-01-01 00:00:01' is no number (and 1 more)" in said
    assert "vx_mps, row 2: 'x' is no number" in said
    assert "roll_rad, row 1: 'True' is no number" in said


def test_epoch_seconds_in_32_bits_are_told(tmp_path: Path) -> None:
    times = pa.array([1.7e9 + 0.01 * i for i in range(100)], pa.float32())
    assert "99 of 100 rows repeat a time" in refused(parquet_file(tmp_path, time_s=times, vx_mps=[1.0] * 100))


def test_without_pyarrow_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = parquet_file(tmp_path, time_s=[1.0], vx_mps=[1.0])
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MachineError, match="pip install"):
        read_states(path)


def states_between(first_s: float, last_s: float) -> States:
    stamps = np.array([round(first_s * 1e9), round(last_s * 1e9)], dtype=np.int64)
    return States({"vx_mps": Signal(stamps, np.ones(2))}, ())


PATH = Path("states.csv")


@pytest.mark.parametrize("span", [(1000.0, 1060.0), (900.0, 1000.5), (1059.5, 2000.0), (900.0, 2000.0)])
def test_a_file_that_overlaps_is_fine(span: tuple[float, float]) -> None:
    check_overlap(states_between(*span), 1000.0, 1060.0, PATH)


@pytest.mark.parametrize(
    ("first_s", "hint"),
    [
        (0.0, "count from the start of the drive; if both start together, 1700000000.000 s has to be added"),
        (1.7e9 - 3600.0 - 0.5, "1 h apart, another time zone?"),
        (1.7e9 - 315964782.0, "GPS time counts from 1980"),
        (
            1.7e9 + 500.0,
            "recording 1700000000.000 to 1700000060.000 s; expected the log's clock; if both start together",
        ),
    ],
)
def test_a_file_of_another_time_is_told_with_both_spans(first_s: float, hint: str) -> None:
    with pytest.raises(InputError) as raised:
        check_overlap(states_between(first_s, first_s + 60.0), 1.7e9, 1.7e9 + 60.0, PATH)
    assert f"states.csv: time_s is {first_s:.3f} to {first_s + 60.0:.3f} s" in str(raised.value)
    assert hint in str(raised.value)


@pytest.mark.skipif(not REFERENCE.is_file(), reason="the real recordings are not beside the project")
def test_a_real_reference_is_read() -> None:
    states = read_states(REFERENCE)
    assert set(states.signals) == {"speed_mps", "course_rad", "grade_up_rad"}
    assert states.unknown == ("camera_yaw_rad", "camera_pitch_rad", "camera_roll_rad")
    first, *_ = rows(states, "speed_mps")
    assert first == (1533226496547498000, 7.941968)
    # 20 Hz over a minute.
    steps_s = np.diff(states.signals["speed_mps"].t_ns) * 1e-9
    assert np.median(steps_s) == pytest.approx(0.05, abs=1e-3)
    assert np.sum(steps_s) == pytest.approx(60.0, abs=0.5)
