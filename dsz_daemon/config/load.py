"""A configuration file to typed settings; every fault at once, each with its line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from dsz_daemon.config.cross_checks import cross_faults
from dsz_daemon.config.document import Document, Loc, read_document
from dsz_daemon.config.explain import explained
from dsz_daemon.config.settings import BusSettings, Settings
from dsz_daemon.errors import ConfigError, Fault

# Nobody reads more, and explaining each of a hundred thousand takes minutes.
_MOST_FAULTS = 200


class Checked(NamedTuple):
    """A file's settings (None where faults forbid them) and its faults, by location as well."""

    document: Document
    settings: Settings | None
    faults: tuple[Fault, ...]
    fault_locs: tuple[Loc, ...]


def load_settings(path: Path) -> Settings:
    """The settings of `path`; one ConfigError with all faults."""
    checked = checked_settings(path)
    if checked.settings is None:
        raise refusal(path, checked.faults)
    return checked.settings


def checked_settings(path: Path) -> Checked:
    """As `load_settings`, but faults are returned; ConfigError only for what is no YAML mapping."""
    document = read_document(path)
    data = completed(Settings, document.data)
    found: list[tuple[Loc, str]] = []
    settings = None
    try:
        settings = Settings.model_validate(data)
    except ValidationError as error:
        found += explained(error, Settings, _MOST_FAULTS)
    seen = {loc for loc, _ in found}
    # One fault a place: what is missing or mistyped is said once, by whoever saw it first.
    found += [(loc, what) for loc, what in cross_faults(data) if loc not in seen]
    if len(found) > 2 * _MOST_FAULTS:
        found[2 * _MOST_FAULTS :] = [((), f"and {len(found) - 2 * _MOST_FAULTS} faults more")]
    faults = (*document.faults, *(Fault(document.where(loc), what) for loc, what in found))
    return Checked(document, None if faults else settings, faults, tuple(loc for loc, _ in found))


def refusal(path: Path, faults: Sequence[Fault]) -> ConfigError:
    """The one error that carries them all, in the order of the file."""
    ordered = in_order(faults)
    return ConfigError(f"{path}: {len(ordered)} fault{'s'[: len(ordered) > 1]} in the configuration", ordered)


def in_order(faults: Sequence[Fault]) -> list[Fault]:
    """By line, as one reads the file."""
    return sorted(faults, key=_line)


def _line(fault: Fault) -> int:
    number = fault.where.split(": ")[0].rpartition(":")[2]
    return int(number) if number.isdigit() else 0


def completed(model: type[BaseModel], data: Mapping[str, Any]) -> dict[str, Any]:
    """`data` with what it leaves out of a section that has a default as a whole.

    `estimator: {yaw_rate: {window_s: 200}}` changes that one value of the yaw rate's law; all
    the others stay as they are by default there.
    """
    result = dict(data)
    for name, field in model.model_fields.items():
        default, given = field.default, data.get(name)
        if isinstance(default, BaseModel) and isinstance(given, Mapping):
            below = completed(type(default), given)
            result[name] = {**_given(default), **below}
    return result


def _given(default: BaseModel) -> dict[str, Any]:
    """The values that a default was made with; those of its own defaults come by themselves."""
    return {name: getattr(default, name) for name in default.model_fields_set}


def override_bus(settings: Settings, overrides: Sequence[str] = ()) -> Settings:
    """Settings for a live run, with `NAME=INTERFACE:CHANNEL` (as of `--bus`) in, or added to, `bus`.

    ConfigError with every fault: what does not parse, and channels that are then no bus.
    """
    faults: list[Fault] = []
    given: dict[str, BusSettings] = {}
    for text in overrides:
        try:
            name, bus = parsed_bus(text)
        except ValueError as error:
            faults.append(Fault(f"--bus {text}", str(error)))
            continue
        if name in given:
            faults.append(Fault(f"--bus {text}", f"bus {name!r} is given twice"))
        given[name] = bus
    result = settings.model_copy(update={"bus": {**settings.bus, **given}})
    wanted = {f"signals.{role}": s.channel for role, s in settings.signals.roles.items()}
    wanted["output"] = settings.output.bus
    if not faults:
        faults += [
            Fault(f"{where}.{'bus' if where == 'output' else 'channel'}", f"{name!r} is not a bus; expected "
                  f"{' or '.join(result.buses)}, or --bus {name}=INTERFACE:CHANNEL")
            for where, name in wanted.items()
            if name is not None and name not in result.buses
        ]  # fmt: skip
    if faults:
        raise ConfigError("the live buses are not all there", faults)
    return result


def parsed_bus(text: str) -> tuple[str, BusSettings]:
    """`can0=socketcan:vcan0` -> name and bus; ValueError says what is missing.

    >>> parsed_bus("can0=socketcan:vcan0")[1].arguments
    {'interface': 'socketcan', 'channel': 'vcan0'}
    """
    name, equals, rest = text.partition("=")
    # Only the first colon separates: channels such as ff15::1 have colons of their own.
    interface, colon, channel = rest.partition(":")
    if not (equals and colon and name.strip() and interface.strip() and channel.strip()):
        raise ValueError("expected NAME=INTERFACE:CHANNEL, e.g. can0=socketcan:vcan0")
    return name.strip(), BusSettings(interface=interface.strip(), channel=channel.strip())
