"""What no named effect explains: where it enters, and its simplest shape.

Each channel is held against a library of products of motion, one at a time; a coefficient's unit is the channel's over
the shape's. A shape is said only if it beats, on unseen blocks, what every named effect could do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dsz_daemon.diagnose.effects.row import SENSORS, Effect, Parameter
from dsz_daemon.diagnose.effects.shape_names import SHAPE, with_shapes
from dsz_daemon.diagnose.fitting.model import Fit, values_of
from dsz_daemon.diagnose.recordings.recording import DT_S, filter_kernel, filtered
from dsz_daemon.diagnose.residuals.comparison import FOLDS, Each, Ints, Rows, noises
from dsz_daemon.diagnose.residuals.correlation import correlated_rows
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.shapes.jumps import jump_in, stay_in
from dsz_daemon.diagnose.shapes.own_ways import own_motion, own_ways
from dsz_daemon.diagnose.shapes.uneven_scales import is_anothers, uneven
from dsz_daemon.diagnose.simulation.drive import CHANNELS, Drive, Floats
from dsz_daemon.diagnose.simulation.motion import AY, G, R
from dsz_daemon.diagnose.simulation.moving import Moving, driven
from dsz_daemon.diagnose.simulation.pulls import is_much
from dsz_daemon.diagnose.simulation.wheel_readings import locks_in_front
from dsz_daemon.signals import IMU_CHANNELS

# Of a channel's power that is left: less is no shape worth a name. And it has to be more than noise and form, so often.
LEAST_SHARE = 0.05
_LEAST_LEVEL = 1.25
LEAST_ROWS = 500
# A wheel differs from what all of them have in common by so many of its spreads.
_WHEEL_SPREADS = 3.0
# The best of some hundred shapes and channels is so good by chance, and a parameter more has to be paid for.
BY_CHANCE = math.log(150.0)
CHOSEN_OF_MANY = BY_CHANCE + 3.0
# A sensor that sticks does so within some tenths of a m/s2 of nothing.
_STUCK_MPS2 = 0.2
# So much of how a mount swings, a channel shows, or none.
_SHOWS = 0.1
# What drive and brakes turn front wheels by is in every car a little (docs/decisions/0031); more, and surely, is not.
_PULLS = {"drive_steer": "ax where ax > 0", "brake_steer": "ax where ax < 0"}


class Coefficient(NamedTuple):
    """A number with its spread."""

    value: float
    std: float
    unit: str


class Shape(NamedTuple):
    """One channel's left-over structure: coefficient (with spread) times a product of motion."""

    channel: str
    shape: str
    coefficient: Coefficient
    share: float


class Found(NamedTuple):
    """A shape that has no name, as a row of the vocabulary, and what it gains on unseen blocks, in log likelihood."""

    effect: Effect
    channel: str
    shape: str
    share: float
    gain: float
    value: float
    std: float


def library(moving: Moving, drive: Drive) -> dict[str, tuple[Floats, str]]:
    """Products of the simulated motion (n,) with their units: what a sensor shows wrongly is not in them.

    None that is linear in acceleration, turn or steering: all of those have names (scale, leak, arm, ratio, stiffness),
    but for the steering on what does not follow it (`is_named`). How quickly the driver steers has none, but turns a
    car as an arm would show it. What a pedal switches on (lamps, a pump) may pull a sensor's supply down, and so may
    the motor of a power steering.
    """
    v, v_rate, steer = moving.v_mps, filtered(moving.v_rate, filter_kernel()), drive.steer
    r, side, steered = moving.moved[:, R], moving.moved[:, AY], np.gradient(steer, DT_S)
    shapes: dict[str, tuple[Floats, str]] = {
        "vx": (v, "m/s"),
        "vx^2": (v * v, "m2/s2"),
        "vx^3": (v**3, "m3/s3"),
        "ax^2": (v_rate**2, "m2/s4"),
        "ax^3": (v_rate**3, "m3/s6"),
        "|ax|": (np.abs(v_rate), "m/s2"),
        "ay^2": (side**2, "m2/s4"),
        "ay^3": (side**3, "m3/s6"),
        "|ay|": (np.abs(side), "m/s2"),
        "sign(ax)": (np.tanh(v_rate / _STUCK_MPS2), ""),
        "sign(ay)": (np.tanh(side / _STUCK_MPS2), ""),
        "ay*|ay|": (side * np.abs(side), "m2/s4"),
        "vx*ay": (v * side, "m2/s3"),
        "vx*r": (v * r, "m rad/s2"),
        "ax*ay": (v_rate * side, "m2/s4"),
        "r": (r, "rad/s"),
        "|r|": (np.abs(r), "rad/s"),
        "r^2": (r * r, "rad2/s2"),
        "r*|r|": (r * np.abs(r), "rad2/s2"),
        "r^3": (r**3, "rad3/s3"),
        "vx*ax": (v * v_rate, "m2/s3"),
        "|delta|": (np.abs(steer), "rad"),
        "delta": (steer, "rad"),
        "delta'": (steered, "rad/s"),
        "|delta'|": (np.abs(steered), "rad/s"),
    }
    shapes |= {f"({name} pressed)": (course, "") for name, course in drive.recording.pressed}
    return shapes | uneven("r", r, "rad/s") | uneven("ax", v_rate, "m/s2") | uneven("ay", side, "m/s2")


def is_named(shape: str, channel: str) -> bool:
    """Whether what a channel shows of a shape has a name: what the steering turns a car by is its ratio's.

    And what one gyro shows of another, a leak's; an accelerometer that shows a turn by itself has none. v r is a_y but
    for how the car slides: only the yaw gyro, whose scale may go by the speed, tells these apart. What is another
    sensor's own, unevenly, is not looked for here.
    """
    named = (shape == "delta" and channel in {"gyro_z", "accel_y"}) or (shape == "r" and channel.startswith("gyro"))
    named |= shape == "vx*r" and channel != "gyro_z"
    return named or is_anothers(shape, channel)


def best_shape(drive: Drive, rows: Rows, fit: Fit, each: Each = map) -> Found | None:
    """The shape that explains most of what is left of an IMU channel that has none yet; None without structure."""
    found = _shapes_of(drive, rows, fit, with_shapes(fit.effects), each)
    return max(found, key=lambda shape: shape.gain) if found else None


def unlisted(
    drive: Drive,
    rows: Rows,
    fit: Fit,
    there: Sequence[Found] = (),
    is_enough: Callable[[Found], bool] = lambda _: True,
) -> list[Shape]:
    """The shapes of the model, and the best one of what is left in each other channel, where it `is_enough`."""
    shapes = []
    for found in there:
        [i] = drive.vocabulary.columns_of(found.effect.name)
        value, std = float(fit.x[i]), float(fit.std[fit.columns.index(i)])
        coefficient = Coefficient(value, std, found.effect.parameters[0].unit)
        shapes.append(Shape(found.channel, found.shape, coefficient, found.share))
    for left in filter(is_enough, _shapes_of(drive, rows, fit, {found.channel for found in there})):
        coefficient = Coefficient(left.value, left.std, left.effect.parameters[0].unit)
        shapes.append(Shape(left.channel, left.shape, coefficient, left.share))
    return shapes


def _shapes_of(drive: Drive, rows: Rows, fit: Fit, known: Collection[str], each: Each = map) -> list[Found]:
    """The best shape of each IMU channel that is not `known`, where there is structure."""
    off = [c for c, channel in enumerate(CHANNELS[:6]) if channel not in known and _has_structure(drive, rows, fit, c)]
    if not off:
        return []
    moving = driven(drive, fit.x, fit.road)
    courses = library(moving, drive)
    found = each(lambda c: _shape_of(drive, rows, fit, c, courses, own_motion(moving, CHANNELS[c])), off)
    return [shape for shape in found if shape is not None]


def _has_structure(drive: Drive, rows: Rows, fit: Fit, c: int) -> bool:
    """Whether more is left of a channel than noise and form leave, in rows enough."""
    left, noise = fit.left[rows.used[:, c], c], float(np.nan_to_num(noises(drive))[c])
    if len(left) < LEAST_ROWS:
        return False
    return float(np.sqrt(np.mean(left**2))) >= _LEAST_LEVEL * float(np.hypot(noise, fit.form[c]))


def _shape_of(
    drive: Drive, rows: Rows, fit: Fit, c: int, there: Mapping[str, tuple[Floats, str]], own: Floats | None
) -> Found | None:
    used = rows.used[:, c]
    left, block = fit.left[used, c], rows.block[used]
    coarse = len(left) * fit.form[c] ** 2
    best: Found | None = None
    shapes = {name: shape for name, shape in there.items() if not is_named(name, CHANNELS[c])}
    shapes |= _jump(drive, left, rows.at[used], block)
    shapes |= own_ways(CHANNELS[c], own, left, rows.at[used]) if own is not None else {}
    courses = np.column_stack([np.zeros(len(left)), *(values[rows.at][used] for values, _ in shapes.values())])
    before, *each_after = (_unseen(courses, left, block) + coarse).tolist()
    for (name, (values, unit)), mine, after in zip(shapes.items(), courses.T[1:], each_after, strict=True):
        share = 1.0 - after / before
        if share < LEAST_SHARE:
            continue
        # As of named effects: what hangs together in what the larger model leaves counts once.
        whole, table = np.zeros((len(rows.at), 1)), np.column_stack([np.ones(len(left)), mine])
        step = np.linalg.lstsq(table, left, rcond=None)[0]
        whole[used, 0] = left - table @ step
        per_row = float(correlated_rows(whole, used[:, np.newaxis])[0])
        gain = 0.5 * len(left) / per_row * float(np.log(before / after)) - CHOSEN_OF_MANY
        if gain > max(LEAST_GAIN, best.gain if best is not None else 0.0):
            per = f"({unit_of(c)})/({unit})" if unit else unit_of(c)
            effect = as_effect(CHANNELS[c], name, values - float(np.mean(mine)), per, abs(step[1]))
            scatter = float(np.mean(whole[used, 0] ** 2)) * per_row
            std = math.sqrt(scatter * float(np.linalg.pinv(table.T @ table)[1, 1]))
            best = Found(effect, CHANNELS[c], f"k*{name}", share, gain, float(step[1]), std)
    return best


def _jump(drive: Drive, left: Floats, at: Ints, block: Ints) -> dict[str, tuple[Floats, str]]:
    """An offset's jump as a shape: 1 from then on, or for a while, which is no product of motion; empty without one."""
    time_s, there = drive.recording.time_s, np.arange(len(drive.steer))
    if (place := jump_in(left, at, block)) is not None:
        return {f"(t > {time_s[place]:.1f} s)": ((there >= place).astype(np.float64), "")}
    if (stay := stay_in(left, at, block)) is not None:
        begin, end = stay
        inside = ((there >= begin) & (there < end)).astype(np.float64)
        return {f"({time_s[begin]:.1f} s < t < {time_s[min(end, len(time_s) - 1)]:.1f} s)": (inside, "")}
    return {}


def wheel_squares(drive: Drive, fit: Fit) -> dict[str, tuple[float, float]]:
    """Wheels that show the square of their speed beyond what all of them do, which hardly shows: how much, and spread.

    `wheel_square`, if it is in the model, has as many parameters as there are wheels that have it.
    """
    if "wheel_square" not in fit.effects:
        return {}
    described = drive.vocabulary.described("wheel_square")
    least = {parameter.name: parameter.least for parameter in described.parameters}
    told = values_of(drive, fit, described.name)
    values = {wheel: told.get(wheel, (0.0, 0.0)) for wheel in least}
    # Most have nothing: of the two in the middle the one that is less.
    _, *middle, _ = sorted(value for value, _ in values.values())
    common = min(middle, key=abs)
    return {
        wheel: (value - common, std)
        for wheel, (value, std) in values.items()
        if abs(value - common) > max(least[wheel], _WHEEL_SPREADS * std)
    }


def wheel_shapes(drive: Drive, fit: Fit) -> list[Shape]:
    """What wheels show that grows with the square of their speed."""
    return [
        Shape(f"wheel_speed_{wheel}", "k*vx^2", Coefficient(value, std, "(m/s)/(m2/s2)"), 1.0)
        for wheel, (value, std) in wheel_squares(drive, fit).items()
    ]


def _swinging(drive: Drive, fit: Fit) -> list[str]:
    """The channels that show how an IMU swings on its mount."""
    swings = values_of(drive, fit, "soft_mount")
    heard = [channel for c, channel in enumerate(IMU_CHANNELS) if np.isfinite(drive.measured[:, c]).any()]
    shares = ((one, swings.get("gyros" if one.startswith("gyro") else one, (0.0, 0.0))) for one in heard)
    return [channel for channel, (share, std) in shares if share > max(_SHOWS, std)]


def wheels_follow(drive: Drive, fit: Fit) -> bool:
    """Whether what is late are wheel speeds that follow smoothly: along the car alone something swings besides."""
    return {"soft_mount", "wheel_speed_delay"} <= set(fit.effects) and _swinging(drive, fit) == ["accel_x"]


def shapes_of_all(drive: Drive, fit: Fit, told: Collection[str]) -> list[Shape]:
    """What all wheels show alike, all of the IMU, or the whole car, where it gains enough to be `told`."""
    found = list[Shape]()
    if "wheel_growth" in told:
        value, std = values_of(drive, fit, "wheel_growth")["per_v2"]
        named = [f"wheel_speed_{wheel}" for wheel in ("fl", "fr", "rl", "rr")]
        found += [Shape(channel, "k*vx^3", Coefficient(-value, std, "(m/s)/(m3/s3)"), 1.0) for channel in named]
    if "wheels_more" in told:
        value, std = values_of(drive, fit, "wheels_more")["offset_mps"]
        more = Coefficient(value, std, "m/s")
        found += [Shape(f"wheel_speed_{wheel}", "k where vx > 0", more, 1.0) for wheel in ("fl", "fr", "rl", "rr")]
    if "imu_clock" in told:
        value, std = values_of(drive, fit, "imu_clock")["per_s"]
        there = [c for c in range(len(IMU_CHANNELS)) if np.isfinite(drive.measured[:, c]).any()]
        late = Coefficient(value, std, "s/s of lateness")
        found += [Shape(IMU_CHANNELS[c], "later by k*t", late, 1.0) for c in there]
    if "soft_mount" in told:
        value, std = values_of(drive, fit, "soft_mount")["per_w2_s2"]
        hz = value**-0.5 / (2.0 * math.pi)
        rate = Coefficient(hz, 0.5 * hz * std / value, "Hz")
        if "wheel_speed_delay" in told and wheels_follow(drive, fit):
            late_s, std = values_of(drive, fit, "wheel_speed_delay")["delay_s"]
            behind = Coefficient(-late_s, std, "(m/s)/(m/s2), of wheels that follow smoothly")
            found += [Shape(f"wheel_speed_{wheel}", "k*ax", behind, 1.0) for wheel in ("fl", "fr", "rl", "rr")]
        else:
            found += [Shape(channel, "swings", rate, 1.0) for channel in _swinging(drive, fit)]
    if "yaw_inertia" in told:
        value, std = values_of(drive, fit, "yaw_inertia")["share"]
        whole = drive.car.yaw_inertia_kgm2
        found.append(Shape("gyro_z", "k*r'", Coefficient(whole * value, whole * std, "kg m2 of yaw inertia"), 1.0))
    if "locked_axle" in told:
        value, std = values_of(drive, fit, "locked_axle")["share"]
        in_front = locks_in_front(drive.car)
        half_m = 0.5 * (drive.car.front_track_m if in_front else drive.car.rear_track_m)
        for side, sign in (("l", 1.0), ("r", -1.0)):
            wheel = f"wheel_speed_{'f' if in_front else 'r'}{side}"
            found.append(Shape(wheel, "k*r", Coefficient(sign * half_m * value, half_m * std, "(m/s)/(rad/s)"), 1.0))
    if "nose_lift" in told:
        value, std = values_of(drive, fit, "nose_lift")["rad_per_v2"]
        found.append(Shape("accel_x", "k*vx^2", Coefficient(G * value, G * std, "(m/s2)/(m2/s2) of the pitch"), 1.0))
    return [*found, *_of_the_steering(drive, fit, told)]


def _of_the_steering(drive: Drive, fit: Fit, told: Collection[str]) -> list[Shape]:
    """How the front wheels do not follow the hand wheel, or its sensor does not."""
    found = list[Shape]()
    if "steering_lag" in told:
        value, std = values_of(drive, fit, "steering_lag")["time_constant_s"]
        late = Coefficient(-value, std, "rad/(rad/s) of the front wheels")
        found.append(Shape("gyro_z", "k*delta'", late, 1.0))
    if "steering_slip" in told:
        told_rad, told_s = (values_of(drive, fit, "steering_slip")[name] for name in ("jump_rad", "at_s"))
        jump = Coefficient(*told_rad, "rad of the front wheels")
        time_s = drive.recording.time_s
        since_s = float(time_s[min(round(told_s[0] / DT_S), len(time_s) - 1)])
        found.append(Shape("gyro_z", f"k from {since_s:.1f} s on", jump, 1.0))
    if "steering_friction" in told:
        value, std = values_of(drive, fit, "steering_friction")["width_rad"]
        behind = Coefficient(-0.5 * value, 0.5 * std, "rad of the front wheels, softly")
        found.append(Shape("gyro_z", "k*sign(delta')", behind, 1.0))
    return found


def pull_shapes(drive: Drive, fit: Fit) -> list[Shape]:
    """How a car that is driven, or braked, goes to one side, where it does so by more than others do."""
    told = values_of(drive, fit, "")
    return [
        Shape("gyro_z", f"k*{when}", Coefficient(*told[name], "rad/(m/s2) of the front wheels"), 1.0)
        for name, when in _PULLS.items()
        if name in told and is_much(*told[name])
    ]


def as_effect(channel: str, shape: str, course: Floats, unit: str, size: float) -> Effect:
    """The shape as what may have been left out; `course` (n,) of size `size`."""
    return Effect(
        name=f"{channel}{SHAPE}{shape}",
        words=f"{channel} shows {{k:.3g}} {shape} more",
        equation=f"reading += k {shape}",
        touches=SENSORS,
        parameters=(Parameter("k", unit, 0.3 * size, -100.0 * size, 100.0 * size, 0.0),),
        shows=lambda _, values: {channel: values["k"] * course},
    )


def unit_of(c: int) -> str:
    """The unit of an IMU channel, as shapes write it."""
    return "rad/s" if IMU_CHANNELS[c].startswith("gyro") else "m/s2"


def _unseen(courses: Floats, left: Floats, block: Ints) -> Floats:
    """Sum of squares (s,) of what is left (k,) in blocks that a straight line along each course (k, s) has not seen."""
    fold = block % FOLDS
    mine, own = courses - np.mean(courses, axis=0), left - np.mean(left)
    count = np.bincount(fold, minlength=FOLDS).astype(np.float64)
    parts = [(mine[fold == k], own[fold == k]) for k in range(FOLDS)]
    first, second = (np.array([np.sum(m**order, axis=0) for m, _ in parts]) for order in (1, 2))
    both = np.array([y @ m for m, y in parts])
    level, power = np.array([(y.sum(), y @ y) for _, y in parts]).T[..., np.newaxis]
    total = np.zeros(courses.shape[1])
    for k in range(FOLDS):
        n = count.sum() - count[k]
        if not 0.0 < n < count.sum():
            continue
        m, y = (first.sum(axis=0) - first[k]) / n, (level.sum() - level[k]) / n
        spread = (second.sum(axis=0) - second[k]) / n - m * m
        slope = ((both.sum(axis=0) - both[k]) / n - m * y) / np.where(spread > 0.0, spread, np.inf)
        start = y - slope * m
        squares = power[k] - 2.0 * (start * level[k] + slope * both[k])
        total += squares + count[k] * start**2 + 2.0 * start * slope * first[k] + slope**2 * second[k]
    return np.maximum(total, 1e-30)
