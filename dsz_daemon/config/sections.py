"""What all sections of the configuration share: strictness, numbers, fields with bounds."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict


class Section(BaseModel):
    """A mapping of the YAML file: frozen, and a key that is not declared is a fault."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


# Strict: `true` is not 1.0 and "1673 kg" is not a number, whatever a lenient parser could make of it.
Number = Annotated[float, Strict()]
Whole = Annotated[int, Strict()]
Text = Annotated[str, Strict(), Field(min_length=1)]


def bounded(low: float, high: float, why: str, default: Any = ..., noun: str | None = None) -> Any:
    """A number within [low, high]; `why` is what an editor shows, `noun` what messages call it.

    The unit is in the field's name. Without a default the key is required.
    """
    return Field(default, ge=low, le=high, description=why, title=noun)


# What names end in -> what a message prints; the longest suffix that fits counts.
_SUFFIX_UNITS = {
    "_kg": "kg",
    "_kgm2": "kg m^2",
    "_m": "m",
    "_n_per_rad": "N/rad",
    "_rad_per_mps2": "rad per m/s^2",
    "_rad": "rad",
    "_deg": "deg",
    "_deg2": "deg^2",
    "_deg2s": "deg^2 s",
    "_degps": "deg/s",
    "_mps": "m/s",
    "_mps2": "m/s^2",
    "_m2ps2": "m^2/s^2",
    "_per_s": "1/s",
    "_hz": "Hz",
    "_s": "s",
}


def unit_in_name(name: str) -> tuple[str, str]:
    """A setting's name split into words and unit; the unit is empty for a pure number.

    >>> unit_in_name("front_cornering_stiffness_n_per_rad")
    ('front cornering stiffness', 'N/rad')
    >>> unit_in_name("steering_ratio")
    ('steering ratio', '')
    """
    suffixes = [suffix for suffix in _SUFFIX_UNITS if name.endswith(suffix)]
    suffix = max(suffixes, key=len, default="")
    return name.removesuffix(suffix).replace("_", " "), _SUFFIX_UNITS.get(suffix, "")
