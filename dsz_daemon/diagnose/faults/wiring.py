"""How the sensors of an IMU arrive: which on whose plug, which way round, in which unit; and a mistake in that."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.pipeline.grid import Signal
from dsz_daemon.signals import IMU_CHANNELS, STANDARD_GRAVITY_MPS2

Floats = np.ndarray[Any, np.dtype[np.float64]]

G = STANDARD_GRAVITY_MPS2
# Of gyros (0) and accelerometers (1): what a reading is multiplied by if another unit is sent than the mapping says.
UNITS: tuple[Mapping[str, float], Mapping[str, float]] = (
    {"rad_for_deg": math.pi / 180.0, "deg_for_rad": 180.0 / math.pi},
    {"mps2_for_g": G, "g_for_mps2": 1.0 / G},
)
KINDS = ("reversed", *(f"swapped_with_{axis}" for axis in "xyz"), *UNITS[0], *UNITS[1])


class AxisFault(NamedTuple):
    """One fault: of which channel, one of `KINDS`, the log likelihood gained by it, and figures in words.

    "reversed" is said of the sensor (after swapped plugs are put right), a unit of the plug as it is.
    """

    channel: str
    kind: str
    gain: float
    evidence: str


class Wiring(NamedTuple):
    """How six sensors arrive: channel i shows factors[i] * facing[plugs[i]] * (sensor plugs[i])."""

    plugs: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    facing: tuple[float, ...] = (1.0,) * 6
    factors: tuple[float, ...] = (1.0,) * 6

    def mended(self, imu: Floats) -> Floats:
        """Channels (n, 6) as they arrive -> as if wired right."""
        right = np.empty_like(imu)
        for channel, sensor in enumerate(self.plugs):
            right[:, sensor] = imu[:, channel] * (self.facing[sensor] / self.factors[channel])
        return right

    def faulty(self, imu: Floats) -> Floats:
        """Channels (n, 6) as if wired right -> as they arrive: what undoes `mended`."""
        arrives = np.empty_like(imu)
        for channel, sensor in enumerate(self.plugs):
            arrives[:, channel] = imu[:, sensor] * (self.facing[sensor] * self.factors[channel])
        return arrives

    def mended_signals(self, signals: Mapping[str, Signal]) -> dict[str, Signal]:
        """All samples by role, those of the IMU as if wired right; other roles as they are."""
        right = {role: signal for role, signal in signals.items() if role not in IMU_CHANNELS}
        for channel, sensor in enumerate(self.plugs):
            if IMU_CHANNELS[channel] in signals:
                signal = signals[IMU_CHANNELS[channel]]
                factor = self.facing[sensor] / self.factors[channel]
                right[IMU_CHANNELS[sensor]] = signal._replace(values=signal.values * factor)
        return right


def wiring_of(faults: Sequence[AxisFault]) -> Wiring:
    """The wiring with these faults in it; swapped plugs in the order given."""
    plugs, facing, factors = (list(values) for values in Wiring())
    for fault in faults:
        channel = IMU_CHANNELS.index(fault.channel)
        triad = channel // 3
        if fault.kind == "reversed":
            facing[channel] = -facing[channel]
        elif fault.kind in UNITS[triad]:
            factors[channel] *= UNITS[triad][fault.kind]
        else:
            other = 3 * triad + "xyz".index(fault.kind[-1])
            plugs[channel], plugs[other] = plugs[other], plugs[channel]
    return Wiring(tuple(int(plug) for plug in plugs), tuple(facing), tuple(factors))


def mended(imu: Floats, faults: Sequence[AxisFault]) -> Floats:
    """The IMU's channels (n, 6) as if wired right."""
    return wiring_of(faults).mended(imu)
