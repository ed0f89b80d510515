"""What a valid configuration costs or risks: warnings (likely mistakes) and notes (what to know)."""

from __future__ import annotations

from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.config.settings import Settings
from dsz_daemon.config.vehicle import VehicleSettings
from dsz_daemon.signals import ACCEL_CHANNELS, IMU_CHANNELS, WHEEL_SPEEDS


def warnings_of(settings: Settings) -> list[str]:
    """What is most likely not meant."""
    return [*_some_wheels(settings), *_inertia(settings.vehicle), *_interfaces(settings)]


def _some_wheels(settings: Settings) -> list[str]:
    """Wheel speeds of a part of the wheels: what that costs."""
    missing = [role[-2:] for role in WHEEL_SPEEDS if role not in settings.signals.roles]
    if not missing or len(missing) == len(WHEEL_SPEEDS):
        return []
    present = [role[-2:] for role in WHEEL_SPEEDS if role[-2:] not in missing]
    driven = {"front": "f", "rear": "r", "all": "fr"}[settings.vehicle.driven_axle]
    if all(wheel[0] in driven for wheel in present):
        cost = "the speed rests on driven wheels alone and is off whenever they slip under power"
    else:
        cost = "a slipping wheel can't be told from the others as well, least of all when braking"
    return [f"no wheel speed of {', '.join(missing)}: {cost}"]


def _inertia(vehicle: VehicleSettings) -> list[str]:
    # Iz is within some 20 % of m lf lr for cars (dynamic index); a factor of 2.5 is a slip of a digit.
    usual = vehicle.mass_kg * vehicle.cg_to_front_axle_m * vehicle.cg_to_rear_axle_m
    if usual / 2.5 <= vehicle.yaw_inertia_kgm2 <= usual * 2.5:
        return []
    return [
        f"vehicle.yaw_inertia_kgm2: {vehicle.yaw_inertia_kgm2:g} is unusual for this mass and wheelbase; "
        f"most cars have about mass * cg_to_front * cg_to_rear = {usual:.0f}"
    ]


def _interfaces(settings: Settings) -> list[str]:
    """An interface may come with a plugin that only the vehicle has: no fault, but most likely a slip."""
    others = {name: bus for name, bus in settings.bus.items() if bus.interface != "socketcan"}
    if not others:
        return []
    # Half a second, where whatever it reads logs with is installed.
    from can import VALID_INTERFACES

    return [
        f"bus.{name}.interface: {bus.interface!r} is not known to python-can here"
        f"{did_you_mean(bus.interface, VALID_INTERFACES)}"
        for name, bus in others.items()
        if bus.interface not in VALID_INTERFACES
    ]


def notes_of(settings: Settings) -> list[str]:
    """What can't be done, and what is assumed, with this configuration."""
    return [*_missing_roles(settings), *_assumed(settings), *_buses(settings)]


def _missing_roles(settings: Settings) -> list[str]:
    roles = settings.signals.roles
    notes = []
    if not any(wheel in roles for wheel in WHEEL_SPEEDS):
        accels = [channel for channel in ACCEL_CHANNELS if channel in roles]
        held = f": offsets of {', '.join(accels)} can't be learnt" if accels else ""
        notes.append(f"no wheel speeds, so no reference speed and no standstill{held}")
    if "steering_wheel_angle" not in roles and "road_wheel_angle" not in roles:
        notes.append("no steering angle: straight-ahead driving is judged without it, and there is no observer")
    if "gyro_z" not in roles:
        notes.append("no gyro_z: the yaw rate is taken from wheels or steering, which is coarser")
    if "brake" not in roles:
        notes.append("no brake signal: braking is told from deceleration, which is later")
    others = [c for c in IMU_CHANNELS if c not in roles and c != "gyro_z"]
    if others:
        notes.append(f"not mapped, so not zeroed: {', '.join(others)}")
    return notes


def _assumed(settings: Settings) -> list[str]:
    vehicle, roles = settings.vehicle, settings.signals.roles
    if not any(wheel in roles for wheel in WHEEL_SPEEDS):
        return []
    keys = ("driven_axle", "front_track_m", "rear_track_m")
    return [
        f"vehicle.{key} is not given: {getattr(vehicle, key)} is assumed"
        for key in keys
        if key not in vehicle.model_fields_set
    ]


def _buses(settings: Settings) -> list[str]:
    """Channels that no bus is named after: fine for a log, not for `dsz run`."""
    named = dict.fromkeys(s.channel for s in settings.signals.roles.values() if s.channel)
    unknown = [channel for channel in named if channel not in settings.buses]
    if not unknown:
        return []
    return [f"no bus for channel {', '.join(unknown)}: enough for a log; dsz run needs it (bus: or --bus)"]
