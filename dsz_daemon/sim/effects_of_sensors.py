"""Effects between the true motion and the bus: where the IMU sits, what sensors get wrong, what comes late.

Each function puts one row of `effects.py` into a world. A parameter that isn't among the values stays as it is there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS
from dsz_daemon.sim.sensors import ACCELS, GYROS, Angles, CrossAxis, WarmUp, Wiring
from dsz_daemon.sim.world import World

Values = Mapping[str, float]
PutInto = Callable[[World, Values], World]

CHANNELS = (*GYRO_CHANNELS, *ACCEL_CHANNELS)
LEAKS = CrossAxis._fields
NINE = tuple(first + second for first in "xyz" for second in "xyz")

# Of a channel: turned round, on another's plug, or sending another unit than the reader reckons with.
_UNITS = {
    "rad_for_deg": (0, GYROS.unit),
    "deg_for_rad": (0, 1.0 / GYROS.unit),
    "mps2_for_g": (1, ACCELS.unit),
    "g_for_mps2": (1, 1.0 / ACCELS.unit),
}
KINDS = ("reversed", "swapped_with_x", "swapped_with_y", "swapped_with_z", *_UNITS)


def given(v: Values, names: Sequence[str], now: Sequence[float]) -> tuple[float, ...]:
    """Return the values of these parameters; of one that isn't given, what it is now."""
    return tuple(v.get(name, value) for name, value in zip(names, now, strict=True))


def _errors(world: World, **changes: object) -> World:
    return replace(world, errors=replace(world.errors, **changes))  # type: ignore[arg-type]


def lever_arm(world: World, v: Values) -> World:
    """The IMU at another place; from the C.G. of the car before any load is added."""
    car = world.car
    x_m, y_m, z_m = given(v, ("x_m", "y_m", "z_m"), (car.imu_x_m, car.imu_y_m, car.imu_z_m))
    return replace(world, car=replace(car, imu_x_m=x_m, imu_y_m=y_m, imu_z_m=z_m))


def misalignment(world: World, v: Values) -> World:
    """All six sensors turned against the car."""
    return _errors(world, imu_misalignment=Angles(*given(v, Angles._fields, world.errors.imu_misalignment)))


def scale(field: str) -> PutInto:
    """Return what sets a triad's sensitivity errors."""
    return lambda world, v: _errors(world, **{field: given(v, "xyz", getattr(world.errors, field))})


def cross_axis(field: str) -> PutInto:
    """Return what sets a triad's leaks."""
    return lambda world, v: _errors(world, **{field: CrossAxis(*given(v, LEAKS, getattr(world.errors, field)))})


def g_sensitivity(world: World, v: Values) -> World:
    """What the gyros show of accelerations."""
    rows = zip("xyz", world.errors.gyro_g_sensitivity, strict=True)
    return _errors(world, gyro_g_sensitivity=tuple(given(v, [gyro + a for a in "xyz"], row) for gyro, row in rows))


def axis_fault(world: World, v: Values) -> World:
    """One fault of one channel's axis; see `sensors.Wiring` for what goes with it."""
    channel, kind = round(v["channel"]), KINDS[round(v["kind"])]
    axis, field = channel % 3, "gyro_wiring" if channel < 3 else "accel_wiring"
    wiring: Wiring = getattr(world.errors, field)
    facing, plugs, factors = list(wiring.facing), list(wiring.plugs), list(wiring.factors)
    if kind == "reversed":
        facing[axis] = -facing[axis]
    elif kind in _UNITS:
        factors[axis] *= _UNITS[kind][1]
    else:
        other = "xyz".index(kind[-1])
        plugs[axis], plugs[other] = plugs[other], plugs[axis]
    return _errors(world, **{field: Wiring(*map(tuple, (facing, plugs, factors)))})  # type: ignore[arg-type]


def axis_fault_wrong(v: Values) -> str:
    """What can't be of an axis fault; nothing where it can."""
    channel, kind = round(v["channel"]), KINDS[round(v["kind"])]
    name = CHANNELS[channel]
    if kind == f"swapped_with_{name[-1]}":
        return f"{name} can't be swapped with itself; expected another axis"
    if kind in _UNITS and _UNITS[kind][0] != channel // 3:
        fits = [unit for unit, (triad, _) in _UNITS.items() if triad == channel // 3]
        return f"{kind} is no unit of {name}; expected {' or '.join(fits)}"
    return ""


def drift(world: World, v: Values) -> World:
    """Null errors that move with time, and with the temperature of an IMU that warms up."""
    errors = world.errors

    def rates(ending: str, gyro: Sequence[float], accel: Sequence[float]) -> tuple[float, ...]:
        return given(v, [f"{channel}_{ending}" for channel in CHANNELS], (*gyro, *accel))

    per_s = rates("per_s", errors.gyro_drift_radps_per_s, errors.accel_drift_mps2_per_s)
    per_k = rates("per_k", errors.gyro_drift_radps_per_k, errors.accel_drift_mps2_per_k)
    return _errors(
        world,
        gyro_drift_radps_per_s=per_s[:3],
        accel_drift_mps2_per_s=per_s[3:],
        gyro_drift_radps_per_k=per_k[:3],
        accel_drift_mps2_per_k=per_k[3:],
        warm_up=WarmUp(*given(v, WarmUp._fields, errors.warm_up)),
    )


def sensor(**fields: str) -> PutInto:
    """Return what sets fields of the sensors to parameters."""
    return lambda world, v: _errors(world, **{field: v[name] for field, name in fields.items() if name in v})
