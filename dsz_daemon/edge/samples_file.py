"""`samples.parquet`: one line per step of the loop, written while the loop runs.

Columns, in this order (a quantity that no source was mapped for has none):

- `time_s`, the log's clock;
- per IMU channel `c` with unit suffix `u` (radps, mps2): `c_raw_u`, `c_u` (compensated),
  `c_offset_u`, `c_offset_std_u`, `c_state`, `c_gate`, `c_reason`; offset is reading minus truth;
- every other field of `core.outputs.StepOutput` under its own name, except that the
  inverse-kinematics references (20)-(22) are called `accel_x_kinematic_mps2` ..: the name
  `accel_x_reference_mps2` belongs to another unit's reading;
- `event`: "", "start", "gap" or "clock_step";
- per mapped role that is no IMU channel: `role_suffix` in SI (`wheel_speed_fl_mps`, `brake`);
- per mapped role: `role_age_s`.

Numbers are float64 with NaN for "no value"; states and reasons are lower-case words.

What survives: a Parquet file can be read only once its footer is written. Leaving the `with`
block writes it, also on Ctrl-C or any exception, so all rows up to then are there. Until that
moment the file is called `<name>.part`; after a kill -9 or a power cut only the `.part` is left,
and it can't be read. `compensated.log`, which is plain text, is what survives those.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self, get_type_hints

import numpy as np

from dsz_daemon.core.outputs import ChannelOutput, StepOutput
from dsz_daemon.errors import InputError, MachineError
from dsz_daemon.pipeline.rows import Row
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES

# One row group: 60 s at the default 100 Hz. About 100 columns of Python numbers make it 20 MB
# while it is collected; smaller groups would cost compression and reading speed.
_ROWS_PER_GROUP = 6000

_STEP_FIELDS = StepOutput._fields[len(IMU_CHANNELS) :]
# The estimator's own value has the plain name; what the car measured is told apart.
_INPUT_COLUMN = {"road_wheel_angle": "road_wheel_angle_input_rad"}


class _Column(NamedTuple):
    """One column: its name and `float`, `bool`, `str` or the enumeration whose names it holds."""

    name: str
    kind: type


def _channel_columns(channel: str) -> list[_Column]:
    """List the seven columns of one IMU channel, in the order of `ChannelOutput`'s fields."""
    unit = QUANTITIES[channel].suffix
    names = {
        "raw": f"{channel}_raw_{unit}",
        "compensated": f"{channel}_{unit}",
        "offset": f"{channel}_offset_{unit}",
        "offset_std": f"{channel}_offset_std_{unit}",
    }
    kinds = get_type_hints(ChannelOutput)
    return [_Column(names.get(f, f"{channel}_{f}"), kinds[f]) for f in ChannelOutput._fields]


def _columns(channels: Sequence[str], inputs: Sequence[str], aged: Sequence[str]) -> list[_Column]:
    kinds = get_type_hints(StepOutput)
    columns = [_Column("time_s", float)]
    for channel in channels:
        columns += _channel_columns(channel)
    columns += [
        _Column(f.replace("_reference_", "_kinematic_") if f.startswith("accel_") else f, kinds[f])
        for f in _STEP_FIELDS
    ]
    columns += [_Column("event", str)]
    columns += [_Column(input_column(role), float) for role in inputs]
    columns += [_Column(f"{role}_age_s", float) for role in aged]
    return columns


def input_column(role: str) -> str:
    """Name of a mapped input's column in SI.

    >>> input_column("wheel_speed_fl"), input_column("brake"), input_column("yaw_rate_reference")
    ('wheel_speed_fl_mps', 'brake', 'yaw_rate_reference_radps')
    """
    suffix = QUANTITIES[role].suffix
    return _INPUT_COLUMN.get(role, f"{role}_{suffix}" if suffix else role)


def _pyarrow(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MachineError(
            "Parquet files need pyarrow, which is not installed: pip install dsz-daemon[desk]"
        ) from error


@contextmanager
def _disk_faults(path: Path) -> Iterator[None]:
    """Turn what the operating system or Arrow says about `path` into a MachineError."""
    try:
        yield
    except OSError as error:
        raise MachineError(f"{path}: can't write the samples: {error.strerror or error}") from error


class SamplesWriter:
    """Writes rows to `path` as they come; a context manager.

    `channels`: the mapped IMU channels; `roles`: all mapped roles (the IMU's may be among them).
    Raises MachineError when pyarrow is missing, the folder can't be written or the disk is full.
    """

    def __init__(self, path: Path, channels: Sequence[str], roles: Sequence[str]) -> None:
        self._path = path
        self._part = path.with_name(path.name + ".part")
        # In the vocabulary's order, whatever the configuration's: files of two runs compare.
        self._channels = tuple(c for c in IMU_CHANNELS if c in channels)
        self._inputs = tuple(q for q in QUANTITIES if q in roles and q not in IMU_CHANNELS)
        self._aged = (*self._channels, *self._inputs)
        self._positions = tuple(IMU_CHANNELS.index(c) for c in self._channels)
        self._columns = _columns(self._channels, self._inputs, self._aged)
        self._lines: list[tuple[Any, ...]] = []
        self._arrow = _pyarrow("pyarrow")
        self._schema = self._arrow.schema([(c.name, self._arrow_type(c.kind)) for c in self._columns])
        self._file: Any = None

    def _arrow_type(self, kind: type) -> Any:
        if kind is bool:
            return self._arrow.bool_()
        # Plain strings to the reader; Parquet stores repeated ones as a dictionary by itself.
        return self._arrow.float64() if kind is float else self._arrow.string()

    def __enter__(self) -> Self:
        with _disk_faults(self._path):
            # A folder must never show the samples of an older run beside a newer log.
            self._path.unlink(missing_ok=True)
            self._file = _pyarrow("pyarrow.parquet").ParquetWriter(self._part, self._schema, compression="zstd")
        return self

    def write(self, row: Row) -> None:
        """Add one row; now and then this writes a row group to disk."""
        # One append of one tuple: an interrupt leaves either the whole row or none of it.
        self._lines.append(self._line(row))
        if len(self._lines) >= _ROWS_PER_GROUP:
            self._flush()

    def _line(self, row: Row) -> tuple[Any, ...]:
        line: list[Any] = [row.t_ns / 1_000_000_000]
        channels = row.output.channels
        for position in self._positions:
            line += channels[position]
        line += row.output[len(IMU_CHANNELS) :]
        line.append(row.event)
        line += [row.inputs.get(role, np.nan) for role in self._inputs]
        line += [row.ages_s.get(role, np.nan) for role in self._aged]
        return tuple(line)

    def _flush(self) -> None:
        if not self._lines:
            return
        values = zip(*self._lines, strict=True)
        arrays = [self._array(c.kind, v) for c, v in zip(self._columns, values, strict=True)]
        table = self._arrow.Table.from_arrays(arrays, schema=self._schema)
        # Cleared first: should an interrupt fall between these two lines, a minute is missing;
        # the other way round a minute would stand in the file twice.
        self._lines = []
        with _disk_faults(self._path):
            self._file.write_table(table)

    def _array(self, kind: type, values: tuple[Any, ...]) -> Any:
        if issubclass(kind, IntEnum):
            words = self._arrow.array([member.name.lower() for member in kind])
            position = {int(member): i for i, member in enumerate(kind)}
            codes = np.array([position[int(v)] for v in values], dtype=np.int8)
            return words.take(self._arrow.array(codes))
        if kind is str:
            return self._arrow.array(values, self._arrow.string())
        return self._arrow.array(np.array(values, dtype=kind))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._flush()
        finally:
            # The footer is written even when the last rows could not be.
            with _disk_faults(self._path):
                self._file.close()
                self._part.replace(self._path)


def write_columns(columns: Mapping[str, np.ndarray[Any, np.dtype[Any]]], path: Path) -> None:
    """Writes columns of equal length as Parquet. MachineError: no pyarrow, or a disk that refuses."""
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")

    def array(values: np.ndarray[Any, np.dtype[Any]]) -> Any:
        if values.dtype != np.float64:
            return arrow.array(values)
        # As they lie in memory: asked what else they could be, pyarrow imports pandas where there is one.
        buffers = [None, arrow.py_buffer(np.ascontiguousarray(values))]
        return arrow.Array.from_buffers(arrow.float64(), len(values), buffers)

    with _disk_faults(path):
        parquet.write_table(arrow.table({name: array(values) for name, values in columns.items()}), path)


def read_samples(path: Path) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    """All columns of a samples (or truth) file by name, each of shape (rows,).

    Numbers are float64 with NaN for "no value", switches bool, words object arrays of `str`.
    Raises InputError when there is no such file or it is no complete Parquet file, MachineError
    when pyarrow is missing.
    """
    arrow = _pyarrow("pyarrow")
    try:
        table = _pyarrow("pyarrow.parquet").read_table(path)
        return {name: _numpy(arrow, table.column(name)) for name in table.column_names}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file, expected a samples file of `dsz replay`") from error
    except (OSError, arrow.ArrowException) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise InputError(f"{path}: not a complete Parquet file of numbers and words: {reason}") from error


def _numpy(arrow: Any, column: Any) -> np.ndarray[Any, np.dtype[Any]]:
    kind = column.type
    if arrow.types.is_dictionary(kind):
        kind = kind.value_type
        column = column.cast(kind)
    if arrow.types.is_string(kind) or arrow.types.is_large_string(kind):
        # One Python string per distinct word instead of one per row.
        words = column.combine_chunks().dictionary_encode()
        distinct = np.asarray(words.dictionary.to_numpy(zero_copy_only=False), dtype=object)
        return np.asarray(distinct[words.indices.to_numpy(zero_copy_only=False)])
    if arrow.types.is_boolean(kind) and column.null_count == 0:
        return np.asarray(column.to_numpy(zero_copy_only=False), dtype=bool)
    return np.asarray(column.cast(arrow.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)
