"""Any mapped car on the bus: SI values by role in, the frames that its DBC makes of them out, by cantools.

Shared by the frame fuzzer, the poisoning measurement and the soak. It knows of the mapping what a
configuration says, and nothing of how the daemon decodes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from cantools.database.can import Message, Signal

from dsz_daemon.pipeline.frames import Frame
from dsz_daemon.pipeline.mapping import Source
from dsz_daemon.runs.setup import Setup

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests" / "golden" / "sine_steer" / "config.yaml"
CARS = (GOLDEN, ROOT / "config" / "example.yaml", *sorted((ROOT / "config" / "cars").glob("*.yaml")))


class SyntheticCar:
    """Encodes SI values into the frames of one configuration's messages."""

    def __init__(self, setup: Setup) -> None:
        resolved = setup.checked.resolved
        self._bus = next(iter(setup.settings.buses))
        self._messages: list[tuple[Message, str, list[Source]]] = []
        for name in dict.fromkeys((s.message, s.channel) for s in resolved.sources):
            wanted = [s for s in resolved.sources if (s.message, s.channel) == name]
            self._messages.append((resolved.messages[name[0]], name[1] or self._bus, wanted))

    def frames(self, t_ns: int, values: Mapping[str, float]) -> list[Frame]:
        """One frame of each message, all stamped t_ns; roles that are not in `values` read as nothing."""
        return [
            Frame(t_ns, channel, message.frame_id, _payload(message, wanted, values), message.is_extended_frame)
            for message, channel, wanted in self._messages
        ]


def _payload(message: Message, sources: list[Source], values: Mapping[str, float]) -> bytes:
    physical = {signal.name: _raw_to_physical(signal, 0) for signal in message.signals}
    for source in sources:
        value = values.get(source.role, 0.0)
        if source.is_switch:
            wanted = source.on_values[0] if source.on_values else 1.0
            if value == 0.0:
                wanted = next(x for x in (0.0, 1.0, 2.0, 3.0) if x not in source.on_values)
        else:
            wanted = value / (source.sign * source.to_si)
            if source.volts_per_count is not None:
                wanted = (wanted * source.volts_per_unit + source.null_volts) / source.volts_per_count
        # Of a sum, the first part carries all, but for what the others read at raw 0.
        rest = sum(part.sign * physical[part.signal] for part in source.parts[1:])
        first = source.parts[0]
        physical[first.signal] = _in_range(message.get_signal_by_name(first.signal), (wanted - rest) * first.sign)
        if source.valid_signal is not None:
            physical[source.valid_signal] = source.valid_values[0]
    return bytes(message.encode(physical, scaling=True, padding=False, strict=False))


def _raw_to_physical(signal: Signal, raw: int) -> float:
    return float(raw * signal.conversion.scale + signal.conversion.offset)


def _in_range(signal: Signal, value: float) -> float:
    """The nearest value that the signal's bits can hold."""
    low = -(1 << (signal.length - 1)) if signal.is_signed else 0
    high = (1 << (signal.length - (1 if signal.is_signed else 0))) - 1
    raw = round((value - signal.conversion.offset) / signal.conversion.scale)
    return _raw_to_physical(signal, min(high, max(low, raw)))


def gentle_drive(t_s: float, speed_mps: float = 20.0) -> dict[str, float]:
    """A steady drive with a gentle weave and a living sensor's small movements, as SI values by role."""
    yaw = math.radians(0.8) * math.sin(0.7 * t_s)
    shake = math.sin(31.0 * t_s) + math.sin(47.3 * t_s + 1.0)
    steering = 15.7 * 2.64 * yaw / speed_mps
    wheels = {f"wheel_speed_{w}": speed_mps + 0.05 * shake for w in ("fl", "fr", "rl", "rr")}
    imu = {
        "gyro_x": 0.002 * shake, "gyro_y": 0.0015 * shake, "gyro_z": yaw + 0.001 * shake,
        "accel_x": 0.05 * shake, "accel_y": speed_mps * yaw + 0.05 * shake, "accel_z": 9.80665 + 0.05 * shake,
    }  # fmt: skip
    others = {"yaw_rate_reference": yaw, "speed_reference": speed_mps, "accel_z_reference": 9.80665}
    return {**wheels, **imu, **others, "steering_wheel_angle": steering, "road_wheel_angle": steering / 15.7}
