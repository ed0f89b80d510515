"""How large an effect is: size 1 is what `dsz simulate --effect NAME` alone has, smaller ones are nearer to nothing."""

from __future__ import annotations

from dsz_daemon.sim.effects import EFFECTS, Choice

# What these are when nothing is left out; all others are 0.
_AT_ONE = {("wheel_radius", wheel) for wheel in ("fl", "fr", "rl", "rr")} | {
    ("steering_ratio", "scale"),
    ("cornering_stiffness", "front_scale"),
    ("cornering_stiffness", "rear_scale"),
}
# How, not how much.
HOW = {"seed", "correlation_m", "correlation_s", "start_c", "end_c", "time_constant_s", "start_s", "end_s"}


def at_size(name: str, size: float, more: dict[str, float] | None = None) -> Choice | None:
    """The effect with all of its numbers at a size, and `more` of them as they are; None where it has no such size."""
    if name == "axis_fault":
        return Choice(name, {"channel": "accel_x", "kind": "reversed"}) if size == 1.0 else None
    given: dict[str, float | str] = {}
    for key, parameter in EFFECTS[name].parameters.items():
        if parameter.default is None or key in HOW:
            continue
        neutral = 1.0 if (name, key) in _AT_ONE else 0.0
        given[key] = neutral + size * (parameter.default - neutral)
        if key in {"cutoff_hz", "accel_limit_mps2"}:
            given[key] = parameter.default / size
        elif key == "friction_coefficient":
            given[key] = parameter.default / size**0.5
    return Choice(name, given | (more or {}))
