"""The simulated car beside a third party's: CommonRoad's multi-body model (29 states, other equations).

    python tests/unit/commonroad_car.py

M. Althoff, G. Wuersching, "CommonRoad: Vehicle Models", 2020; its vehicle 2 (BMW 320i). The simulated car gets that
car's mass, axles, inertias, springs in series with the tyres' and the slope and peak of its tyres. What can't be had
stays different, and is said in docs/results.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from dsz_daemon.sim.car import TUCSON, Car
from dsz_daemon.sim.road import FLAT
from dsz_daemon.sim.vehicle import Inputs, TwoTrackCar, rolling

Array = NDArray[np.float64]
G, DT_S = 9.81, 0.001


@dataclass(frozen=True)
class Manoeuvre:
    """A steering angle over time at the front wheels, and a speed to begin with; nobody touches the pedals."""

    name: str
    speed_mps: float
    duration_s: float
    angle_rad: Callable[[float], float]


def sine(speed_mps: float, amplitude_rad: float, frequency_hz: float) -> Manoeuvre:
    """Whole sines of the road wheels."""
    name = f"sine {math.degrees(amplitude_rad):.1f} deg, {frequency_hz:g} Hz, {speed_mps:g} m/s"
    return Manoeuvre(name, speed_mps, 4.0, lambda t: amplitude_rad * math.sin(2.0 * math.pi * frequency_hz * t))


def ramp(speed_mps: float, end_rad: float) -> Manoeuvre:
    """Half a second's ramp to an angle, then held."""
    name = f"ramp to {math.degrees(end_rad):.1f} deg, {speed_mps:g} m/s"
    return Manoeuvre(name, speed_mps, 4.0, lambda t: end_rad * min(1.0, 2.0 * t))


MANOEUVRES = (
    sine(15.0, 0.01, 0.5), sine(15.0, 0.04, 0.5), sine(25.0, 0.01, 0.5), sine(25.0, 0.01, 1.0),
    ramp(10.0, 0.05), ramp(20.0, 0.02),
)  # fmt: skip


def like(p: Any) -> Car:
    """The simulated car with the other's parameters; its C.G. so high that all of it leans like their sprung mass."""

    def in_series(a: float, b: float) -> float:
        return a * b / (a + b)

    def axle(spring: float, bar: float, track_m: float) -> tuple[float, float]:
        """Wheel rate, and what is missing to the axle's stiffness in roll: springs and bar, then the tyres."""
        roll = in_series(spring * track_m**2 / 2.0 + abs(bar), p.K_zt * track_m**2 / 2.0)
        rate = in_series(spring, p.K_zt)
        return rate, roll - rate * track_m**2 / 2.0

    front, front_bar = axle(p.K_sf, p.K_tsf, p.T_f)
    rear, rear_bar = axle(p.K_sr, p.K_tsr, p.T_r)
    stiffness = abs(p.tire.p_ky1) * p.m * G / (2.0 * (p.a + p.b))
    return replace(
        TUCSON,
        mass_kg=p.m, cg_to_front_axle_m=p.a, cg_to_rear_axle_m=p.b, front_track_m=p.T_f, rear_track_m=p.T_r,
        cg_height_m=p.m_s * p.h_s / p.m,
        yaw_inertia_kgm2=p.I_z, roll_inertia_kgm2=p.I_Phi_s, pitch_inertia_kgm2=p.I_y_s,
        front_spring_n_per_m=front, rear_spring_n_per_m=rear, front_damper_ns_per_m=p.K_sdf,
        rear_damper_ns_per_m=p.K_sdr, front_bar_nm_per_rad=front_bar, rear_bar_nm_per_rad=rear_bar,
        front_cornering_stiffness_n_per_rad=stiffness * p.b, rear_cornering_stiffness_n_per_rad=stiffness * p.a,
        front_slip_stiffness_n=p.tire.p_kx1 * p.m * G / 4.0,
        rear_slip_stiffness_n=p.tire.p_kx1 * p.m * G / 4.0, friction=abs(p.tire.p_dy1), shape=p.tire.p_cy1,
        load_degression=0.0, lateral_relaxation_m=0.02, front_wheel_radius_m=p.R_w, rear_wheel_radius_m=p.R_w,
        wheel_inertia_kgm2=p.I_y_w, rolling_resistance=0.0, drag_area_m2=0.0,
    )  # fmt: skip


def theirs(p: Any, manoeuvre: Manoeuvre) -> dict[str, Array]:
    """Yaw rate, lateral acceleration (of all three masses), roll and speed of the third party's car."""
    x = np.array(init_mb([0.0, 0.0, manoeuvre.angle_rad(0.0), manoeuvre.speed_mps, 0.0, 0.0, 0.0], p))

    def rates(t_s: float, state: Array) -> Array:
        state = state.copy()
        state[2] = manoeuvre.angle_rad(t_s)
        return np.array(vehicle_dynamics_mb(list(state), [0.0, 0.0], p))

    rows = []
    for i in range(round(manoeuvre.duration_s / DT_S)):
        t_s = i * DT_S
        k1 = rates(t_s, x)
        aside = p.m_s * k1[10] + p.m_uf * k1[15] + p.m_ur * k1[20]
        # Its z points down, and its roll goes with that.
        rows.append((x[5], aside / p.m + x[5] * x[3], -x[6], x[3]))
        k2 = rates(t_s + DT_S / 2, x + DT_S / 2 * k1)
        k3 = rates(t_s + DT_S / 2, x + DT_S / 2 * k2)
        k4 = rates(t_s + DT_S, x + DT_S * k3)
        x = x + DT_S / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return dict(zip(("yaw_rate", "ay", "roll", "speed"), np.array(rows).T, strict=True))


def ours(car: Car, manoeuvre: Manoeuvre) -> dict[str, Array]:
    """The same of the simulated car."""
    vehicle, state = TwoTrackCar(car, FLAT), rolling(car, manoeuvre.speed_mps)
    rows = []
    for i in range(round(manoeuvre.duration_s / DT_S)):
        now, halfway, then = (Inputs(manoeuvre.angle_rad((i + part) * DT_S)) for part in (0.0, 0.5, 1.0))
        motion = vehicle.motion(state, now)
        along = motion.pose.along_mps
        rows.append((state.yaw_rate_radps, motion.rates.left_mps + state.yaw_rate_radps * along, state.roll_rad, along))
        state = vehicle.next_state(state, motion, halfway, then, DT_S)
    return dict(zip(("yaw_rate", "ay", "roll", "speed"), np.array(rows).T, strict=True))


def compared(manoeuvre: Manoeuvre, stiffer: float = 1.0) -> dict[str, tuple[float, float]]:
    """Largest value of theirs, and RMS of the difference over RMS of theirs, by quantity.

    `stiffer`: springs and bars of both, by this factor, dampers by its root.
    """
    p = parameters_vehicle2()
    for name in ("K_sf", "K_sr", "K_tsf", "K_tsr", "K_sdf", "K_sdr", "K_zt"):
        setattr(p, name, getattr(p, name) * (math.sqrt(stiffer) if name.startswith("K_sd") else stiffer))
    a, b = theirs(p, manoeuvre), ours(like(p), manoeuvre)
    return {
        name: (float(np.abs(a[name]).max()), float(np.sqrt(np.mean((a[name] - b[name]) ** 2) / np.mean(a[name] ** 2))))
        for name in a
    }


def main() -> None:
    """A table, as Markdown."""
    print("| manoeuvre | a_y to, m/s^2 | yaw rate apart | a_y apart | roll apart | a_y apart, springs x 30 |")
    print("|---" * 6 + "|")
    for manoeuvre in MANOEUVRES:
        found, stiff = compared(manoeuvre), compared(manoeuvre, 30.0)
        shares = " | ".join(f"{100 * found[name][1]:.1f} %" for name in ("yaw_rate", "ay", "roll"))
        print(f"| {manoeuvre.name} | {found['ay'][0]:.2f} | {shares} | {100 * stiff['ay'][1]:.1f} % |")


if __name__ == "__main__":
    main()
