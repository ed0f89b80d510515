"""The whole configuration, typed. `vehicle` and `signals` are enough; the rest has defaults."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, Strict

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.config.sections import Number, Section, Text, Whole, bounded
from dsz_daemon.config.signal_settings import SignalsSettings
from dsz_daemon.config.vehicle import VehicleSettings

# The contract's tolerance of the nominal simulation: tyres wear and warm up, the rest is measured.
_TOLERANCE = {"front_cornering_stiffness_n_per_rad": 0.1, "rear_cornering_stiffness_n_per_rad": 0.1}


class BusSettings(Section):
    """One bus: python-can's arguments. The one place where further keys are handed on as they are."""

    model_config = ConfigDict(extra="allow")

    interface: Text = Field(description="python-can interface: socketcan, pcan, vector, udp_multicast, ...")
    channel: Annotated[str, Strict()] | Whole | None = None
    bitrate: Whole | None = Field(None, ge=1, description="bit/s; on socketcan it is set by `ip link` instead")
    fd: bool | None = None

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments for `can.Bus`, without those that were not given."""
        return self.model_dump(exclude_none=True)


class OutputSettings(Section):
    """The messages of `dbc/dsz.dbc`."""

    bus: Text | None = Field(None, description="bus to publish on; the first one, where not given")
    base_id: Whole = bounded(0, 0x1FFFFFFF, "id of the first message; the others follow", 0x6D0)
    extended: bool = Field(False, description="29-bit ids")
    cycle_s: Number = bounded(0.001, 10, "cycle of rates and accelerations", 0.01)
    status_cycle_s: Number = bounded(0.001, 60, "cycle of offsets and status", 0.1)
    e2e_data_id: Whole = bounded(0, 255, "where the AUTOSAR E2E data ids begin", 0x40)


class LoopSettings(Section):
    """The fixed-rate loop."""

    rate_hz: Number = bounded(20, 500, "rows per second", 100)
    # Slowest useful wheel speed frames come at 10 Hz: five in a row may be lost.
    stale_after_s: Number = bounded(0.02, 10, "a signal older than this is not used", 0.5, "staleness limit")
    gap_s: Number = bounded(0.02, 3600, "a silence longer than this is a gap: filters start anew", 1.0)
    clock_step_s: Number = bounded(0.01, 3600, "a stamp this far back is a step of the clock", 1.0)


class ServiceSettings(Section):
    """The daemon as a service."""

    state_file: Text | None = Field(None, description="where offsets are kept across restarts")


class DiagnoseSettings(Section):
    """Simulation against recording."""

    tolerance: Annotated[
        dict[str, Annotated[Number, Field(ge=0, le=1)]],
        BeforeValidator(lambda given: {**_TOLERANCE, **given} if isinstance(given, dict) else given),
    ] = Field(
        _TOLERANCE,
        description="share by which a configured vehicle parameter may be off; 0 where not given",
    )


class Settings(Section):
    """A configuration file."""

    vehicle: VehicleSettings
    signals: SignalsSettings
    bus: dict[str, BusSettings] = Field(
        default_factory=dict, description="live buses by name; one `can0` on socketcan, where not given"
    )
    output: OutputSettings = OutputSettings()
    loop: LoopSettings = LoopSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    service: ServiceSettings = ServiceSettings()
    diagnose: DiagnoseSettings = DiagnoseSettings()

    @property
    def buses(self) -> dict[str, BusSettings]:
        """The live buses by name, at least one."""
        return self.bus or {"can0": BusSettings(interface="socketcan", channel="can0")}

    @property
    def output_bus(self) -> str:
        """Name of the bus that is published on."""
        return self.output.bus or next(iter(self.buses))

    def used(self) -> dict[str, Any]:
        """Every setting in force, as plain JSON values (the summary's "settings used")."""
        return self.model_dump(mode="json", exclude_none=True)
