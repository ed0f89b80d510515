"""The whole configuration, typed. `vehicle` and `signals` are enough; the rest has defaults."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, Strict

from dsz_daemon.config.estimator import EstimatorSettings
from dsz_daemon.config.protection import ProtectionSettings
from dsz_daemon.config.sections import Number, Section, Text, Whole, bounded
from dsz_daemon.config.signal_settings import SignalsSettings
from dsz_daemon.config.vehicle import VehicleSettings
from dsz_daemon.config.watch import WatchSettings

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
    on_conflict: Literal["refuse", "report", "move"] = Field(
        "report",
        description="when someone else sends one of our ids: report = say so and go on, refuse = leave that id to him "
        "while he does, move = go over to spare_base_id",
    )
    spare_base_id: Whole | None = Field(None, ge=0, le=0x1FFFFFFF, description="where `on_conflict: move` moves to")


class LoopSettings(Section):
    """The fixed-rate loop."""

    rate_hz: Number = bounded(20, 500, "rows per second", 100)
    # Slowest useful wheel speed frames come at 10 Hz: five in a row may be lost.
    stale_after_s: Number = bounded(0.02, 10, "a signal older than this is not used", 0.5, "staleness limit")
    gap_s: Number = bounded(0.02, 3600, "a silence longer than this is a gap: filters start anew", 1.0)
    clock_step_s: Number = bounded(0.01, 3600, "a stamp this far back is a step of the clock", 1.0)
    # Fastest IMU messages on CAN come at 1 kHz; twice that. A bus of 500 kbit/s can hold some 4000 frames/s.
    input_rate_limit_hz: Number = bounded(
        10, 100000, "frames of one message beyond this rate are not used (a babbling sender)", 2000
    )
    # A bus, gateway or logger that hitched hands over at once what came meanwhile; what is older than
    # stale_after_s is of no use anyway.
    input_burst_s: Number = bounded(0, 60, "so long a time's frames may come at once", 0.5)
    # Drivers and USB adapters hand frames over up to a millisecond after their stamp; twice that.
    guard_s: Number = bounded(
        0, 0.05, "live: how long a tick waits for frames that are stamped before it and on their way", 0.002
    )


class ServiceSettings(Section):
    """The daemon as a service."""

    state_file: Text | None = Field(
        None, description="where offsets are kept across restarts; under systemd offsets.json in its state directory"
    )
    # A minute of learning is what a power cut may cost; flash memory bears one small write a minute for decades.
    save_period_s: Number = bounded(0.05, 3600, "how often the offsets are saved", 60)
    sensor: Text | None = Field(
        None, description="names the very IMU (its serial number): offsets learnt on another one are not taken over"
    )
    # Data sheets: consumer gyros move by 0.01 to 0.05 deg/s a kelvin, accelerometers by 0.1 to 1 mg. Between a
    # heated cabin and a cold morning lie some 30 K: up to 1.5 deg/s and 0.3 m/s^2, as spreads a half or less of it.
    # Further growth with age is the estimator's own drift, up to the data sheet's spread.
    parked_gyro_std_degps: Number = bounded(
        0, 30, "how far a gyro's offset may move while the car is parked, cooling down or heating up", 0.5
    )
    parked_accel_std_mps2: Number = bounded(
        0, 10, "how far an accelerometer's offset may move while the car is parked, cooling down or heating up", 0.2
    )
    # A switched-off box cools within 5 to 10 min, a cabin within half an hour.
    parked_cooling_s: Number = bounded(
        1, 86400, "time in which a parked car has gone two thirds of the way to the outside temperature", 1200
    )
    status_socket: Text | None = Field(
        None, description="Unix socket that `dsz status` asks; under systemd status.sock in its runtime directory"
    )
    wait_for_bus: bool | None = Field(
        None, description="wait for an interface that is not there yet; not given: as a service yes, by hand no"
    )
    realtime_priority: Whole = bounded(0, 99, "SCHED_FIFO priority; 0: an ordinary process", 0)
    lock_memory: bool = Field(False, description="mlockall: never wait for a page")
    cpu: Whole | None = Field(None, ge=0, le=4095, description="the one CPU to run on")


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
    protection: dict[str, ProtectionSettings] = Field(
        default_factory=dict, description="checksums and alive counters of input messages, by the message's name"
    )
    loop: LoopSettings = LoopSettings()
    watch: WatchSettings = WatchSettings()
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
