"""The `signals` section: which CAN signal plays which role of the vocabulary.

One class per kind of quantity, so that each role knows its units; `dsz_daemon.signals` has
the same roles and units, and a test holds the two together.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from dsz_daemon.config.sections import Number, Section, Text, bounded
from dsz_daemon.config.units import canonical_unit
from dsz_daemon.signals import QUANTITIES

SWITCHES = ("brake", "accelerator", "reverse")


def _one_spelling(unit: object) -> object:
    """`m/s2` for `m/s^2`: other spellings of a known unit are welcome."""
    return (canonical_unit(unit) or unit) if isinstance(unit, str) else unit


def _as_list(value: object) -> object:
    """A single item where a list is expected stands for a list of one."""
    return value if isinstance(value, list | tuple | dict) or value is None else [value]


def _whole_sign(value: object) -> object:
    return int(value) if isinstance(value, float) and value in {1.0, -1.0} else value


_Spelled = BeforeValidator(_one_spelling)
_Listed = BeforeValidator(_as_list, json_schema_input_type=str | list[str])
_Numbers = Annotated[tuple[Number, ...], BeforeValidator(_as_list, json_schema_input_type=float | list[float])]
_Sign = Annotated[
    Literal[1, -1], BeforeValidator(_whole_sign), Field(description="-1 where the signal counts the other way")
]


class PartSettings(Section):
    """One term of a sum of signals."""

    signal: Text = Field(description="signal name in the DBC")
    sign: _Sign = 1


class SignalSettings(Section):
    """Where one role comes from; see the subclasses for the units.

    Analog sensors on an ADC: value = (counts * volts_per_count - null_volts) / volts_per_unit.
    """

    message: Text = Field(description="message name in the DBC")
    signal: Text | None = Field(None, description="signal name in the DBC")
    signals: tuple[PartSettings, ...] = Field((), description="several signals of the message, summed")
    unit: str
    sign: _Sign = 1
    channel: Text | None = Field(None, description="bus (or log channel) that it comes from; any, where not given")
    volts_per_count: Number | None = bounded(1e-9, 100, "ADC: volts of one count", None)
    null_volts: Number = bounded(-100, 100, "ADC: output at zero, from the sensor's data sheet", 0.0)
    volts_per_unit: Number | None = bounded(1e-9, 1000, "ADC: sensitivity, volts per `unit`", None)
    valid_signal: Text | None = Field(None, description="signal of the same message that vouches for this one")
    valid_values: _Numbers = Field((), description="values of valid_signal that mean valid")

    @property
    def parts(self) -> tuple[PartSettings, ...]:
        """The signals to be summed, one or several."""
        return self.signals if self.signal is None else (PartSettings(signal=self.signal),)


class RateSignal(SignalSettings):
    """A turn rate."""

    unit: Annotated[Literal["rad/s", "deg/s"], _Spelled]


class AccelerationSignal(SignalSettings):
    """A specific force."""

    unit: Annotated[Literal["m/s^2", "g"], _Spelled]


class AngleSignal(SignalSettings):
    """A steering angle."""

    unit: Annotated[Literal["rad", "deg"], _Spelled]


class SpeedSignal(SignalSettings):
    """A vehicle's speed."""

    unit: Annotated[Literal["m/s", "km/h", "mph"], _Spelled]


class WheelSpeedSignal(SignalSettings):
    """A wheel's speed: of its rim, or its rotation (then `vehicle.wheel_radius_m` counts)."""

    unit: Annotated[Literal["m/s", "km/h", "mph", "rad/s", "rpm"], _Spelled]


class TemperatureSignal(SignalSettings):
    """A temperature."""

    unit: Annotated[Literal["degC"], _Spelled] = "degC"


class NumberSignal(SignalSettings):
    """A code, as the car sends it."""

    unit: Literal["1"] = "1"


class SwitchSignal(SignalSettings):
    """On or off: on where the value is one of `on_values`, or without them where it is not zero."""

    unit: Literal["1"] = "1"
    on_values: _Numbers = Field((), description="values that mean on; any but zero, where not given")


class SignalsSettings(Section):
    """The DBC files and the roles; all roles are optional, but one IMU channel must be there."""

    dbc: Annotated[tuple[Text, ...], _Listed, Field(min_length=1)] = Field(
        description="DBC files, relative to this file, or pkg:PACKAGE/FILE of an installed package"
    )
    gyro_x: RateSignal | None = None
    gyro_y: RateSignal | None = None
    gyro_z: RateSignal | None = None
    accel_x: AccelerationSignal | None = None
    accel_y: AccelerationSignal | None = None
    accel_z: AccelerationSignal | None = None
    wheel_speed_fl: WheelSpeedSignal | None = None
    wheel_speed_fr: WheelSpeedSignal | None = None
    wheel_speed_rl: WheelSpeedSignal | None = None
    wheel_speed_rr: WheelSpeedSignal | None = None
    steering_wheel_angle: AngleSignal | None = None
    road_wheel_angle: AngleSignal | None = None
    brake: SwitchSignal | None = None
    accelerator: SwitchSignal | None = None
    reverse: SwitchSignal | None = None
    gear: NumberSignal | None = None
    temperature: TemperatureSignal | None = None
    speed_reference: SpeedSignal | None = None
    roll_rate_reference: RateSignal | None = None
    pitch_rate_reference: RateSignal | None = None
    yaw_rate_reference: RateSignal | None = None
    accel_x_reference: AccelerationSignal | None = None
    accel_y_reference: AccelerationSignal | None = None
    accel_z_reference: AccelerationSignal | None = None

    @property
    def roles(self) -> dict[str, SignalSettings]:
        """The mapped roles, in the vocabulary's order."""
        mapped = {role: getattr(self, role) for role in QUANTITIES}
        return {role: signal for role, signal in mapped.items() if signal is not None}
