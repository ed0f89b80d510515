"""What is concealed: trials by the seed, in shares that are known beforehand and in an order that is not."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dsz_daemon.prove import third_party_car
from dsz_daemon.prove.sizes import at_size
from dsz_daemon.prove.unlisted import UNLISTED
from dsz_daemon.sim.effects import EFFECTS, Choice

OWN, THIRD_PARTY = "own", "third_party"
SECONDS = 150.0
PLAIN, SMALL, NEAR_FLOOR = 1.0, 0.3, 0.1
# Of all trials; the rest are singles. Of a third party's car nothing is no null, so that nulls are the own car's.
NULLS, PAIRS, ALIASES, LOCAL, NAMELESS, SHAKING = 0.30, 0.12, 0.04, 0.04, 0.16, 0.04
# Singles of the third party's car with its tyres as published, which shake it: counted by themselves.
AS_PUBLISHED = "as_published"
_THIRD_PARTYS = 0.4
# Effects that the other of the pair hides, or that no drive of this kind reaches the limits of.
_NOT_IN_PAIRS = {"axis_fault", "low_friction", "mass_loading", "cornering_stiffness", "steering_compliance"} | {
    "tyre_saturation"
}
_SAME_TURN = ("mass_loading", "cornering_stiffness", "steering_compliance")
# Smaller ones are nothing: a limit that no drive gets to, stiffnesses within what is configured as their tolerance.
_ONLY_PLAIN = {"sensor_saturation", "cornering_stiffness"}
# Reached by these drives (some 3.5 m/s2), unlike the vocabulary's plain ones.
_GRIP = {"tyre_saturation": 0.5, "low_friction": 0.35}
# An even smaller share of plain effects that a car has mildly on: nobody could know.
MILD = 0.01


class Trial(NamedTuple):
    """One recording: a car on a way, with what is put into it; `mild` is there and too little to be named."""

    number: int
    group: str
    car: str
    kind: str
    seed: int
    size: float
    effects: tuple[Choice, ...]
    unlisted: tuple[tuple[str, float, float], ...]
    mild: tuple[Choice, ...]
    noise_gain: float
    flicker: bool
    stiffness: tuple[float, float]


def trials(seed: int, count: int) -> list[Trial]:
    """As many trials, shuffled; the same for the same seed and count."""
    rng = np.random.default_rng([seed, count])
    groups: list[str] = []
    for group, share in (
        ("null", NULLS), ("pair", PAIRS), ("alias_pair", ALIASES), ("local", LOCAL), ("unlisted", NAMELESS),
        (AS_PUBLISHED, SHAKING),
    ):  # fmt: skip
        groups += [group] * round(share * count)
    groups += ["single"] * (count - len(groups))
    rng.shuffle(groups)
    return [_trial(np.random.default_rng([seed, count, number]), number, group) for number, group in enumerate(groups)]


def _trial(rng: np.random.Generator, number: int, group: str) -> Trial:
    own = group in {"null", "alias_pair", "local"} or (group != AS_PUBLISHED and rng.random() > _THIRD_PARTYS)
    car = OWN if own else THIRD_PARTY
    kind = str(rng.choice(["city", "city", "highway"]))
    size = float(rng.choice([PLAIN, SMALL, NEAR_FLOOR], p=[0.5, 0.3, 0.2])) if group == "single" else PLAIN
    if group == "unlisted":
        size = float(rng.choice([PLAIN, SMALL], p=[0.7, 0.3]))
    effects = tuple(_choice(rng, name, size) for name in _names(rng, group, car, size))
    if group == "alias_pair":
        # A load in the back would undo what the other of the pair does.
        effects = tuple(choice if choice.name != "mass_loading" else _in_front(choice) for choice in effects)
    unlisted: tuple[tuple[str, float, float], ...] = ()
    if group == "unlisted":
        name = str(rng.choice(list(UNLISTED)))
        unlisted = ((name, size, float(rng.uniform(*UNLISTED[name].exponents))),)
    mild = () if group == "null" or not own else _mild(rng, {choice.name for choice in effects})
    off = group == "null" and rng.random() < 0.5
    front, rear = (round(float(1.0 + rng.uniform(-0.08, 0.08)), 3) if off else 1.0 for _ in range(2))
    return Trial(
        number, group, car, kind, int(rng.integers(1, 1_000_000_000)), size, effects, unlisted, mild,
        float(np.exp(rng.uniform(np.log(0.5), np.log(2.0)))), bool(rng.random() < 0.5), (front, rear),
    )  # fmt: skip


def _names(rng: np.random.Generator, group: str, car: str, size: float) -> list[str]:
    there = list(EFFECTS) if car == OWN else list(third_party_car.PLANTED)
    if group == "local":
        return ["low_friction"]
    if group == "alias_pair":
        return [str(name) for name in rng.choice(_SAME_TURN, 2, replace=False)]
    if group == "pair":
        return [str(n) for n in rng.choice([n for n in there if n not in _NOT_IN_PAIRS], 2, replace=False)]
    if group in {"single", AS_PUBLISHED}:
        never = {"low_friction"} | (set() if size == PLAIN else _ONLY_PLAIN)
        sized = [name for name in there if name not in never and at_size(name, size) is not None]
        return [str(rng.choice(sized))]
    return []


def _choice(rng: np.random.Generator, name: str, size: float) -> Choice:
    more: dict[str, float] = {}
    if "seed" in EFFECTS[name].parameters:
        more["seed"] = float(rng.integers(1, 1_000_000))
    if name in _GRIP:
        more["friction_coefficient"] = _GRIP[name] / size**0.5
    if name == "low_friction":
        more["start_s"] = round(float(rng.uniform(20.0, 80.0)), 1)
        more["end_s"] = round(more["start_s"] + float(rng.uniform(25.0, 55.0)), 1)
    found = at_size(name, size, more)
    if found is None:
        raise ValueError(f"{name} has no size {size}")
    # The sign is nobody's to know either.
    if name in {"imu_lever_arm", "imu_misalignment", "steering_offset"} and rng.random() < 0.5:
        found = Choice(name, {key: -float(value) for key, value in found.given.items()})
    return found


def _in_front(loading: Choice) -> Choice:
    return Choice(loading.name, {**loading.given, "cg_shift_m": abs(float(loading.given["cg_shift_m"]))})


def _mild(rng: np.random.Generator, planted: set[str]) -> tuple[Choice, ...]:
    """Some others, at a hundredth of their plain sizes: no car is to the letter what is configured."""
    others = ["imu_lever_arm", "imu_misalignment", "gyro_scale", "accel_scale", "gyro_cross_axis", "accel_cross_axis",
              "steering_offset", "steering_backlash"]  # fmt: skip
    drawn = rng.choice([name for name in others if name not in planted], 4, replace=False)
    found = [at_size(str(name), MILD) for name in drawn]
    return tuple(choice for choice in found if choice is not None)


def as_truth(trial: Trial) -> dict[str, Any]:
    """What is sealed of a trial, as plain data."""

    def plain(choices: tuple[Choice, ...]) -> list[dict[str, Any]]:
        return [{"effect": name, "parameters": dict(given)} for name, given in choices]

    third = trial.car == THIRD_PARTY
    return trial._asdict() | {
        "effects": plain(trial.effects),
        "mild": plain(trial.mild),
        "unlisted": [
            {"name": name, "channel": UNLISTED[name].channel, "size": size, "exponent": exponent}
            for name, size, exponent in trial.unlisted
        ],
        "by_construction": sorted(third_party_car.BY_CONSTRUCTION) if third else [],
    }
