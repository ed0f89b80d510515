"""The one loop: frames in, rows out, at a fixed rate. Live, replay and simulation all run it.

Ticks are events on a grid of whole periods of the bus's own time, so that a live run and a
replay of its recording tick at the same instants. A tick at t sees every frame stamped t or
before. After `gap_s` without any wanted frame the loop sleeps (no estimation; live, rows say
"silent"); the next frame wakes it, and motion starts afresh with the offsets kept. A stamp
that falls back by more than `clock_step_s` moves the grid; smaller disorder is only late data.
A stamp that leaps ahead by more than `gap_s` is believed once the next wanted frame bears it out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from dsz_daemon.core.outputs import ChannelOutput, ChannelState, Reason, StepOutput
from dsz_daemon.core.parameters import Car, Inputs, Tuning
from dsz_daemon.core.state import EstimatorState, initial_state, resumed
from dsz_daemon.core.step import step
from dsz_daemon.pipeline.align import Aligner
from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Sample
from dsz_daemon.pipeline.rows import Counters, Refusal, Row
from dsz_daemon.pipeline.sensor_watch import SensorWatch, WatchLimits
from dsz_daemon.signals import IMU_CHANNELS

NAN = math.nan


class LoopSettings(NamedTuple):
    """Rate and patience of the loop; `steering_ratio` is hand wheel over road wheel, `watch` for the sensors."""

    rate_hz: float = 100.0
    stale_after_s: float = 0.5
    gap_s: float = 1.0
    clock_step_s: float = 1.0
    steering_ratio: float = 1.0
    watch: WatchLimits = WatchLimits()

    @property
    def period_ns(self) -> int:
        """The tick period."""
        return round(1e9 / self.rate_hz)


class FrameDecoder(Protocol):
    """What the loop needs of a decoder."""

    def decode(self, frame: Frame) -> Sequence[Sample]:
        """Samples of one frame; none for a frame that nobody wants."""
        ...

    @property
    def rejected(self) -> int:
        """Values refused so far."""
        ...


@dataclass
class LoopMemory:
    """Everything that the loop remembers: copy it and a resumed loop goes on as if never stopped."""

    estimator: EstimatorState
    aligner: Aligner
    watch: SensorWatch = field(default_factory=SensorWatch)
    leapt: tuple[Sample, ...] = ()
    decoder_rejected: int = 0
    watch_rejected: int = 0
    next_tick_ns: int | None = None
    last_tick_ns: int = 0
    last_sample_ns: int = 0
    asleep: bool = False
    event: str = "start"
    counters: Counters = field(default_factory=Counters)
    output: StepOutput | None = None


class Loop:
    """Decodes, aligns and steps; `frame` and `advance` return the rows that became due."""

    def __init__(
        self,
        car: Car,
        tuning: Tuning,
        settings: LoopSettings,
        decoder: FrameDecoder,
        roles: frozenset[str],
        estimator: EstimatorState | None = None,
    ) -> None:
        self.car, self.tuning, self.settings = car, tuning, settings
        self._decoder, self._roles = decoder, roles
        self._unmapped = tuple(name not in roles for name in IMU_CHANNELS)
        stale_ns = round(settings.stale_after_s * 1e9)
        self.memory = LoopMemory(
            estimator or initial_state(tuning), Aligner(stale_ns), watch=SensorWatch(settings.watch)
        )

    @property
    def next_tick_ns(self) -> int | None:
        """When the next tick is due on the bus's clock; None before the first wanted frame and while asleep."""
        return None if self.memory.asleep else self.memory.next_tick_ns

    def frame(self, frame: Frame) -> list[Row]:
        """One frame in; rows of the ticks that lay before it out."""
        memory = self.memory
        samples = self._decoder.decode(frame)
        if samples:
            rows = self._decoded(frame, samples)
        elif self._decoder.rejected != memory.decoder_rejected and not self._is_gap(frame.t_ns):
            rows = self._ticks(frame.t_ns - 1)
        else:
            return []
        # Only now: a tick that lay before this frame does not know of its faults, whoever brought it due.
        if not memory.leapt:
            memory.decoder_rejected = self._decoder.rejected
        return rows

    def _decoded(self, frame: Frame, samples: Sequence[Sample]) -> list[Row]:
        memory = self.memory
        rows: list[Row] = []
        if memory.leapt:
            leapt, memory.leapt = memory.leapt, ()
            if frame.t_ns >= leapt[0].t_ns - round(self.settings.clock_step_s * 1e9):
                rows = self._taken(leapt)
            else:
                memory.watch.refused += [Refusal(sample.role, "stamp") for sample in leapt]
        if memory.next_tick_ns is not None and self._is_gap(frame.t_ns):
            memory.leapt = tuple(samples)
            return rows
        return rows + self._taken(samples)

    def _is_gap(self, t_ns: int) -> bool:
        return t_ns - self.memory.last_sample_ns > round(self.settings.gap_s * 1e9)

    def _taken(self, samples: Sequence[Sample]) -> list[Row]:
        """The samples of one frame in; rows of the ticks that lay before it out."""
        memory, t_ns = self.memory, samples[0].t_ns
        rows = self._until(t_ns)
        for sample in samples:
            for good in memory.watch.passed(sample):
                memory.aligner.take(good)
        memory.last_sample_ns = max(memory.last_sample_ns, t_ns)
        counters = memory.counters
        memory.counters = counters._replace(frames=counters.frames + 1, samples=counters.samples + len(samples))
        return rows

    def _until(self, t_ns: int) -> list[Row]:
        """Brings time to just before a wanted frame at t_ns: ticks due, start, wake or clock step."""
        memory, settings = self.memory, self.settings
        if memory.next_tick_ns is None:
            self._anchor(t_ns)
            return []
        if t_ns < memory.last_sample_ns - round(settings.clock_step_s * 1e9):
            counters = memory.counters
            memory.counters = counters._replace(clock_steps=counters.clock_steps + 1)
            self._restart(t_ns, 0.0, "clock_step")
            return []
        rows = self._ticks(t_ns - 1)
        if self._is_gap(t_ns):
            away_s = max(0, t_ns - memory.last_tick_ns) * 1e-9
            memory.counters = memory.counters._replace(gaps=memory.counters.gaps + 1)
            self._restart(t_ns, away_s, "gap")
        return rows

    def _anchor(self, t_ns: int) -> None:
        period = self.settings.period_ns
        self.memory.next_tick_ns = -(-t_ns // period) * period
        self.memory.last_tick_ns = self.memory.next_tick_ns - period
        self.memory.last_sample_ns = t_ns

    def _restart(self, t_ns: int, away_s: float, event: str) -> None:
        memory = self.memory
        memory.estimator = resumed(memory.estimator, self.tuning, away_s)
        memory.aligner.forget()
        memory.watch.forget()
        memory.asleep, memory.event = False, event
        self._anchor(t_ns)

    def advance(self, t_ns: int) -> list[Row]:
        """The rows of all ticks up to and including t_ns (the clock's word, when no frame comes)."""
        return [] if self.memory.next_tick_ns is None else self._ticks(t_ns)

    def finish(self) -> list[Row]:
        """The rows up to the last wanted frame, at a recording's end."""
        return self.advance(self.memory.last_sample_ns)

    def _ticks(self, t_ns: int) -> list[Row]:
        memory, rows = self.memory, []
        limit = memory.last_sample_ns + round(self.settings.gap_s * 1e9)
        while memory.next_tick_ns is not None and memory.next_tick_ns <= t_ns and not memory.asleep:
            if memory.next_tick_ns > limit:
                memory.asleep = True
                break
            rows.append(self._tick(memory.next_tick_ns))
            memory.next_tick_ns += self.settings.period_ns
        return rows

    def silent_row(self, t_ns: int) -> Row | None:
        """While asleep: a row that says so (all channels invalid), for whoever listens on the bus."""
        memory = self.memory
        if not memory.asleep or memory.output is None:
            return None
        channels = [
            channel._replace(raw=NAN, compensated=NAN, state=ChannelState.INVALID, gate=False, reason=Reason.STALE)
            for channel in memory.output.channels
        ]
        output = memory.output._replace(**dict(zip(IMU_CHANNELS, channels, strict=True)), speed_mps=NAN)  # type: ignore[arg-type]
        return Row(t_ns, output, {}, {}, memory.counters, "silent")

    def _tick(self, t_ns: int) -> Row:
        memory = self.memory
        values, ages = memory.aligner.aligned(t_ns)
        dt_s = (t_ns - memory.last_tick_ns) * 1e-9
        memory.estimator, output = step(self.car, self.tuning, memory.estimator, self._inputs(values), dt_s)
        if any(self._unmapped):
            output = _without(output, self._unmapped)
        refused = tuple(memory.watch.refused)
        memory.watch.refused.clear()
        memory.watch_rejected += len(refused)
        memory.counters = memory.counters._replace(rejected=memory.decoder_rejected + memory.watch_rejected)
        row = Row(t_ns, output, values, ages, memory.counters, memory.event, refused)
        memory.last_tick_ns, memory.event, memory.output = t_ns, "", output
        return row

    def _inputs(self, values: dict[str, float]) -> Inputs:
        get = values.get
        delta = get("road_wheel_angle", NAN)
        if "steering_wheel_angle" in values:
            delta = values["steering_wheel_angle"] / self.settings.steering_ratio
        return Inputs(
            gyro_x=get("gyro_x", NAN),
            gyro_y=get("gyro_y", NAN),
            gyro_z=get("gyro_z", NAN),
            accel_x=get("accel_x", NAN),
            accel_y=get("accel_y", NAN),
            accel_z=get("accel_z", NAN),
            wheel_speed_fl=get("wheel_speed_fl", NAN),
            wheel_speed_fr=get("wheel_speed_fr", NAN),
            wheel_speed_rl=get("wheel_speed_rl", NAN),
            wheel_speed_rr=get("wheel_speed_rr", NAN),
            road_wheel_angle=delta,
            brake=get("brake", NAN),
            accelerator=get("accelerator", NAN),
            reverse=get("reverse", NAN),
        )


def _without(output: StepOutput, unmapped: tuple[bool, ...]) -> StepOutput:
    """The same output with unmapped channels marked as such."""
    channels: dict[str, ChannelOutput] = {
        name: getattr(output, name)._replace(reason=Reason.NOT_MAPPED)
        for name, missing in zip(IMU_CHANNELS, unmapped, strict=True)
        if missing
    }
    return output._replace(**channels)  # type: ignore[arg-type]
