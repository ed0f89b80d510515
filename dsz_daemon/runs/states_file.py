"""`--reference` and `--simulation`: states of the car over the recording's time, from any tool, as CSV or Parquet.

A column `time_s`, on the log's clock, and any of the columns below. A CSV has one line of names, then numbers with a
decimal point, separated by commas (or semicolons or tabs); a value that is missing is empty or `nan`. Rows need not be
in order: they are sorted by time, and of several at one time a column's first value counts.
"""

from __future__ import annotations

import csv
import difflib
import importlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.errors import Fault, InputError, MachineError
from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, WHEEL_SPEEDS

Floats = np.ndarray[Any, np.dtype[np.float64]]
Stamps = np.ndarray[Any, np.dtype[np.int64]]

# Beyond, int64 nanoseconds end: seconds until the year 2286 fit, milliseconds since 1970 don't.
_LATEST_S = 1e10
# An angle of the body or the road beyond a quarter turn is in degrees, or of no car on its wheels.
_QUARTER_TURN_RAD = 1.6
# A course is not wrapped: so many turns are no drive.
_COURSE_RAD = 2000.0
# Epoch seconds in 32 bits stand still for two minutes.
_MOST_REPEATED = 0.5
# Clocks that are a whole number of these apart are in different time zones.
_ZONE_S = 1800.0
_GPS_EPOCH_S, _LEAP_S = 315_964_800.0, 30.0


class _Known(NamedTuple):
    """A column: the name it is returned by, and which values are possible."""

    name: str
    low: float
    high: float
    unit: str


def _known() -> dict[str, _Known]:
    speed, rate, force = (QUANTITIES[name] for name in ("speed_reference", "gyro_z", "accel_x"))
    rows = [_Known(name, speed.low, speed.high, "m/s") for name in ("vx_mps", "vy_mps", "vz_mps", "speed_mps")]
    angles = ("roll", "pitch", "sideslip", "grade_up", "bank", "road_grade_up", "road_bank", "road_wheel_angle")
    rows += [_Known(f"{name}_rad", -_QUARTER_TURN_RAD, _QUARTER_TURN_RAD, "rad") for name in angles]
    rows += [_Known(name, -_COURSE_RAD, _COURSE_RAD, "rad") for name in ("course_rad", "yaw_rad")]
    rates = ("roll_rate_radps", "pitch_rate_radps", "yaw_rate_radps")
    rows += [_Known(name, rate.low, rate.high, "rad/s") for name in rates]
    rows += [_Known(name, force.low, force.high, "m/s^2") for name in ("ax_mps2", "ay_mps2", "az_mps2")]
    found = {row.name: row for row in rows}
    for role in (*IMU_CHANNELS, *WHEEL_SPEEDS):
        quantity = QUANTITIES[role]
        row = _Known(role, quantity.low, quantity.high, quantity.si_unit)
        found |= {role: row, f"{role}_{quantity.suffix}": row}
    return found


KNOWN: Mapping[str, _Known] = _known()


class States(NamedTuple):
    """What a file says: `signals` by plain name (`speed_mps`, `gyro_x`), columns that nobody knows in `unknown`."""

    signals: dict[str, Signal]
    unknown: tuple[str, ...]


class _Table(NamedTuple):
    """Columns as they stand in the file, text or numbers; `rows` says where each row stands."""

    columns: dict[str, Any]
    rows: Sequence[int]
    word: str

    def at(self, name: str, row: int) -> str:
        """Where a cell is, in words."""
        return f"{name}, {self.word} {self.rows[row]}"


def read_states(path: Path) -> States:
    """All known columns of the file: stamps in ns, rising, and values in SI; what is empty is left out.

    InputError: no such file, neither .csv nor .parquet, nothing in it, no `time_s` or none of the known columns, what
    is no number or can't be (degrees for radians); all faults at once. MachineError: Parquet without pyarrow.
    """
    readers = {".csv": _csv, ".parquet": _parquet}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: ends in {path.suffix or 'nothing'!r}; expected .csv or .parquet")
    if not path.is_file():
        raise InputError(f"{path}: {'is no file' if path.exists() else 'no such file'}")
    table = reader(path)
    known = [name for name in table.columns if name in KNOWN]
    faults = list(_faults_of_names(table.columns, known))
    if not table.rows:
        raise InputError(f"{path}: has no rows; expected time_s and states over time", faults)
    t_ns = _stamps(table, faults) if "time_s" in table.columns else np.zeros(0, dtype=np.int64)
    values = {name: _numbers(table, name, faults) for name in known}
    for name in known:
        faults += _impossible(table, name, values[name])
    signals = {} if faults else {KNOWN[name].name: signal for name in known if (signal := _signal(t_ns, values[name]))}
    if not faults and not signals:
        faults.append(Fault(", ".join(known), "has no values"))
    if faults:
        raise InputError(f"{path}: can't be used", faults)
    return States(signals, tuple(name for name in table.columns if name not in KNOWN and name not in {"time_s", ""}))


def check_overlap(states: States, first_s: float, last_s: float, path: Path) -> None:
    """InputError where no value of the file is within the recording, `first_s` to `last_s` on the log's clock."""
    begins = min(int(signal.t_ns[0]) for signal in states.signals.values()) * 1e-9
    ends = max(int(signal.t_ns[-1]) for signal in states.signals.values()) * 1e-9
    if begins <= last_s and ends >= first_s:
        return
    raise InputError(
        f"{path}: time_s is {begins:.3f} to {ends:.3f} s, the recording {first_s:.3f} to {last_s:.3f} s; expected the "
        f"log's clock{_hint(first_s - begins, begins, last_s - first_s)}"
    )


def _hint(apart_s: float, begins_s: float, length_s: float) -> str:
    """What clocks that are so far apart may be, in words."""
    zones = round(apart_s / _ZONE_S)
    if abs(begins_s) <= max(length_s, 1.0) < abs(apart_s):
        kind = "time_s seems to count from the start of the drive"
    elif abs(abs(apart_s) - _GPS_EPOCH_S) <= max(_LEAP_S, length_s):
        kind = "GPS time counts from 1980, the log from 1970"
    elif 0 < abs(zones) <= 28 and abs(apart_s - zones * _ZONE_S) <= max(1.0, 0.1 * length_s):
        kind = f"{zones * _ZONE_S / 3600.0:g} h apart, another time zone?"
    else:
        return f"; if both start together, {apart_s:.3f} s has to be added to it"
    return f" ({kind}; if both start together, {apart_s:.3f} s has to be added to it)"


def _csv(path: Path) -> _Table:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            file.seek(0)
            reader = csv.reader(file, delimiter=max(",;\t", key=first.count))
            lines = [(reader.line_num, [field.strip() for field in row]) for row in reader if any(map(str.strip, row))]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: is no CSV text: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read: {error.strerror or error}") from None
    if not lines:
        raise InputError(f"{path}: is empty; expected a line of names (time_s, speed_mps, ...) and rows of numbers")
    (_, names), *rows = lines
    wanted = [i for i, name in enumerate(names) if name in KNOWN or name == "time_s"]
    twice = sorted({names[i] for i in wanted if names.count(names[i]) > 1})
    faults = [Fault(name, "is there more than once") for name in twice]
    ragged = [i for i, (_, row) in enumerate(rows) if len(row) != len(names)]
    faults += _few(
        ragged,
        lambda i: Fault(f"line {rows[i][0]}", f"has {len(rows[i][1])} fields; expected {len(names)}, as the names"),
    )
    if faults:
        raise InputError(f"{path}: is no table", faults)
    columns: dict[str, Any] = dict.fromkeys(names, ())
    columns |= {names[i]: [row[i] for _, row in rows] for i in wanted}
    return _Table(columns, [number for number, _ in rows], "line")


def _parquet(path: Path) -> _Table:
    """Only the wanted columns are read: what else is in the file need not be numbers."""
    try:
        arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise MachineError(
            "Parquet files need pyarrow, which is not installed: pip install dsz-daemon[desk]"
        ) from error
    try:
        names: list[str] = parquet.read_schema(path).names
        wanted = [name for name in names if name in KNOWN or name == "time_s"]
        table = parquet.read_table(path, columns=wanted)
        columns: dict[str, Any] = dict.fromkeys(names, ())
        columns |= {name: _cells(arrow, table.column(name)) for name in wanted}
    except (OSError, arrow.ArrowException) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise InputError(f"{path}: not a complete Parquet file: {reason}") from None
    return _Table(columns, range(1, table.num_rows + 1), "row")


def _cells(arrow: Any, column: Any) -> Any:
    """Numbers as float64, NaN where there is none; anything else as it is, to be told."""
    kinds = arrow.types
    if kinds.is_integer(column.type) or kinds.is_floating(column.type) or kinds.is_null(column.type):
        return np.asarray(column.cast(arrow.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)
    return column.to_pylist()


def _faults_of_names(columns: Mapping[str, Any], known: Sequence[str]) -> Iterator[Fault]:
    if "time_s" not in columns:
        near = difflib.get_close_matches("time_s", columns, 1, 0.5)
        yield Fault("time_s", f"no such column{f'; is {near[0]} meant?' if near else ''}; expected the log's clock, s")
    if not known:
        names = [name for name in columns if name != "time_s"] or ["none"]
        told = ", ".join(names[:10]) + (", ..." if len(names) > 10 else "")
        yield Fault(
            "columns", f"{told}; expected any of {', '.join(dict.fromkeys(one.name for one in KNOWN.values()))}"
        )
    for name in known:
        plain = KNOWN[name].name
        if name != plain and plain in known:
            yield Fault(name, f"is there as {plain}, too; expected one of them")


def _few(bad: Sequence[int], said: Callable[[int], Fault]) -> list[Fault]:
    """The first of many faults alike, and how many more there are."""
    if not bad:
        return []
    first = said(bad[0])
    return [Fault(first.where, f"{first.what} (and {len(bad) - 1} more)") if len(bad) > 1 else first]


def _numbers(table: _Table, name: str, faults: list[Fault]) -> Floats:
    """A column as numbers, NaN where empty."""
    column = table.columns[name]
    if isinstance(column, np.ndarray) and column.dtype == np.float64:
        return np.asarray(column)
    values = np.full(len(column), math.nan)
    bad = []
    for i, cell in enumerate(column):
        try:
            values[i] = _number(cell)
        except ValueError:
            bad.append(i)
    faults += _few(bad, lambda i: Fault(table.at(name, i), f"{str(column[i])[:40]!r} is no number"))
    return values


def _number(cell: object) -> float:
    """ValueError for what is no plain number; what Python takes for one besides ("1_000", a switch) is none."""
    if cell is None or cell == "":
        return math.nan
    if not isinstance(cell, str) or "_" in cell:
        raise ValueError
    return float(cell)


def _stamps(table: _Table, faults: list[Fault]) -> Stamps:
    """`time_s` in ns; text to the last digit, numbers to that of a float."""
    before = len(faults)
    seconds = _numbers(table, "time_s", faults)
    t_ns = np.zeros(len(seconds), dtype=np.int64)
    if len(faults) > before:
        return t_ns
    bad = np.flatnonzero(~(np.abs(seconds) < _LATEST_S)).tolist()
    faults += _few(bad, lambda i: Fault(table.at("time_s", i), f"{_told(seconds[i])}; expected a time in seconds"))
    if bad:
        return t_ns
    column = table.columns["time_s"]
    if isinstance(column, np.ndarray):
        whole = np.floor(seconds)
        t_ns = whole.astype(np.int64) * 1_000_000_000 + np.rint((seconds - whole) * 1e9).astype(np.int64)
    else:
        t_ns = np.array([_exact_ns(cell) for cell in column], dtype=np.int64)
    repeated = len(t_ns) - len(np.unique(t_ns))
    if repeated > _MOST_REPEATED * len(t_ns):
        what = (
            f"{repeated} of {len(t_ns)} rows repeat a time; expected one row a time (32 bits can't hold epoch seconds)"
        )
        faults.append(Fault("time_s", what))
    return t_ns


def _exact_ns(cell: str) -> int:
    """Decimal seconds as ns, however many digits they have.

    >>> _exact_ns("1533226496.547498")
    1533226496547498000
    """
    try:
        return int((Decimal(cell) * 1_000_000_000).to_integral_value())
    except InvalidOperation:
        return round(float(cell) * 1e9)


def _impossible(table: _Table, name: str, values: Floats) -> list[Fault]:
    known = KNOWN[name]
    with np.errstate(invalid="ignore"):
        bad = np.flatnonzero((values < known.low) | (values > known.high))
    degrees = {"rad": " (degrees?)", "rad/s": " (deg/s?)"}.get(known.unit, "")
    expected = f"expected {known.low:g} to {known.high:g} {known.unit}"
    return _few(
        bad.tolist(),
        lambda i: Fault(table.at(name, i), f"{values[i]:g} {known.unit} can't be{degrees}; {expected}"),
    )


def _told(value: float) -> str:
    return "is empty" if math.isnan(value) else f"{value:g}"


def _signal(t_ns: Stamps, values: Floats) -> Signal | None:
    """The values that are there, in order of time, the first of each time; None without any."""
    there = np.isfinite(values)
    if not there.any():
        return None
    stamps, first = np.unique(t_ns[there], return_index=True)
    return Signal(stamps, values[there][first])
