"""Faults that no single key shows: what fits together and what does not.

These look at the plain data, before and whatever the typed settings say of it, so that they
are reported together with every other fault. They pass over what is of the wrong type: that
is a fault of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.config.protection import protection_faults
from dsz_daemon.config.sections import unit_in_name
from dsz_daemon.config.signal_settings import SWITCHES
from dsz_daemon.config.units import canonical_unit
from dsz_daemon.config.vehicle import VehicleSettings
from dsz_daemon.signals import IMU_CHANNELS, QUANTITIES, WHEEL_ROTATION_UNITS, WHEEL_SPEEDS

Loc = tuple[str | int, ...]
Found = Iterator[tuple[Loc, str]]


def cross_faults(data: Mapping[str, Any]) -> list[tuple[Loc, str]]:
    """(location, text) of every combination that can't work."""
    signals = _mapping(data.get("signals"))
    roles = {role: _mapping(signals[role]) for role in QUANTITIES if _mapping(signals.get(role))}
    return [
        *_empty_roles(signals),
        *_no_channel(signals, roles),
        *_steering(roles, _mapping(data.get("vehicle"))),
        *_wheel_radius(roles, _mapping(data.get("vehicle"))),
        *_shared_sources(roles),
        *(fault for role, signal in roles.items() for fault in _one_signal(role, signal)),
        *_channels(roles, _mapping(data.get("bus"))),
        *_output(_mapping(data.get("output")), _mapping(data.get("bus"))),
        *protection_faults(_mapping(data.get("protection"))),
        *_tolerances(_mapping(_mapping(data.get("diagnose")).get("tolerance"))),
    ]


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _empty_roles(signals: Mapping[str, Any]) -> Found:
    for role in QUANTITIES:
        if role in signals and signals[role] is None:
            yield ("signals", role), "is empty; expected a message and a signal, or no such line"


def _no_channel(signals: Mapping[str, Any], roles: Mapping[str, Any]) -> Found:
    if signals and not any(channel in signals for channel in IMU_CHANNELS):
        mapped = f" (mapped: {', '.join(roles)})" if roles else ""
        yield ("signals",), f"no gyro or accelerometer is mapped{mapped}; expected one of {', '.join(IMU_CHANNELS)}"


def _steering(roles: Mapping[str, Any], vehicle: Mapping[str, Any]) -> Found:
    if "steering_wheel_angle" in roles and "road_wheel_angle" in roles:
        yield (
            ("signals", "road_wheel_angle"),
            "steering_wheel_angle is mapped too; expected one of the two, they say the same",
        )
    if "steering_wheel_angle" in roles and vehicle and vehicle.get("steering_ratio") is None:
        yield (
            ("vehicle", "steering_ratio"),
            "is missing; expected 1 to 50, since signals.steering_wheel_angle needs it "
            "(or map road_wheel_angle instead)",
        )


def _wheel_radius(roles: Mapping[str, Any], vehicle: Mapping[str, Any]) -> Found:
    turning = [
        role
        for role in WHEEL_SPEEDS
        if role in roles and canonical_unit(str(roles[role].get("unit"))) in WHEEL_ROTATION_UNITS
    ]
    if turning and vehicle and vehicle.get("wheel_radius_m") is None:
        unit = roles[turning[0]]["unit"]
        yield (
            ("vehicle", "wheel_radius_m"),
            f"is missing; expected {{fl, fr, rl, rr}} in m, since {', '.join(turning)} come in {unit}",
        )


def _shared_sources(roles: Mapping[str, Mapping[str, Any]]) -> Found:
    """Two roles from one and the same signal: one of them is a slip of copy and paste."""
    taken: list[tuple[str, object, object]] = []
    for role, signal in roles.items():
        if not isinstance(signal.get("message"), str):
            continue
        # A switch may look at another's signal for other values (a gear lever's R, its D).
        values = str(signal.get("on_values")) if role in SWITCHES else None
        source = (signal.get("message"), str(signal.get("signal") or signal.get("signals")), values)
        channel = signal.get("channel")
        for other, other_source, other_channel in taken:
            if source == other_source and (channel is None or other_channel in {None, channel}):
                name = signal.get("signal") if isinstance(signal.get("signal"), str) else "the sum"
                yield (
                    ("signals", role),
                    f"is the same signal as {other} ({source[0]}.{name}); expected a source of its own",
                )
                break
        taken.append((role, source, channel))


def _one_signal(role: str, signal: Mapping[str, Any]) -> Found:
    loc = ("signals", role)
    # A key without a value says no more than no key.
    signal = {key: value for key, value in signal.items() if value is not None}
    if ("signal" in signal) == ("signals" in signal):
        given = "both signal and signals are given" if "signal" in signal else "signal is missing"
        yield loc, f"{given}; expected signal: NAME, or signals: a list to be summed"
    if "signals" in signal and signal["signals"] in ([], ()):
        yield (*loc, "signals"), "is an empty list; expected the signals to be summed"
    if ("valid_signal" in signal) != ("valid_values" in signal):
        given, needed = (
            ("valid_signal", "valid_values") if "valid_signal" in signal else ("valid_values", "valid_signal")
        )
        yield (*loc, given), f"is given without {needed}; expected both or neither"
    analog: list[str] = [key for key in ("volts_per_count", "volts_per_unit") if key in signal]
    if len(analog) == 1 or ("null_volts" in signal and not analog):
        yield (
            (*loc, *(analog or ["null_volts"])),
            "is only a part of an ADC's scale; expected volts_per_count and volts_per_unit "
            "(and null_volts, if it is not 0)",
        )


def _channels(roles: Mapping[str, Mapping[str, Any]], bus: Mapping[str, Any]) -> Found:
    for role, signal in roles.items():
        channel = signal.get("channel")
        if bus and isinstance(channel, str) and channel not in bus:
            yield (
                ("signals", role, "channel"),
                f"{channel!r} is not a bus; expected {' or '.join(bus)}{did_you_mean(channel, bus)}",
            )


def _output(output: Mapping[str, Any], bus: Mapping[str, Any]) -> Found:
    name, names = output.get("bus"), list(bus) or ["can0"]
    if isinstance(name, str) and name not in names:
        yield ("output", "bus"), f"{name!r} is not a bus; expected {' or '.join(names)}{did_you_mean(name, names)}"
    # Sixteen ids are set aside for the messages of dbc/dsz.dbc.
    bits, most, remedy = (29, 0x1FFFFFF0, "") if output.get("extended") else (11, 0x7F0, ", or extended: true")
    for key in ("base_id", "spare_base_id"):
        base = output.get(key)
        if isinstance(base, int) and most < base <= 0x1FFFFFFF:
            yield ("output", key), f"0x{base:X} is too high for {bits}-bit ids; expected 0 to 0x{most:X}{remedy}"


def _tolerances(tolerance: Mapping[str, Any]) -> Found:
    known = [name for name in VehicleSettings.model_fields if name != "driven_axle"]
    for name in tolerance:
        if name not in known:
            hint = did_you_mean(name, known) or "; expected a number of the vehicle section"
            noun = "vehicle parameter" if unit_in_name(name)[1] else "parameter"
            yield ("diagnose", "tolerance", name), f"unknown {noun} {name!r}{hint}"
