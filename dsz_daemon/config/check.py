"""`dsz check`: a configuration, its DBC and whatever else can be known before the first frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from dsz_daemon.config.advice import notes_of, warnings_of
from dsz_daemon.config.document import Document
from dsz_daemon.config.load import Checked, checked_settings, completed, in_order, refusal
from dsz_daemon.config.protection import ProtectionSettings, protection_faults
from dsz_daemon.config.resolution import Resolution, ResolvedSignals, resolution, resolve
from dsz_daemon.config.settings import Settings
from dsz_daemon.config.signal_settings import SignalsSettings
from dsz_daemon.config.vehicle import VehicleSettings
from dsz_daemon.errors import Fault, InputError
from dsz_daemon.signals import QUANTITIES

__all__ = ["CheckResult", "ResolvedSignals", "check_configuration", "resolve"]

ExtraCheck = Callable[[Settings], list[Fault]]


class CheckResult(NamedTuple):
    """A configuration without faults, ready to run, and what is to be said about it."""

    settings: Settings
    resolved: ResolvedSignals
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def check_configuration(path: Path, extra_checks: Sequence[ExtraCheck] = ()) -> CheckResult:
    """Settings and resolved signals of `path`.

    Raises one ConfigError with every fault: of the file, of the mapping against its DBC, and
    of `extra_checks`, which get the settings and may name places as `estimator.observer`
    (they run only on settings that are valid in themselves). InputError where a DBC that
    can't be read is all that is wrong.
    """
    checked = checked_settings(path)
    document, settings = checked.document, checked.settings
    found = _resolution(checked, path.parent)
    extra = [
        _placed(fault, document)
        for check in (extra_checks if settings else ())
        for fault in check(settings)  # type: ignore[arg-type] # not None: the line above
    ]
    faults = [*checked.faults, *(found.faults if found else ()), *extra]
    unreadable = found.input_faults if found else ()
    if faults:
        raise refusal(path, [*faults, *unreadable])
    if unreadable:
        raise InputError(f"{path}: a DBC can't be read", in_order(unreadable))
    if settings is None or found is None:
        raise RuntimeError("no settings although there is no fault")
    return CheckResult(
        settings,
        found.signals,
        (*found.signals.warnings, *warnings_of(settings)),
        (*found.signals.notes, *notes_of(settings)),
    )


def _placed(fault: Fault, document: Document) -> Fault:
    """An extra check's fault, with file and line before its dotted place."""
    return Fault(document.where(fault.where.split(".")) if fault.where else document.where(()), fault.what)


def _resolution(checked: Checked, base: Path) -> Resolution | None:
    """The mapping against the DBC, also where something else in the file is wrong."""
    where = checked.document.where
    if checked.settings is not None:
        settings = checked.settings
        return resolution(settings.signals, settings.vehicle, base, where, settings.protection)
    data = checked.document.data
    signals = _sound_part(data.get("signals"))
    return resolution(signals, _ANY_CAR, base, where, _sound_entries(data.get("protection"))) if signals else None


def _sound_part(data: Any) -> SignalsSettings | None:
    """The roles that are valid in themselves; the others have their fault already."""
    if not isinstance(data, dict):
        return None
    dbc = {"dbc": data.get("dbc")}
    sound = {role: data[role] for role in QUANTITIES if role in data and _valid({**dbc, role: data[role]})}
    return _valid({**dbc, **sound})


def _sound_entries(data: Any) -> dict[str, ProtectionSettings]:
    """The messages' protections that are valid in themselves, likewise."""
    sound = {}
    for message, entry in data.items() if isinstance(data, dict) else ():
        try:
            settings = ProtectionSettings.model_validate(entry)
        except ValidationError:
            continue
        if not list(protection_faults({message: entry})):
            sound[message] = settings
    return sound


def _valid(data: dict[str, Any]) -> SignalsSettings | None:
    try:
        return SignalsSettings.model_validate(completed(SignalsSettings, data))
    except ValidationError:
        return None


# Stands in for a vehicle section that is not valid: names are looked up, values are not used.
_ANY_CAR = VehicleSettings(
    mass_kg=1500,
    yaw_inertia_kgm2=2500,
    cg_to_front_axle_m=1.2,
    cg_to_rear_axle_m=1.4,
    front_cornering_stiffness_n_per_rad=60000,
    rear_cornering_stiffness_n_per_rad=60000,
)
