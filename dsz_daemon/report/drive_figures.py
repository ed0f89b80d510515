"""The pictures that all channels share: the drive, the model, motion, attitude. Pure."""

from __future__ import annotations

import numpy as np

from dsz_daemon.report.channel_figures import duration_s, marks_s
from dsz_daemon.report.display import (
    ACCELERATION,
    BARE,
    CELSIUS,
    CHANNEL_NAMES,
    DEGREE,
    DEGREE_PER_SECOND,
    METRE_PER_SECOND,
    MINUS,
    SPEED,
    STIFFNESS,
    Samples,
    Unit,
    channel_column,
)
from dsz_daemon.report.panels import (
    BLACK,
    BLUE,
    ORANGE,
    PURPLE,
    RAW,
    SKY,
    VERMILION,
    Figure,
    Panel,
    Trace,
    curve,
    stacked,
    strip,
)
from dsz_daemon.report.results import column, seconds, truth_at
from dsz_daemon.signals import ACCEL_CHANNELS, WHEELS

_SWITCHES = ("standstill", "brake", "accelerator", "reverse")
_WHEEL_COLOURS = dict(zip(WHEELS, (SKY, BLUE, ORANGE, PURPLE), strict=True))


def _ours(samples: Samples, name: str, label: str, unit: Unit, colour: str = BLUE, width: float = 1.2) -> list[Trace]:
    """One column of the samples as a line; nothing when it is missing."""
    return curve(label, seconds(samples), column(samples, name), unit, colour, width)


def _true(samples: Samples, truth: Samples | None, name: str, label: str, unit: Unit) -> list[Trace]:
    return curve(label, seconds(samples), truth_at(samples, truth, name), unit, VERMILION, 1.0)


def drive_figure(samples: Samples, truth: Samples | None) -> Figure | None:
    """Speed, wheels, steering and the switches: what the car did."""
    speed = [
        *_ours(samples, "speed_reference_mps", "speed reference", SPEED, ORANGE),
        *_ours(samples, "speed_mps", "speed", SPEED),
        *_true(samples, truth, "speed_mps", "true speed", SPEED),
    ]
    wheels = [
        trace
        for wheel, colour in _WHEEL_COLOURS.items()
        for trace in _ours(samples, f"wheel_speed_{wheel}_mps", wheel, SPEED, colour, 1.0)
    ]
    road_wheel = [
        *_ours(samples, "road_wheel_angle_input_rad", "road wheel, measured", DEGREE, RAW),
        *_ours(samples, "road_wheel_angle_rad", "road wheel", DEGREE),
    ]
    hand_wheel = _ours(samples, "steering_wheel_angle_rad", "steering wheel", DEGREE, BLACK, 1.0)
    temperature = _ours(samples, "temperature_degc", "IMU temperature", CELSIUS)
    panels = [
        Panel("speed", SPEED, 130, speed),
        Panel("wheel speeds", SPEED, 90, wheels),
        Panel("wheel speeds minus their mean", SPEED, 80, _wheel_differences(samples)),
        Panel("steering wheel angle", DEGREE, 90, hand_wheel),
        Panel("road wheel angle", DEGREE, 90, road_wheel),
        Panel("IMU temperature", CELSIUS, 70, temperature),
        _switch_panel(samples),
    ]
    return stacked(panels, duration_s(samples), marks_s(samples))


def _wheel_differences(samples: Samples) -> list[Trace]:
    """Each wheel minus the mean of all: shows slip, unequal radii and turning."""
    speeds = {w: column(samples, f"wheel_speed_{w}_mps") for w in WHEELS}
    known = {w: v for w, v in speeds.items() if v is not None}
    if len(known) < 2:
        return []
    time_s, mean = seconds(samples), np.mean(list(known.values()), axis=0)
    return [
        trace
        for w, values in known.items()
        for trace in curve(f"{w} {MINUS} mean", time_s, values - mean, SPEED, _WHEEL_COLOURS[w], 1.0)
    ]


def _switch_panel(samples: Samples) -> Panel:
    traces: list[Trace] = []
    rows = []
    for switch in _SWITCHES:
        state = column(samples, switch)
        if state is None:
            continue
        rows.append(switch)
        codes = (np.nan_to_num(state) != 0.0).astype(np.int64)
        traces += strip(switch, seconds(samples), codes, switch, [("", ""), ("on", BLACK)])
    return Panel("switches", BARE, 15 * len(rows), traces, categories=tuple(rows))


def model_figure(samples: Samples, truth: Samples | None) -> Figure | None:
    """The single-track model, sideslip and tau: what the gates judge by."""
    model = _ours(samples, "yaw_rate_model_radps", "model yaw rate", DEGREE_PER_SECOND)
    sideslip = _ours(samples, "sideslip_rad", "sideslip", DEGREE)
    if model:
        model = _ours(samples, "gyro_z_radps", "compensated yaw rate", DEGREE_PER_SECOND, RAW) + model
    if sideslip:
        sideslip += _true(samples, truth, "sideslip_rad", "true sideslip", DEGREE)
    stiffness = [
        *_ours(samples, "front_cornering_stiffness_n_per_rad", "front", STIFFNESS),
        *_ours(samples, "rear_cornering_stiffness_n_per_rad", "rear", STIFFNESS, ORANGE),
    ]
    lateral = _ours(samples, "lateral_velocity_mps", "lateral velocity", METRE_PER_SECOND)
    panels = [
        Panel("yaw rate", DEGREE_PER_SECOND, 110, model),
        Panel("sideslip", DEGREE, 110, sideslip),
        Panel("lateral velocity", METRE_PER_SECOND, 80, lateral),
        Panel("tau, restlessness (29)", BARE, 90, _tau(samples), is_log=True),
        Panel("cornering stiffness of one tyre", STIFFNESS, 90, stiffness),
    ]
    return stacked(panels, duration_s(samples), marks_s(samples))


def _tau(samples: Samples) -> list[Trace]:
    tau = column(samples, "tau")
    # Its axis is logarithmic: a tau of exactly 0 (nothing moves) is a gap.
    positive = None if tau is None else np.where(tau > 0.0, tau, np.nan)
    return curve("tau", seconds(samples), positive, BARE, BLACK, 1.0)


def kinematics_figure(samples: Samples) -> Figure | None:
    """Compensated accelerations against the inverse kinematics (20)-(22)."""
    panels = []
    for channel in ACCEL_CHANNELS:
        traces = [
            *_ours(samples, channel_column(channel), "compensated", ACCELERATION, BLUE, 1.0),
            *_ours(samples, f"{channel}_kinematic_mps2", "from motion", ACCELERATION, ORANGE),
        ]
        panels.append(Panel(CHANNEL_NAMES[channel], ACCELERATION, 120, traces if len(traces) == 2 else []))
    return stacked(panels, duration_s(samples), marks_s(samples))


def attitude_figure(samples: Samples, truth: Samples | None) -> Figure | None:
    """Roll and pitch: total, and the part that the suspension makes."""
    panels = [
        Panel("roll, left side up positive", DEGREE, 100, _angle(samples, truth, "roll")),
        Panel("pitch, nose down positive", DEGREE, 100, _angle(samples, truth, "pitch")),
    ]
    return stacked(panels, duration_s(samples), marks_s(samples))


def _angle(samples: Samples, truth: Samples | None, angle: str) -> list[Trace]:
    traces = [
        *_ours(samples, f"{angle}_rad", angle, DEGREE),
        *_ours(samples, f"suspension_{angle}_rad", f"suspension {angle}", DEGREE, ORANGE),
    ]
    return traces + _true(samples, truth, f"{angle}_rad", f"true {angle}", DEGREE) if traces else []
