"""The `watch` section: when a sensor's values are taken for a spike, or the sensor for frozen.

All limits are chosen from recordings of real cars; each comment says what was seen there.
"""

from __future__ import annotations

import math

from dsz_daemon.config.sections import Number, Section, Whole, bounded
from dsz_daemon.pipeline.sensor_watch import WatchLimits


class WatchSettings(Section):
    """Limits of the watch over IMU and wheels."""

    # About three times the largest step between two samples: 0.36 rad/s and 9.5 m/s^2, both of a phone on a
    # dashboard (104 Hz); the cars' own IMUs stay below 0.02 and 5.1.
    gyro_jump_degps: Number = bounded(
        1, 2000, "a gyro sample further than this from the one before and the one after it is a spike", 57.3
    )
    accel_jump_mps2: Number = bounded(1, 320, "the same for accelerometers", 30.0)
    # Three times the longest that a working sensor repeated itself while the wheels' speed changed: 0.97 s (a
    # yaw rate in steps of 0.24 deg/s) and 0.31 s (accelerations at 10 Hz).
    gyro_patience_s: Number = bounded(
        0.1, 600, "a gyro that repeats itself for longer while the wheels' speed changes is frozen", 3.0
    )
    accel_patience_s: Number = bounded(0.1, 600, "the same for accelerometers", 1.0)
    # Twelve times the longest that all four wheels repeated themselves above a walk, were they read in steps of
    # wheel_step_mps: 0.08 s (13 m/s, three cars); in their own, finer steps it was 0.03 s.
    wheel_patience_s: Number = bounded(
        0.1, 600, "wheels that all repeat themselves for longer while driving are frozen", 1.0
    )
    # In steps of 0.1 m/s steady wheels repeat themselves for 2 s and in such of 1 km/h for 8 s: no sign of a fault.
    wheel_step_mps: Number = bounded(0, 1, "wheel speeds in coarser steps than this are not judged so", 0.03)
    # Below a quick walk pulses come seldom: 0.16 s of the same were seen at 1.8 m/s.
    wheel_speed_mps: Number = bounded(0.1, 60, "at least this fast for wheels to be judged", 3.0)
    # A coarser sensor has shown that by its own longest repeat: the same factor is allowed on that.
    patience_factor: Number = bounded(1, 100, "how many times its own longest repeat a sensor is allowed", 3.0)
    # Wheel speeds of a car that drives change within 0.44 s; a car at rest shakes no sensor.
    wheels_change_within_s: Number = bounded(
        0.05, 60, "the car counts as moving for so long after a wheel's change", 0.5
    )
    # What was never seen alive can't be told from a very coarse sensor: the summary speaks of that.
    alive_changes: Whole = bounded(1, 100000, "changes of its value that show a sensor to be alive", 20)

    def limits(self) -> WatchLimits:
        """In SI and nanoseconds."""
        return WatchLimits(
            gyro_jump_radps=math.radians(self.gyro_jump_degps),
            accel_jump_mps2=self.accel_jump_mps2,
            gyro_patience_ns=round(self.gyro_patience_s * 1e9),
            accel_patience_ns=round(self.accel_patience_s * 1e9),
            wheel_patience_ns=round(self.wheel_patience_s * 1e9),
            wheel_step_mps=self.wheel_step_mps,
            wheel_speed_mps=self.wheel_speed_mps,
            patience_factor=self.patience_factor,
            wheels_change_ns=round(self.wheels_change_within_s * 1e9),
            alive_changes=self.alive_changes,
        )
