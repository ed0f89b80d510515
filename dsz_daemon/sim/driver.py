"""The driver: follows a speed profile with the pedals and a steering program with the wheel.

Both are sums of smooth pieces over time, so that a scenario is a short table. The driver sees
the true speed and knows the car's weight; nothing is measured or estimated here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dsz_daemon.signals import STANDARD_GRAVITY_MPS2
from dsz_daemon.sim.car import Car
from dsz_daemon.sim.vehicle import AIR_KG_PER_M3, Inputs

# Chosen: closes a speed error within about a second, as a calm driver does.
SPEED_GAIN_PER_S = 1.0
# Chosen: each wheel is held by this much at a stop, as by a lightly pressed pedal, fading in
# over the last 0.5 m/s. For level ground: brakes that turn round smoothly creep on a slope.
HOLD_NM = 300.0
HOLD_BELOW_MPS = 0.5


@dataclass(frozen=True, slots=True)
class SpeedChange:
    """One change of the wanted speed, S-shaped between two times."""

    start_s: float
    end_s: float
    change_mps: float

    def wanted(self, t_s: float) -> tuple[float, float]:
        """Return its share of the wanted speed (m/s) and acceleration (m/s^2)."""
        duration_s = self.end_s - self.start_s
        x = (t_s - self.start_s) / duration_s
        if x <= 0.0:
            return 0.0, 0.0
        if x >= 1.0:
            return self.change_mps, 0.0
        return self.change_mps * x * x * (3.0 - 2.0 * x), self.change_mps * 6.0 * x * (1.0 - x) / duration_s


@dataclass(frozen=True, slots=True)
class SineSteer:
    """Whole periods of a sine at the steering wheel; positive amplitude begins to the left."""

    start_s: float
    frequency_hz: float
    periods: int
    amplitude_rad: float

    def angle_rad(self, t_s: float) -> float:
        """Return the steering wheel angle."""
        phase = (t_s - self.start_s) * self.frequency_hz
        if not 0.0 < phase < self.periods:
            return 0.0
        return self.amplitude_rad * math.sin(2.0 * math.pi * phase)


@dataclass(frozen=True, slots=True)
class Programme:
    """What the driver of one scenario does, start to end."""

    duration_s: float
    speed_changes: tuple[SpeedChange, ...]
    steering: tuple[SineSteer, ...] = ()

    def wanted(self, t_s: float) -> tuple[float, float]:
        """Return wanted speed (m/s) and acceleration (m/s^2)."""
        speed_mps = acceleration_mps2 = 0.0
        for change in self.speed_changes:
            speed, acceleration = change.wanted(t_s)
            speed_mps += speed
            acceleration_mps2 += acceleration
        return speed_mps, acceleration_mps2

    def steering_wheel_rad(self, t_s: float) -> float:
        """Return the steering wheel angle."""
        return sum(steer.angle_rad(t_s) for steer in self.steering)


class ProgrammeDriver:
    """A driver who carries out a programme in a car; called with time and speed."""

    def __init__(self, programme: Programme, car: Car) -> None:
        self._programme = programme
        self._ratio = car.steering_ratio
        self._radius_m = car.front_wheel_radius_m
        self._front_share = car.front_brake_share
        spin_kg = 2.0 * car.wheel_inertia_kgm2 * (car.front_wheel_radius_m**-2 + car.rear_wheel_radius_m**-2)
        self._moved_kg = car.mass_kg + spin_kg
        self._rolling_n = car.rolling_resistance * car.mass_kg * STANDARD_GRAVITY_MPS2
        self._drag_kg_per_m = 0.5 * AIR_KG_PER_M3 * car.drag_area_m2

    def __call__(self, t_s: float, speed_mps: float) -> Inputs:
        """Return steering and torques at one time and true speed."""
        wanted_mps, wanted_mps2 = self._programme.wanted(t_s)
        steer_rad = self._programme.steering_wheel_rad(t_s) / self._ratio
        acceleration_mps2 = wanted_mps2 + SPEED_GAIN_PER_S * (wanted_mps - speed_mps)
        force_n = self._moved_kg * acceleration_mps2 + self._drag_kg_per_m * speed_mps * abs(speed_mps)
        force_n += self._rolling_n * math.tanh(speed_mps / HOLD_BELOW_MPS)
        torque_nm = force_n * self._radius_m
        hold_nm = 0.0
        if wanted_mps <= 1e-9:
            hold_nm = HOLD_NM * max(0.0, 1.0 - abs(speed_mps) / HOLD_BELOW_MPS)
            torque_nm = min(torque_nm, 0.0)
        if torque_nm > 0.0:
            return Inputs(steer_rad, front_drive_nm=torque_nm / 2.0)
        return Inputs(
            steer_rad,
            front_brake_nm=hold_nm - self._front_share * torque_nm / 2.0,
            rear_brake_nm=hold_nm - (1.0 - self._front_share) * torque_nm / 2.0,
        )
