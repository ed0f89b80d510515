"""One wheel with its tyre: slip that builds up over a distance, force that saturates.

Force: the Magic Formula with similarity for combined slip (H. B. Pacejka, Tyre and Vehicle
Dynamics, ch. 4): both slips, scaled by their stiffness, share one curve and one grip limit.
Slip: the stretched string with a relaxation length (ch. 7), which also stays well behaved at
standstill, where slip over speed would not be defined; there it is a spring, so it needs the
damping that the same chapter adds below a few m/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from dsz_daemon.compiled import compiled
from dsz_daemon.sim.car import Car

# Chosen: speed below which the string is damped; above it, rolling itself damps.
DAMPED_BELOW_MPS = 3.0
# Chosen: rolling resistance turns round smoothly within this wheel speed; at 0.3 m/s it is
# below what any wheel speed sensor resolves.
REVERSAL_RADPS = 1.0
# Chosen: a brake grips fully after so much turning, 7 mm of way: pads, caliper and sidewall.
BRAKE_WINDUP_RAD = 0.02
# Chosen: what winds up swings out in about a second, as after the jerk of a stop.
BRAKE_DAMPING_S = 0.03
# Neither slip nor brake follow faster than this, however fast the wheel turns: two steps of 1 kHz.
FASTEST_S = 0.002
# Chosen: of a car whose wheels are said not to slip, drive and brakes give way from a slip on that a linear tyre would
# need for the grip there is, and have let go at so many times that. Else a wheel turns up without end, unseen, and
# kicks the car where grip begins.
LETS_GO = 2.0


class Tyre(NamedTuple):
    """Constants of one wheel, taken from the car once so that the inner loop need not."""

    radius_m: float
    inertia_kgm2: float
    slip_stiffness_n: float
    cornering_stiffness_n_per_rad: float
    static_load_n: float
    friction: float
    shape: float
    load_sensitivity: float
    load_degression: float
    longitudinal_relaxation_m: float
    lateral_relaxation_m: float
    longitudinal_damping_s_per_m: float
    lateral_damping_s_per_m: float
    rolling_resistance: float
    spins: bool


def tyres(car: Car) -> tuple[Tyre, Tyre]:
    """Return a front and a rear tyre of the car.

    Damping at standstill: 0.5 of critical for the wheel on its longitudinal spring, and for a
    quarter of the car on its lateral one.
    """

    def tyre(radius_m: float, slip_stiffness_n: float, stiffness_n_per_rad: float, load_n: float) -> Tyre:
        spring_n_per_m = slip_stiffness_n / car.longitudinal_relaxation_m
        wheel_kg = car.wheel_inertia_kgm2 / radius_m**2
        lateral_spring_n_per_m = stiffness_n_per_rad / car.lateral_relaxation_m
        return Tyre(
            radius_m,
            car.wheel_inertia_kgm2,
            slip_stiffness_n,
            stiffness_n_per_rad,
            load_n,
            car.friction,
            car.shape,
            car.load_sensitivity,
            car.load_degression,
            car.longitudinal_relaxation_m,
            car.lateral_relaxation_m,
            math.sqrt(spring_n_per_m * wheel_kg) / slip_stiffness_n,
            math.sqrt(lateral_spring_n_per_m * car.mass_kg / 4.0) / stiffness_n_per_rad,
            car.rolling_resistance,
            car.slips,
        )

    return (
        tyre(
            car.front_wheel_radius_m,
            car.front_slip_stiffness_n,
            car.front_cornering_stiffness_n_per_rad,
            car.front_static_load_n,
        ),
        tyre(
            car.rear_wheel_radius_m,
            car.rear_slip_stiffness_n,
            car.rear_cornering_stiffness_n_per_rad,
            car.rear_static_load_n,
        ),
    )


@compiled
def tyre_force(
    tyre: Tyre, longitudinal_slip: float, lateral_slip: float, load_n: float, friction_limit: float = math.inf
) -> tuple[float, float]:
    """Return the force (forward, left) in the wheel's axes, N.

    `friction_limit` is the surface's, where that is less than the tyre's own friction.
    `lateral_slip` is minus the tangent of the slip angle: positive slips make positive forces.
    """
    if load_n <= 0.0:
        return 0.0, 0.0
    ratio = load_n / tyre.static_load_n
    stiffening = 1.0 + tyre.load_sensitivity * (ratio * (1.0 - tyre.load_degression * (ratio - 1.0)) - 1.0)
    force_x = tyre.slip_stiffness_n * stiffening * longitudinal_slip
    force_y = tyre.cornering_stiffness_n_per_rad * stiffening * lateral_slip
    demand = math.sqrt(force_x * force_x + force_y * force_y) / (min(tyre.friction, friction_limit) * load_n)
    if demand < 1e-6:
        return force_x, force_y
    # Slope 1 at zero and peak 1: B C = 1 and D = 1 of the formula in this scaling.
    share = math.sin(tyre.shape * math.atan(demand / tyre.shape)) / demand
    return force_x * share, force_y * share


@compiled
def _let_through(tyre: Tyre, slip: float, load_n: float, friction_limit: float) -> float:
    """The share of a torque that is left to it at so much slip its way."""
    grip_n = min(tyre.friction, friction_limit) * load_n
    return min(max((LETS_GO * grip_n - tyre.slip_stiffness_n * slip) / ((LETS_GO - 1.0) * max(grip_n, 1.0)), 0.0), 1.0)


@compiled
def wheel(
    tyre: Tyre,
    forward_mps: float,
    left_mps: float,
    state: tuple[float, float, float, float],
    load_n: float,
    drive_nm: float,
    brake_nm: float,
    friction_limit: float,
) -> tuple[float, float, tuple[float, float, float, float], float]:
    """Return force forward and left (N), the rates of the wheel's state, and the shaft torque.

    All in the wheel's own axes; `forward_mps`, `left_mps` are the speed of its contact point,
    as carried along by the car. The torque (Nm) is what body and wheel exert on each other.
    The brake winds up like Dahl's friction (P. R. Dahl, 1968): a damped spring that gives way at the pads' torque.
    """
    spin_radps, longitudinal_slip, lateral_slip, windup = state
    creep_mps = spin_radps * tyre.radius_m - forward_mps
    speed_mps = abs(forward_mps)
    kappa, slip = longitudinal_slip, lateral_slip
    if speed_mps < DAMPED_BELOW_MPS:
        fading = 0.5 * (1.0 + math.cos(math.pi * speed_mps / DAMPED_BELOW_MPS))
        kappa += fading * tyre.longitudinal_damping_s_per_m * creep_mps
        slip -= fading * tyre.lateral_damping_s_per_m * left_mps
    force_x, force_y = tyre_force(tyre, kappa, slip, load_n, friction_limit)
    winding_rad = max(BRAKE_WINDUP_RAD, abs(spin_radps) * FASTEST_S)
    windup_per_s = (spin_radps - abs(spin_radps) * windup) / winding_rad
    if not tyre.spins:
        drive_nm *= _let_through(tyre, longitudinal_slip, load_n, friction_limit)
        brake_nm *= _let_through(tyre, -longitudinal_slip, load_n, friction_limit)
    shaft_nm = drive_nm - brake_nm * (windup + BRAKE_DAMPING_S * windup_per_s)
    resistance_nm = tyre.rolling_resistance * load_n * tyre.radius_m * math.tanh(spin_radps / REVERSAL_RADPS)
    along_m = max(tyre.longitudinal_relaxation_m, speed_mps * FASTEST_S)
    across_m = max(tyre.lateral_relaxation_m, speed_mps * FASTEST_S)
    rates = (
        (shaft_nm - resistance_nm - tyre.radius_m * force_x) / tyre.inertia_kgm2,
        (creep_mps - speed_mps * longitudinal_slip) / along_m,
        (-left_mps - speed_mps * lateral_slip) / across_m,
        windup_per_s,
    )
    return force_x, force_y, rates, shaft_nm
