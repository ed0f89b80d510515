"""The mapping against the DBC: what decode needs, and every name, unit and layout that does not fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Message, Signal

from dsz_daemon.config.cross_checks import cross_faults
from dsz_daemon.config.nearest import did_you_mean
from dsz_daemon.config.protection import ProtectionSettings
from dsz_daemon.config.protection_lookup import protection_lookup
from dsz_daemon.config.settings import Settings
from dsz_daemon.config.signal_settings import SWITCHES, SignalSettings, SignalsSettings, SwitchSignal
from dsz_daemon.config.units import canonical_unit
from dsz_daemon.config.vehicle import VehicleSettings
from dsz_daemon.edge.dbc import LoadedDbc, load_dbc
from dsz_daemon.errors import ConfigError, DszError, Fault, InputError
from dsz_daemon.pipeline.mapping import Part, Source
from dsz_daemon.pipeline.protection import Protection
from dsz_daemon.signals import QUANTITIES, WHEEL_ROTATION_UNITS, WHEEL_SPEEDS

Where = Callable[[Sequence[str | int]], str]


class ResolvedSignals(NamedTuple):
    """What decode needs: the sources, the message of each name that they use, and how messages are protected.

    `warnings` are likely mistakes, `notes` what one should know.
    """

    sources: tuple[Source, ...]
    messages: dict[str, Message]
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    protections: tuple[Protection, ...] = ()


class Resolution(NamedTuple):
    """What could be resolved, and the faults; `input_faults` are those of unreadable DBC files."""

    signals: ResolvedSignals
    faults: tuple[Fault, ...]
    input_faults: tuple[Fault, ...]


def dotted(loc: Sequence[str | int]) -> str:
    """A location without a file: `signals.gyro_x.message`."""
    return ".".join(str(part) for part in loc)


def resolve(settings: Settings, base: Path, where: Where = dotted) -> ResolvedSignals:
    """Sources and messages of `settings`; DBC paths are relative to the folder `base`.

    ConfigError with every fault (InputError where a DBC can't be read is all there is).
    """
    crossed = [Fault(where(loc), what) for loc, what in cross_faults(settings.model_dump(exclude_unset=True))]
    found = resolution(settings.signals, settings.vehicle, base, where, settings.protection)
    raise_faults("the signals do not fit the DBC", (*crossed, *found.faults), found.input_faults)
    return found.signals


def raise_faults(message: str, faults: Sequence[Fault], input_faults: Sequence[Fault] = ()) -> None:
    """One error with all faults: the configuration's, or the input's where there are no others."""
    if faults:
        raise ConfigError(message, (*faults, *input_faults))
    if input_faults:
        raise InputError(message, input_faults)


def resolution(
    signals: SignalsSettings,
    vehicle: VehicleSettings,
    base: Path,
    where: Where,
    protection: Mapping[str, ProtectionSettings],
) -> Resolution:
    """Every role and every protection looked up; never raises for what is wrong in the files."""
    dbcs, faults, input_faults = _loaded(signals.dbc, base, where)
    complete = len(dbcs) == len(signals.dbc)
    sources: list[Source] = []
    messages: dict[str, Message] = {}
    warnings: list[str] = []
    for role, signal in signals.roles.items():
        found = [(dbc, m) for dbc in dbcs for m in dbc.database.messages if m.name == signal.message]
        if not found:
            # With a DBC missing, what can't be found may be in that one.
            if complete:
                faults.append(Fault(where(("signals", role, "message")), _no_message(signal, dbcs)))
            continue
        message = found[0][1]
        if signal.message not in messages:
            messages[signal.message] = message
            warnings += _message_warnings(found)
        missing = _missing_signals(role, signal, message, dbcs, where)
        faults += missing
        if not missing:
            warnings += _unit_warnings(role, signal, message, where)
            sources.append(_source(role, signal, vehicle))
    warnings += _shared_ids(sources, messages)
    protected = protection_lookup(protection, messages, dbcs, where, complete)
    warnings += protected.warnings
    notes = tuple(text for dbc in dbcs for text in dbc.warnings)
    resolved = ResolvedSignals(tuple(sources), messages, tuple(warnings), notes, protected.protections)
    return Resolution(resolved, (*faults, *protected.faults), tuple(input_faults))


def _loaded(names: Iterable[str], base: Path, where: Where) -> tuple[list[LoadedDbc], list[Fault], list[Fault]]:
    dbcs: list[LoadedDbc] = []
    faults: list[Fault] = []
    input_faults: list[Fault] = []
    place = where(("signals", "dbc"))
    for name in names:
        try:
            dbcs.append(load_dbc(name, base))
        except ConfigError as error:
            faults += [Fault(place, str(fault)) for fault in error.faults]
        except DszError as error:
            input_faults.append(Fault(place, error.message))
    return dbcs, faults, input_faults


def _no_message(signal: SignalSettings, dbcs: Sequence[LoadedDbc]) -> str:
    names = [message.name for dbc in dbcs for message in dbc.database.messages]
    files = ", ".join(dbc.name for dbc in dbcs)
    elsewhere = _home_of([part.signal for part in signal.parts], dbcs)
    return f"message {signal.message!r} is not in {files}{did_you_mean(signal.message, names)}{elsewhere}"


def _home_of(signals: Iterable[str], dbcs: Sequence[LoadedDbc]) -> str:
    """`; signal 'X' is in message 'Y'` where there are such, three at most."""
    homes = [
        f"; signal {name!r} is in message {message.name!r}"
        for name in signals
        for dbc in dbcs
        for message in dbc.database.messages
        if any(signal.name == name for signal in message.signals)
    ]
    return "".join(homes[:3])


def _missing_signals(
    role: str, signal: SignalSettings, message: Message, dbcs: Sequence[LoadedDbc], where: Where
) -> list[Fault]:
    names = [s.name for s in message.signals]
    wanted: list[tuple[tuple[str | int, ...], str]] = []
    if signal.signal is not None:
        wanted.append((("signal",), signal.signal))
    wanted += [(("signals", i, "signal"), part.signal) for i, part in enumerate(signal.signals)]
    if signal.valid_signal is not None:
        wanted.append((("valid_signal",), signal.valid_signal))
    return [
        Fault(
            where(("signals", role, *key)),
            f"message {message.name!r} has no signal {name!r}{did_you_mean(name, names)}{_home_of([name], dbcs)}",
        )
        for key, name in wanted
        if name not in names
    ]


def _message_warnings(found: Sequence[tuple[LoadedDbc, Message]]) -> list[str]:
    """A message that two DBCs describe differently; one whose signals overlap."""
    first, message = found[0]
    warnings = [
        f"message {message.name!r} differs between {first.name} and {other.name}; the first is used"
        for other, again in found[1:]
        if _layout(again) != _layout(message)
    ]
    try:
        message.refresh(strict=True)
    except Exception as error:  # cantools has no class of its own for it in all versions
        message.refresh(strict=False)
        warnings.append(f"message {message.name!r} of {first.name} is in doubt: {' '.join(str(error).split())}")
    return warnings


def _layout(message: Message) -> tuple[object, ...]:
    def bits(s: Signal) -> tuple[object, ...]:
        return (s.name, s.start, s.length, s.byte_order, s.is_signed, s.scale, s.offset)

    return (message.frame_id, message.is_extended_frame, sorted(map(bits, message.signals), key=str))


# Units of what an analog sensor's voltage stands for.
_OF_MOTION = frozenset({"rad/s", "deg/s", "m/s^2", "g"})


def _unit_warnings(role: str, signal: SignalSettings, message: Message, where: Where) -> list[str]:
    """Where the DBC names another unit than the configuration. Unknown spellings are not judged."""
    warnings = []
    for part in signal.parts:
        dbc_unit = message.get_signal_by_name(part.signal).unit
        known = canonical_unit(dbc_unit)
        if signal.volts_per_count is not None:
            if known in _OF_MOTION:
                warnings.append(
                    f"{where(('signals', role, 'volts_per_count'))}: volts per count, but by the DBC "
                    f"{message.name}.{part.signal} is in {dbc_unit!r} already"
                )
        elif known is not None and signal.unit not in {known, "1"}:
            warnings.append(
                f"{where(('signals', role, 'unit'))}: configured as {signal.unit}, but the DBC says "
                f"{dbc_unit!r} for {message.name}.{part.signal}"
            )
    return warnings


def _shared_ids(sources: Sequence[Source], messages: dict[str, Message]) -> list[str]:
    """Messages of one id that could come from one channel: each frame would be read as both."""
    warnings: list[str] = []
    used = list(dict.fromkeys((s.message, s.channel) for s in sources))
    for i, (name, channel) in enumerate(used):
        for other, other_channel in used[:i]:
            a, b = messages[name], messages[other]
            same_id = (a.frame_id, a.is_extended_frame) == (b.frame_id, b.is_extended_frame)
            if name != other and same_id and (None in {channel, other_channel} or channel == other_channel):
                warnings.append(
                    f"messages {other!r} and {name!r} share id 0x{a.frame_id:X}: every such frame is read as "
                    "both; give their signals a channel each"
                )
    return list(dict.fromkeys(warnings))


def _source(role: str, signal: SignalSettings, vehicle: VehicleSettings) -> Source:
    quantity = QUANTITIES[role]
    to_si = quantity.units[signal.unit]
    if role in WHEEL_SPEEDS and signal.unit in WHEEL_ROTATION_UNITS:
        to_si *= getattr(vehicle.wheel_radius_m, role[-2:])
    analog = signal.volts_per_count is not None
    return Source(
        role=role,
        message=signal.message,
        parts=tuple(Part(part.signal, float(part.sign)) for part in signal.parts),
        to_si=to_si,
        low=quantity.low,
        high=quantity.high,
        channel=signal.channel,
        sign=float(signal.sign),
        volts_per_count=signal.volts_per_count,
        null_volts=signal.null_volts if analog else 0.0,
        volts_per_unit=signal.volts_per_unit if analog and signal.volts_per_unit is not None else 1.0,
        on_values=signal.on_values if isinstance(signal, SwitchSignal) else (),
        valid_signal=signal.valid_signal,
        valid_values=signal.valid_values,
        is_switch=role in SWITCHES,
    )
