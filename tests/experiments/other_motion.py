"""How other cars move: axles or four wheels at 2 ms, a body on springs, a low-pass."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dsz_daemon.compiled import compiled

Floats = np.ndarray[Any, np.dtype[np.float64]]


@compiled
def bent(force: float, most: float, curve: int) -> float:
    """A linear force bent to its limit: by tanh, by a brush's cubic, or by an arc tangent of a sine."""
    if most <= 0.0:
        return force
    x = force / most
    if curve == 0:
        return most * math.tanh(x)
    if curve == 1:
        y = min(abs(x) / 3.0, 1.0)
        return math.copysign(most * (3.0 * y - 3.0 * y * y + y * y * y), x)
    return most * math.sin(1.3 * math.atan(x / 1.3))


@compiled
def simulated(  # noqa: PLR0915 - one loop, that a compiler and a reader can follow
    steer: Floats,
    v: Floats,
    bank: Floats,
    wind: Floats,
    friction: Floats,
    pull: Floats,
    numbers: Floats,
    curve: int,
    four: bool,
    small: bool,
    turned_pull: bool,
    hold: int,
) -> Floats:
    """v_y, r, their rates, front lateral force and front angle (n, 6), by a Heun step.

    `hold`: 1 if inputs change within a step, 0 if they are held over it, as a hasty simulation has it.
    """
    m, inertia, lf, lr, cf, cr, tf, tr, relax, soft, play = numbers
    load_front, load_rear = m * 9.81 * lr / (lf + lr), m * 9.81 * lf / (lf + lr)
    out = np.zeros((len(v), 6))
    state, rate, other = np.zeros(4), np.zeros(4), np.zeros(4)
    held = steer[0]
    for i in range(len(v)):
        held = min(max(held, steer[i] - 0.5 * play), steer[i] + 0.5 * play)
        speed = v[i]
        if speed < 2.0:
            delta = held
            yaw = speed * delta / (lf + lr)
            out[i, 0], out[i, 1], out[i, 5] = lr * yaw, yaw, delta
            out[i, 3] = (yaw - out[i - 1, 1]) / 0.002 if i else 0.0
            state[0], state[1] = lr * yaw, yaw
            state[2], state[3] = m * speed * yaw * lr / (lf + lr), m * speed * yaw * lf / (lf + lr)
            continue
        delta = held - soft * out[i - 1, 4] if i else held
        after = min(i + hold, len(v) - 1) if hold else i
        held_after = min(max(held, steer[after] - 0.5 * play), steer[after] + 0.5 * play)
        for turn in range(2):
            s = state if turn == 0 else state + 0.002 * rate
            vy, r = s[0], s[1]
            if turn == 1:
                speed, delta = v[after], delta + held_after - held
            front, rear, moment = 0.0, 0.0, 0.0
            sides = (-1.0, 1.0) if four else (0.0, 0.0)
            for side in sides:
                u = speed + side * r * 0.5 * tf
                w = speed + side * r * 0.5 * tr
                if small:
                    af, ar = delta - (vy + lf * r) / u, -(vy - lr * r) / w
                else:
                    af, ar = delta - math.atan((vy + lf * r) / u), -math.atan((vy - lr * r) / w)
                one = bent(cf * af, 0.5 * friction[i] * load_front, curve)
                front += one
                rear += bent(cr * ar, 0.5 * friction[i] * load_rear, curve)
                if not small:
                    moment -= side * 0.5 * tf * one * math.sin(delta)
            if relax > 0.0:
                rate_front, rate_rear = speed / relax * (front - s[2]), speed / relax * (rear - s[3])
                front, rear = s[2], s[3]
            else:
                rate_front, rate_rear = 0.0, 0.0
            across = front if small else front * math.cos(delta)
            if turned_pull:
                across += pull[i] * math.sin(delta)
            force = across + rear + wind[i] - m * 9.81 * math.sin(bank[i])
            goal = rate if turn == 0 else other
            goal[0] = force / m - r * speed
            goal[1] = (lf * across - lr * rear + moment) / inertia
            goal[2], goal[3] = rate_front, rate_rear
            if turn == 0:
                out[i, 0], out[i, 1], out[i, 2], out[i, 3] = vy, r, goal[0], goal[1]
                out[i, 4], out[i, 5] = front, delta
        state = state + 0.001 * (rate + other)
    return out


@compiled
def leaning(goal: Floats, radps: float, damping: float) -> Floats:
    """A body on its springs: angle, rate, acceleration (n, 3)."""
    out = np.zeros((len(goal), 3))
    angle, rate = goal[0], 0.0
    for i in range(len(goal)):
        accel = radps * radps * (goal[i] - angle) - 2.0 * damping * radps * rate
        out[i, 0], out[i, 1], out[i, 2] = angle, rate, accel
        rate += 0.002 * accel
        angle += 0.002 * rate
    return out


@compiled
def low_passed(values: Floats, hz: float) -> Floats:
    """One pole."""
    keep = math.exp(-2.0 * math.pi * hz * 0.002)
    out = values.copy()
    for i in range(1, len(values)):
        out[i] = keep * out[i - 1] + (1.0 - keep) * values[i]
    return out
