"""What is kept of the estimator from one ignition to the next, and what of it may still be believed.

Learnt offsets belong to a sensor and to the way it is read; learnt stiffness to a car. Both are
kept with a description of these, and start anew where it no longer fits. Whatever comes from a
file is only a claim: its shape, its numbers and its time are checked before the estimator sees it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from dsz_daemon import __version__
from dsz_daemon.core.parameters import Tuning, ZeroingTuning
from dsz_daemon.core.reachable import unreachable_stiffness, unreachable_zeroing
from dsz_daemon.core.state import EstimatorState, as_plain, from_plain, initial_state, resumed
from dsz_daemon.core.zeroing import ZeroingState
from dsz_daemon.edge.boot import Boot, this_boot
from dsz_daemon.runs.setup import Setup
from dsz_daemon.runs.state_age import age, age_in_words
from dsz_daemon.signals import GYRO_CHANNELS, QUANTITIES

Body = dict[str, Any]
# What the stiffness adaptation learns from, besides the car.
_STIFFNESS_ROLES = ("gyro_z", "accel_y", "steering_wheel_angle", "road_wheel_angle")


class Recall(NamedTuple):
    """What a saved state is worth now.

    `estimator` is None where nothing of it could be taken over. `age_s` is the time that was added to
    the spreads (a long one where the true age can't be known), `taken` the channels that go on with
    their old offsets, `temperature_degc` the sensor's at saving. `said`: what a user should know.
    """

    estimator: EstimatorState | None
    age_s: float
    said: tuple[str, ...]
    taken: tuple[str, ...] = ()
    temperature_degc: float | None = None

    def in_words(self) -> str:
        """`gyro_x, gyro_z as learnt 3.2 h ago at 21 degC`."""
        if not self.taken:
            return "no offset was taken over"
        at = "" if self.temperature_degc is None else f" at {self.temperature_degc:.0f} degC"
        return f"{', '.join(self.taken)} as learnt {age_in_words(self.age_s)} ago{at}"


def remembered(
    setup: Setup, estimator: EstimatorState, t_ns: int, temperature: float | None, boot: Boot | None = None
) -> Body:
    """The body of a state file: offsets of the mapped channels and learnt stiffness, at `t_ns`.

    `temperature` (degC) is the mapped sensor's, None or NaN where there is none.
    """
    plain, boot = as_plain(estimator), boot or this_boot()
    stiffness = {name: value for name, value in plain["stiffness"].items() if name != "smoothed_yaw_radps"}
    is_known = temperature is not None and math.isfinite(temperature)
    return {
        "written_by": f"dsz {__version__}",
        "saved_ns": t_ns,
        "boot": {"id": boot.id, "elapsed_ns": boot.elapsed_ns},
        "temperature_degc": temperature if is_known else None,
        "sensor": setup.settings.service.sensor,
        "channels": {name: {"source": _source(setup, name), "learnt": plain[name]} for name in setup.channels},
        "stiffness": {"source": _stiffness_source(setup), "learnt": stiffness},
    }


def recalled(setup: Setup, body: Body, now_ns: int, boot: Boot | None = None) -> Recall:
    """The state to go on with: what still fits, less sure by its age. Never raises for what `body` holds."""
    tuning = setup.settings.estimator.tuning()
    age_s, doubt = age(body, now_ns, boot or this_boot())
    said = [doubt] if doubt else []
    state, taken = initial_state(tuning), list[str]()
    plain = as_plain(state)
    here, there = setup.settings.service.sensor, body.get("sensor")
    if here != there:
        said.append(f"service.sensor is {_short(here)}, the offsets are those of {_short(there)}: all are learnt anew")
    for name in setup.channels if here == there else ():
        channel, why = _channel(setup, tuning, body, plain, name)
        if channel is None:
            said.append(f"{name}: {why}; its offset is learnt anew")
        else:
            channel = parked(channel, getattr(tuning, name), *_parking(setup, name), age_s)
            state, taken = state._replace(**{name: channel}), [*taken, name]  # type: ignore[arg-type]
    learnt, why = _stiffness(setup, tuning, body, plain)
    if learnt is None:
        said.append(f"cornering stiffness: {why}; it is learnt anew")
    else:
        state = state._replace(stiffness=learnt.stiffness)
    estimator = resumed(state, tuning, age_s) if taken or learnt is not None else None
    return Recall(estimator, age_s, tuple(said), tuple(taken), _temperature(body))


def parked(state: ZeroingState, law: ZeroingTuning, std: float, cooling_s: float, away_s: float) -> ZeroingState:
    """The channel after the car's temperature has had `away_s` to change: up to `std` off, never beyond the data sheet.

    The temperature goes as 1 - exp(-t/T), and the offset with it; the drift with age comes on top, see `zeroing.held`.
    """
    moved = std * -math.expm1(-away_s / cooling_s)
    grown = min(state.variance + moved * moved, law.prior_std**2)
    return state._replace(variance=max(state.variance, grown))


def _parking(setup: Setup, name: str) -> tuple[float, float]:
    """How far the channel's offset may move while parked (SI), and the cooling's time constant."""
    service = setup.settings.service
    if name in GYRO_CHANNELS:
        return service.parked_gyro_std_degps * QUANTITIES[name].units["deg/s"], service.parked_cooling_s
    return service.parked_accel_std_mps2, service.parked_cooling_s


def _channel(setup: Setup, tuning: Tuning, body: Body, plain: Body, name: str) -> tuple[ZeroingState | None, str]:
    """One channel's saved state, or None and why it is not taken over."""
    saved = _mapping(_mapping(body.get("channels")).get(name))
    if not saved:
        return None, "nothing was saved of it"
    changed = _changed(_mapping(saved.get("source")), _source(setup, name))
    if changed:
        return None, f"it is read from elsewhere or otherwise than when it was learnt ({changed})"
    try:
        state: ZeroingState = getattr(from_plain({**plain, name: saved.get("learnt")}), name)
    except ValueError as error:
        return None, f"what was saved makes no sense: {error}"
    c = tuning.c_y if name == "accel_y" else 1.0
    why = unreachable_zeroing(state, getattr(tuning, name), c, tuning.block_s)
    return (None, f"what was saved can't have been learnt: {why}") if why else (state, "")


def _stiffness(setup: Setup, tuning: Tuning, body: Body, plain: Body) -> tuple[EstimatorState | None, str]:
    """A state with the saved stiffness, or None and why it is not taken over."""
    saved = _mapping(body.get("stiffness"))
    if not saved:
        return None, "nothing was saved of it"
    changed = _changed(_mapping(saved.get("source")), _stiffness_source(setup))
    if changed:
        return None, f"the car, or what it is learnt from, is configured otherwise ({changed})"
    learnt = {**_mapping(saved.get("learnt")), "smoothed_yaw_radps": math.nan}
    try:
        state = from_plain({**plain, "stiffness": learnt})
    except ValueError as error:
        return None, f"what was saved makes no sense: {error}"
    why = unreachable_stiffness(state.stiffness, tuning)
    return (None, f"what was saved can't have been learnt: {why}") if why else (state, "")


def _source(setup: Setup, role: str) -> Body:
    """How a role is read, as plain values: whoever changes one of them reads another sensor, or otherwise."""
    resolved = setup.checked.resolved
    source = next(source for source in resolved.sources if source.role == role)
    message = resolved.messages[source.message]
    signals = {signal.name: signal for signal in message.signals}
    return {
        "message": source.message,
        "id": message.frame_id,
        "extended": bool(message.is_extended_frame),
        "channel": source.channel,
        "sign": source.sign,
        "to_si": source.to_si,
        "adc": [source.volts_per_count, source.null_volts, source.volts_per_unit],
        "signals": [
            {
                "name": part.signal,
                "sign": part.sign,
                "bits": [signals[part.signal].start, signals[part.signal].length, signals[part.signal].byte_order],
                "number": ["unsigned", "signed", "float"][
                    2 if signals[part.signal].is_float else signals[part.signal].is_signed
                ],
                "scale": float(signals[part.signal].scale),
                "offset": float(signals[part.signal].offset),
                "page": signals[part.signal].multiplexer_ids,
            }
            for part in source.parts
        ],
    }


def _stiffness_source(setup: Setup) -> Body:
    roles = [role for role in _STIFFNESS_ROLES if role in setup.roles]
    vehicle = setup.settings.vehicle.model_dump(mode="json")
    return {
        **{f"vehicle.{key}": value for key, value in vehicle.items()},
        **{role: _source(setup, role) for role in roles},
    }


def _changed(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Names of what differs."""
    return ", ".join(sorted(key for key in {*old, *new} if key not in old or key not in new or old[key] != new[key]))


def _temperature(body: Body) -> float | None:
    value, quantity = body.get("temperature_degc"), QUANTITIES["temperature"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not quantity.low <= value <= quantity.high:
        return None
    return float(value)


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _short(value: Any) -> str:
    return repr(value[:60]) if isinstance(value, str) else "an unnamed one" if value is None else "something else"
