"""Configured parameters that fit better otherwise."""

from __future__ import annotations

from dsz_daemon.diagnose.effects.nuisances import TOLERATED
from dsz_daemon.diagnose.fitting.model import values_of
from dsz_daemon.diagnose.residuals.comparison import Each
from dsz_daemon.diagnose.residuals.evidence import LEAST_GAIN
from dsz_daemon.diagnose.selection import search as searching
from dsz_daemon.diagnose.selection.search import Search
from dsz_daemon.diagnose.verdict.said import ParameterError

_TOLERATED_SPREADS, _LEAST_STIFFNESS, _LEAST_TOLERATED = 3.0, 0.03, 0.005
# A stiffness that gains less of what all causes gain only takes up what the simulation's form gets wrong about these.
_STIFFNESS_SHARE = 0.05
# What is configured, by the effect that it is where it is off by more than its tolerance.
TYRES = "cornering_stiffness"
BEYOND = {
    TYRES: {f"{axle}_cornering_stiffness_n_per_rad": f"{axle}_scale" for axle in ("front", "rear")},
    "track_width": {f"{axle}_track_m": axle for axle in ("front", "rear")},
    "yaw_inertia": {"yaw_inertia_kgm2": "share"},
}


def parameter_errors(found: Search, each: Each) -> list[ParameterError]:
    """Configured parameters that fit better otherwise: by more than their spread, and on unseen data."""
    values, beyond = values_of(found.drive, found.best, ""), set[str]()
    for effect in set(BEYOND) & set(found.best.effects):
        far = values_of(found.drive, found.best, effect)
        values |= {key: far[name] for key, name in BEYOND[effect].items()}
        beyond |= set(BEYOND[effect])
    off = dict[str, tuple[float, float]]()
    for parameter in TOLERATED:
        share, std = values.get(parameter.name, (0.0, 0.0))
        least = _LEAST_STIFFNESS if "stiffness" in parameter.name else _LEAST_TOLERATED
        if abs(share) > max(_TOLERATED_SPREADS * std, least):
            off[parameter.name] = share, std
    # What is beyond its tolerance has earned its place already.
    asked = max(LEAST_GAIN, _STIFFNESS_SHARE * sum(found.gains.values()))
    if not set(off) <= beyond and searching.tolerance_gain(found, each) < asked:
        off = {key: told for key, told in off.items() if key in beyond}
    errors = []
    for key, (share, std) in off.items():
        configured = found.drive.steering_ratio if key == "steering_ratio" else float(getattr(found.drive.car, key))
        errors.append(ParameterError(key, configured, configured * (1.0 + share), configured * std))
    return errors
