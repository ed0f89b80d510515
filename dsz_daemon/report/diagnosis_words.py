"""The verdict of a diagnosis in a sentence that an engineer can pass on. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dsz_daemon.report.diagnosis_channels import title_of, unit_of
from dsz_daemon.report.diagnosis_units import entries, listed, real, significant, told
from dsz_daemon.report.display import MINUS, words
from dsz_daemon.report.results import mapping

CONFIGURED = {
    "front_cornering_stiffness_n_per_rad": "the front tyres' cornering stiffness",
    "rear_cornering_stiffness_n_per_rad": "the rear tyres' cornering stiffness",
    "mass_kg": "the mass",
    "yaw_inertia_kgm2": "the yaw inertia",
    "cg_to_front_axle_m": "from the C.G. to the front axle",
    "cg_to_rear_axle_m": "from the C.G. to the rear axle",
    "steering_ratio": "the steering ratio",
    "front_track_m": "the front track",
    "rear_track_m": "the rear track",
}
# Of the recording or its configuration, no physics.
_FAULTS = {"axis_fault", "configuration"}
_INTEGRATED = {"road_bank": "gyro_x", "road_grade": "gyro_y"}
# Less than this and the fit on unseen data is as it was.
_BETTER = 1.05
# What is left of a channel and follows no shape: its error says as much.
_NO_SHAPE = "of no known shape"
_SPIN = re.compile(r"k\*vx from ([\d.]+ to [\d.]+ s)")


def sentence(result: Mapping[str, Any]) -> str:
    """What is wrong with the simulation, and by how much knowing it helps on data that the fit has not seen."""
    causes = entries(result.get("causes"))
    verdict = told(result.get("verdict"))
    if causes:
        return f"{_cause(causes[0])}; {_gain(result, causes)}{_rest(result, verdict)}."
    if verdict == "consistent":
        return _consistent(result)
    if verdict:
        return f"The simulation and the recording differ, and nothing in the vocabulary explains it{_worst(result)}."
    return "This diagnosis has no verdict."


def best_gain(result: Mapping[str, Any]) -> tuple[str, float, float] | None:
    """Channel, RMS on unseen data before and after, of the channel that gains most by ratio; None without any.

    A gyro of which a road's profile is the integral is left out: it fits whatever the road is.
    """
    named = {told(cause.get("effect")) for cause in entries(result.get("causes"))}
    integrated = {gyro for road, gyro in _INTEGRATED.items() if road in named}
    found = []
    for channel, fit in mapping(result.get("fit")).items():
        held = mapping(mapping(fit).get("held_out"))
        before, after = real(held.get("before")), real(held.get("after"))
        if before > 0.0 and after > 0.0 and channel not in integrated:
            found.append((channel, before, after))
    return max(found, key=lambda one: one[1] / one[2]) if found else None


def parameter_words(parameter: str) -> str:
    """A configured parameter as it is spoken of."""
    return CONFIGURED.get(parameter, words(parameter))


def _cause(cause: Mapping[str, Any]) -> str:
    statement = told(cause.get("statement")) or words(told(cause.get("effect")) or "something")
    # "The IMU sits ..." goes on in the middle of a sentence, "IMU" and "+75 kg" stay as they are.
    if statement[1:2].islower() or statement[1:2] == " ":
        statement = statement[:1].lower() + statement[1:]
    statement = statement.rstrip(".").replace("m/s2", "m/s²")
    rivals = [words(told(name)) for name in cause.get("indistinguishable_from") or ()]
    doubt = f" (or {listed(rivals)}: this recording can't tell)" if rivals else ""
    if cause.get("effect") in _FAULTS:
        return f"The recording or its configuration has a fault that is no physics: {statement}{doubt}"
    return f"The simulation leaves out that {statement}{doubt}"


def _gain(result: Mapping[str, Any], causes: Sequence[Mapping[str, Any]]) -> str:
    others = len(causes) - 1
    more = "with that mended" if causes[0].get("effect") in _FAULTS else "with it"
    if others:
        more += " and one more cause" if others == 1 else f" and {others} more causes"
    best = best_gain(result)
    if best is None or best[1] < _BETTER * best[2]:
        return f"{more} the fit on unseen data is much as before"
    channel, before, after = best
    unit = unit_of(channel, result)
    saved = 100.0 * (1.0 - after / before)
    return (
        f"{more}, {_left(title_of(channel, result))} on unseen data falls from {significant(before * unit.per_si)} "
        f"to {significant(after * unit.per_si)} {unit.label} ({MINUS}{saved:.0f} %)"
    )


def _left(title: str) -> str:
    return f"the error (rms) of {title}"


def _rest(result: Mapping[str, Any], verdict: str) -> str:
    return f", but not all is explained{_worst(result)}" if verdict.startswith("partly") else ""


def end_of(shape: Mapping[str, Any]) -> str:
    """In words, what a signal that drives the simulation ends at; empty for any other shape."""
    channel, limit_rad = told(shape.get("channel")), real(mapping(shape.get("coefficient")).get("value"))
    if told(shape.get("shape")) != f"|{channel}| <= k" or not np.isfinite(limit_rad):
        return ""
    goes = f"{words(channel)} goes no further than {significant(np.degrees(limit_rad), 3)} deg, though the car turns on"
    share = real(shape.get("share"))
    return f"{goes} ({share:.0%} of the drive is left out)" if np.isfinite(share) else goes


def is_spin(shape: Mapping[str, Any]) -> bool:
    """Whether a shape is a stretch in which a wheel spins or slides."""
    return _SPIN.fullmatch(told(shape.get("shape"))) is not None


def is_formless(shape: Mapping[str, Any]) -> bool:
    """Whether no shape is known of it: how much is left of a channel is all that is said."""
    return told(shape.get("shape")).endswith(_NO_SHAPE)


def spins_of(result: Mapping[str, Any]) -> list[str]:
    """In words, a sentence per wheel, when it spins or slides and by how much."""
    found = dict[tuple[str, str], list[tuple[str, float]]]()
    for shape in entries(result.get("unlisted")):
        when, k = _SPIN.fullmatch(told(shape.get("shape"))), real(mapping(shape.get("coefficient")).get("value"))
        if when is not None and np.isfinite(k):
            wheel = title_of(told(shape.get("channel")), result).removesuffix(" speed")
            found.setdefault((wheel, "spins" if k > 0.0 else "slides"), []).append((when[1], abs(k)))
    return [
        f"the {wheel} {does}: {listed([when for when, _ in stretches])}, up to {max(k for _, k in stretches):.0%} "
        f"{'faster' if does == 'spins' else 'slower'} than the car rolls, which is left out of the fit"
        for (wheel, does), stretches in found.items()
    ]


def _worst(result: Mapping[str, Any]) -> str:
    """What is left where it is most, wheels that spin, and the shapes without a name."""
    unlisted = [one for one in entries(result.get("unlisted")) if not is_spin(one) and not is_formless(one)]
    ends = [end_of(one) for one in unlisted]
    shapes = [title_of(told(one.get("channel")), result) for one, end in zip(unlisted, ends, strict=True) if not end]
    if any(is_spin(one) for one in entries(result.get("unlisted"))):
        ends.append("wheels spin or slide")
    levels = {name: real(value) for name, value in mapping(result.get("level")).items()}
    known = {name: value for name, value in levels.items() if np.isfinite(value)}
    parts = [end for end in ends if end]
    if known:
        name = max(known, key=lambda one: known[one])
        # Below twice, the level is no news beside a shape.
        if known[name] > 2.0 or not (shapes or parts):
            times = f"{known[name]:.1f} times what noise and coarseness leave"
            parts.append(f"the error of {title_of(name, result)} is {times}")
    if shapes:
        parts.append(
            f"{listed(list(dict.fromkeys(shapes)))} {'follows' if len(shapes) == 1 else 'follow'} "
            f"{'a shape' if len(shapes) == 1 else 'shapes'} without a name"
        )
    return f": {' and '.join(parts)}" if parts else ""


def _consistent(result: Mapping[str, Any]) -> str:
    errors = [text for error in entries(result.get("parameter_errors")) if (text := _error(error))]
    if errors:
        return (
            f"The simulation agrees with the recording once {listed(errors)} what is configured, "
            "within the tolerance; this drive shows no missing physics."
        )
    return (
        "The simulation agrees with the recording: what is left is noise and the simulation's own coarseness, "
        "and this drive shows no missing physics."
    )


def _error(error: Mapping[str, Any]) -> str:
    """A configured parameter and how far off it is; "" without numbers."""
    configured, fitted = real(error.get("configured")), real(error.get("fitted"))
    if not (np.isfinite(fitted) and configured):
        return ""
    share = 100.0 * (fitted / configured - 1.0)
    return f"{parameter_words(told(error.get('parameter')))} is {abs(share):.0f} % {'above' if share > 0 else 'below'}"
