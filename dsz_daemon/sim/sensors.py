"""What sensors get wrong: the data sheets' numbers and one car's errors, each off by default.

Gyroscopes ADW22307 and accelerometers ADXL103 are the paper's Tables 1 and 2. Signs are those
of the table of effects: `reading = (1 + scale) x true`, `reading_x += xy x true_y`, and the
IMU's angles turn it against the car (ISO 8855). What is done with these numbers: `imu.py`,
`wheel_sensors.py`, `steering_sensor.py`, `clocks.py`; where they are drawn: `sensor_draws.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsz_daemon.signals import ACCEL_CHANNELS, GYRO_CHANNELS, STANDARD_GRAVITY_MPS2

Counts = NDArray[np.int64]
Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]

VOLTS_PER_COUNT = 7.63e-5  # 5 V over 16 bits
NULL_VOLTS = 2.5  # half the supply: both data sheets' nominal null at 5 V


class Triad(NamedTuple):
    """One kind of sensor, three of them at right angles; `unit` is the data sheet's, in SI."""

    channels: tuple[str, str, str]
    unit: float
    volts_per_unit: float
    range_unit: float
    null_error_unit: float
    noise_per_root_hz: float


GYROS = Triad(GYRO_CHANNELS, math.pi / 180.0, 0.007, 250.0, 3.0, 0.03)  # deg/s; Table 1
ACCELS = Triad(ACCEL_CHANNELS, STANDARD_GRAVITY_MPS2, 1.0, 1.7, 0.025, 110e-6)  # g; Table 2

STEERING_QUANTUM_DEG = 0.1  # of the message; a sensor may be coarser

NONE: Vector3 = (0.0, 0.0, 0.0)


class CrossAxis(NamedTuple):
    """Leaks between axes, as shares: `xy` is what reads on x of the truth on y."""

    xy: float = 0.0
    xz: float = 0.0
    yx: float = 0.0
    yz: float = 0.0
    zx: float = 0.0
    zy: float = 0.0


class Angles(NamedTuple):
    """How an instrument is turned against the car: yaw first, then pitch, then roll."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0


class Wiring(NamedTuple):
    """How a triad's sensors come to their channels.

    `facing`: -1 where a sensor sits the wrong way round: it shows minus what it should, with its own null error,
    noise and leaks. `plugs`: the sensor (0 to 2) that arrives on channel x, y and z: a whole sensor with all that is
    wrong with it, since it is plugs that get swapped. `factors`: what a channel's numbers, null error and noise
    included, are too large by, because their sender reckons in another unit than the reader.
    """

    facing: Vector3 = (1.0, 1.0, 1.0)
    plugs: tuple[int, int, int] = (0, 1, 2)
    factors: Vector3 = (1.0, 1.0, 1.0)


class WarmUp(NamedTuple):
    """Temperature of the IMU: from `start_c` towards `end_c`, as a body that warms up does."""

    start_c: float = 25.0
    end_c: float = 25.0
    time_constant_s: float = 600.0


class UnitClock(NamedTuple):
    """A sender's own clock against the log's: its period is longer by this, its phase later."""

    period_error_ppm: float = 0.0
    phase_s: float = 0.0


class Clocks(NamedTuple):
    """One clock per sender; both messages of the IMU run by the same one."""

    imu: UnitClock = UnitClock()
    steering: UnitClock = UnitClock()
    wheel_speeds: UnitClock = UnitClock()
    pedals: UnitClock = UnitClock()


class PoleRing(NamedTuple):
    """A toothed ring in each wheel: `poles` edges a turn; `starts` is each wheel's, in poles.

    `starts` (front left, front right, rear left, rear right) tells how far it has turned past
    the last edge when the drive begins, 0 to 1. `off_pitches`: how far each wheel's edges are
    from their places, in pitches; empty: a perfect ring.
    """

    poles: int = 48
    starts: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 0.5)
    off_pitches: tuple[tuple[float, ...], ...] = ((), (), (), ())


NO_CROSS_AXIS, STRAIGHT, EVEN_WARM, ON_TIME, AS_MEANT = CrossAxis(), Angles(), WarmUp(), Clocks(), Wiring()


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """One car's sensors, everything that is wrong with them; a default leaves an error out.

    Null errors are those of the first instant: drift and temperature move them from there.
    """

    gyro_offset_radps: Vector3 = NONE
    accel_offset_mps2: Vector3 = NONE
    gyro_scale: Vector3 = NONE
    accel_scale: Vector3 = NONE
    gyro_cross_axis: CrossAxis = NO_CROSS_AXIS
    accel_cross_axis: CrossAxis = NO_CROSS_AXIS
    # The whole IMU in the car, and within it the accelerometers in their housing (Table 2).
    imu_misalignment: Angles = STRAIGHT
    accel_alignment: Angles = STRAIGHT
    gyro_wiring: Wiring = AS_MEANT
    accel_wiring: Wiring = AS_MEANT
    # From the C.G. in body axes; None: where the car has it. The vehicle gives the specific
    # force at this place.
    imu_place_m: Vector3 | None = None
    # Shares of full scale, reached at + full scale: `imu.bent` has the curve.
    gyro_nonlinearity: Vector3 = NONE
    accel_nonlinearity: Vector3 = NONE
    # (rad/s) / (m/s^2); rows are gyros, columns the specific force.
    gyro_g_sensitivity: Matrix3 = (NONE, NONE, NONE)
    # White noise at the data sheet's density, times the gain (a hot gyro: 2); noisy = False
    # leaves out flicker noise as well.
    noisy: bool = True
    gyro_noise_gain: float = 1.0
    accel_noise_gain: float = 1.0
    # Level b of 1/f noise: one-sided power density b^2 / f.
    gyro_flicker_radps: float = 0.0
    accel_flicker_mps2: float = 0.0
    gyro_drift_radps_per_s: Vector3 = NONE
    accel_drift_mps2_per_s: Vector3 = NONE
    gyro_drift_radps_per_k: Vector3 = NONE
    accel_drift_mps2_per_k: Vector3 = NONE
    warm_up: WarmUp = EVEN_WARM
    imu_cutoff_hz: float | None = None
    gyro_limit_radps: float | None = None
    accel_limit_mps2: float | None = None
    converter_bits: int = 16
    imu_delay_s: float = 0.0
    pole_ring: PoleRing | None = None
    wheel_speed_delay_s: float = 0.0
    # At the road wheel, which stands at steering wheel / ratio + offset.
    steering_offset_rad: float = 0.0
    steering_quantum_deg: float = STEERING_QUANTUM_DEG
    steering_delay_s: float = 0.0
    clocks: Clocks = ON_TIME
    # A frame is stamped up to this much after its sample was due: it waits for the bus.
    stamp_jitter_s: float = 0.0

    def offsets_only(self) -> SensorErrors:
        """Return the same null errors and nothing else wrong; noise of the data sheet stays."""
        return SensorErrors(self.gyro_offset_radps, self.accel_offset_mps2, noisy=self.noisy)

    def offsets(self) -> dict[str, float]:
        """Return the null error of each IMU channel at the first instant, SI."""
        values = (*self.gyro_offset_radps, *self.accel_offset_mps2)
        return dict(zip(GYRO_CHANNELS + ACCEL_CHANNELS, values, strict=True))
