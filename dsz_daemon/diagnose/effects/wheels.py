"""Wheels and their sensors: how large, how far apart, how late."""

from __future__ import annotations

from dsz_daemon.diagnose.effects.row import CAR, LONGITUDINAL, SPEED, WHEELS, YAW_RATE, Effect, Parameter, even

WHEEL_RADIUS = Effect(
    "wheel_radius",
    "Wheel radii are {fl:.4f}, {fr:.4f}, {rl:.4f}, {rr:.4f} of what is configured (front left to rear right)",
    "v = (1 + k) r omega",
    WHEELS,
    even("fl fr rl rr", "1", 0.01, 0.15, 8e-4),
    source="rolling",
    needs=(SPEED,),
)

TRACK_WIDTH = Effect(
    "track_width",
    "Tracks are {front:.3f} (front) and {rear:.3f} (rear) of what is configured",
    "v = v_x -+ r track / 2",
    WHEELS,
    even("front rear", "1", 0.05, 0.5, 0.01),
    source="a rigid body",
    needs=(YAW_RATE,),
)

WHEEL_SPEED_DELAY = Effect(
    "wheel_speed_delay",
    "The wheel speeds come {delay_s:.3f} s late",
    "reading(t) = v(t - d)",
    CAR,
    (Parameter("delay_s", "s", 0.02, -0.02, 0.5, 0.008),),
    source="a transport delay",
    needs=(LONGITUDINAL,),
)
