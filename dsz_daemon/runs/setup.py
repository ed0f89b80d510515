"""From a configuration file to a loop, a decoder and an encoder: the same for every run."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

from dsz_daemon import __version__
from dsz_daemon.config.check import CheckResult, check_configuration
from dsz_daemon.config.load import override_bus
from dsz_daemon.config.settings import BusSettings, Settings
from dsz_daemon.config.stability_check import stability_faults
from dsz_daemon.core.state import EstimatorState
from dsz_daemon.edge.dbc import load_dbc
from dsz_daemon.errors import ConfigError, Fault
from dsz_daemon.pipeline.decode import DecodeCounters, Decoder
from dsz_daemon.pipeline.encode import Encoder, EncoderState
from dsz_daemon.pipeline.loop import Loop, LoopSettings
from dsz_daemon.pipeline.plausibility import Plausibility
from dsz_daemon.pipeline.rate_bound import RateBound
from dsz_daemon.shipped import shipped
from dsz_daemon.signals import IMU_CHANNELS

# As `config.cross_checks` has it: more than dbc/dsz.dbc has messages.
_IDS_SET_ASIDE = 16
# Where else to, the nearest first, up to where diagnostics begin.
_LOWEST_ID, _DIAGNOSTICS = 0x100, 0x7D0


@dataclass(frozen=True)
class Setup:
    """A checked configuration, ready to run."""

    path: Path
    settings: Settings
    checked: CheckResult

    @cached_property
    def roles(self) -> frozenset[str]:
        """All mapped roles."""
        return frozenset(source.role for source in self.checked.resolved.sources)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """The mapped IMU channels in the vocabulary's order."""
        return tuple(name for name in IMU_CHANNELS if name in self.roles)

    @property
    def output_bus(self) -> str:
        """The bus that compensated frames go to: the configured one, else the first."""
        return self.settings.output.bus or next(iter(self.settings.buses))

    def on_buses(self, buses: dict[str, BusSettings]) -> Setup:
        """The same on other buses."""
        return replace(self, settings=self.settings.model_copy(update={"bus": buses}))

    def encoder(self, state: EncoderState | None = None, spare: bool = False) -> Encoder:
        """An encoder for the configured ids (or the spare ones), cycles and bus; `state` resumes an earlier one."""
        output, rate_hz = self.settings.output, self.settings.loop.rate_hz
        return Encoder(
            load_dbc(str(shipped("dbc/dsz.dbc")), Path()).database,
            base_id=output.spare_base_id if spare and output.spare_base_id is not None else output.base_id,
            state=state,
            extended=output.extended,
            channel=self.output_bus,
            e2e_data_id=output.e2e_data_id,
            period_ticks=max(1, round(output.cycle_s * rate_hz)),
            status_period_ticks=max(1, round(output.status_cycle_s * rate_hz)),
        )

    def decoder(self, encoder: Encoder, counters: DecodeCounters | None = None) -> Decoder:
        """A decoder for the mapped signals, deaf to what we publish ourselves; `counters` resumes an earlier one."""
        resolved = self.checked.resolved
        excluded = encoder.published_ids
        if self.settings.output.spare_base_id is not None:
            excluded |= self.encoder(spare=True).published_ids
        loop = self.settings.loop
        return Decoder(
            resolved.sources,
            resolved.messages,
            excluded_ids=excluded,
            counters=counters,
            protections=resolved.protections,
            rate_bound=RateBound.of(loop.input_rate_limit_hz, loop.input_burst_s, loop.clock_step_s),
            resync_ns=round(loop.stale_after_s * 1e9),
        )

    def loop(self, decoder: Decoder, estimator: EstimatorState | None = None) -> Loop:
        """The loop over that decoder; `estimator` resumes what was learnt before."""
        chosen, vehicle = self.settings.loop, self.settings.vehicle
        settings = LoopSettings(
            rate_hz=chosen.rate_hz,
            stale_after_s=chosen.stale_after_s,
            gap_s=chosen.gap_s,
            clock_step_s=chosen.clock_step_s,
            steering_ratio=vehicle.steering_ratio,
            watch=self.settings.watch.limits(),
        )
        tuning = self.settings.estimator.tuning()
        return Loop(vehicle.car(), tuning, settings, decoder, self.roles, estimator)

    def plausibility(self) -> Plausibility:
        """The watch over signs, units and axes."""
        return Plausibility(self.settings.vehicle.car(), 1.0 / self.settings.loop.rate_hz)


def set_up(config: Path, buses: Sequence[str] = (), live: bool = False) -> Setup:
    """Reads and checks the configuration; every fault at once as one ConfigError.

    `buses` are the command line's; `live` also asks that every channel named is one of the buses.
    """
    checked = check_configuration(config, extra_checks=(stability_faults,))
    settings = override_bus(checked.settings, buses) if live or buses else checked.settings
    setup = Setup(config, settings, checked)
    if setup.output_bus not in settings.buses:
        known = ", ".join(settings.buses)
        raise ConfigError(f"{config}: output.bus: there is no bus {setup.output_bus!r}; expected one of {known}")
    if "base_id" not in settings.output.model_fields_set:
        setup = _out_of_the_way(setup)
    faults = _id_faults(setup)
    if faults:
        raise ConfigError("\n".join(f"{config}: {fault}" for fault in faults))
    return setup


def _id_faults(setup: Setup) -> list[Fault]:
    """Output ids that mapped messages have, and a move that has nowhere to go."""
    output, faults = setup.settings.output, []
    for key, base_id, spare in (("base_id", output.base_id, False), ("spare_base_id", output.spare_base_id, True)):
        if base_id is None:
            continue
        names = _taken(setup, base_id, spare=spare)
        if names:
            what = f"0x{base_id:X} gives our own messages the ids of {names}, "
            what += "which would never be read; expected ids that no mapped message has"
            faults.append(Fault(f"output.{key}", what))
    if output.on_conflict == "move" and output.spare_base_id is None:
        faults.append(Fault("output.spare_base_id", "not given; `on_conflict: move` needs ids to move to"))
    return faults


def _taken(setup: Setup, base_id: int, *, spare: bool = False) -> str:
    """The mapped messages, by name, that have ids of ours."""
    messages = setup.checked.resolved.messages.values()
    near = [m for m in messages if base_id <= m.frame_id < base_id + _IDS_SET_ASIDE]
    taken = [m for m in near if (m.frame_id, m.is_extended_frame) in setup.encoder(spare=spare).published_ids]
    return ", ".join(f"{message.name} (0x{message.frame_id:X})" for message in taken)


def _out_of_the_way(setup: Setup) -> Setup:
    """With other ids, and a warning, where nobody chose any and a mapped message has one of the usual.

    They are of no message of the DBCs, mapped or not, and none of the spare ones.
    """
    output, checked = setup.settings.output, setup.checked
    names = _taken(setup, output.base_id)
    if not names:
        return setup
    dbcs = [load_dbc(name, setup.path.parent) for name in setup.settings.signals.dbc]
    theirs = {message.frame_id for dbc in dbcs for message in dbc.database.messages}
    spare = output.spare_base_id
    theirs |= set() if spare is None else set(range(spare, spare + _IDS_SET_ASIDE))
    bases = sorted(range(_LOWEST_ID, _DIAGNOSTICS, _IDS_SET_ASIDE), key=lambda base: abs(base - output.base_id))
    free = next((base for base in bases if not theirs & set(range(base, base + _IDS_SET_ASIDE))), None)
    if free is None:
        return setup
    said = (
        f"output.base_id: the usual ids, from 0x{output.base_id:X} on, are those of {names}: "
        f"our own messages have the ids from 0x{free:X} on; give output.base_id to choose others"
    )
    settings = setup.settings.model_copy(update={"output": output.model_copy(update={"base_id": free})})
    checked = checked._replace(settings=settings, warnings=(*checked.warnings, said))
    return replace(setup, settings=settings, checked=checked)


def versions() -> dict[str, Any]:
    """What ran: this project, Python and the libraries that results depend on."""
    found: dict[str, Any] = {"dsz-daemon": __version__, "python": platform.python_version()}
    for name in ("python-can", "cantools", "numpy", "pydantic", "autosar-e2e"):
        found[name] = metadata.version(name)
    return found
