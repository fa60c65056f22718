"""What a bench file may say: buses, devices, ratings, sensors, calibrations."""

from __future__ import annotations

import datetime as dt
from typing import Annotated, Literal

from pydantic import Field

from recipes.quantity import (
    Angle,
    Bits,
    Current,
    Fraction,
    PositiveTime,
    PositiveTorque,
    SignedTorque,
    Speed,
    Stiffness,
    Time,
    TorquePerCurrent,
    TorqueRate,
)
from recipes.recipe_schema import Name, Revision
from recipes.section import Section

Port = Annotated[int, Field(ge=0, le=65535)]
NodeId = Annotated[int, Field(ge=1, le=127)]
UnitId = Annotated[int, Field(ge=1, le=247)]
OptionCode = Annotated[int, Field(ge=-32768, le=32767)]


class BenchHeader(Section):
    """Which bench this is, which shaft its servo drives, and which models it serves (empty: any)."""

    name: Name
    revision: Revision
    loading: Literal["input", "output"]
    embedded: bool = False
    models: Annotated[tuple[str, ...], Field(strict=False)] = ()


class CanBus(Section):
    """How the CAN bus is reached."""

    interface: Literal["socketcand", "socketcan", "slcan", "virtual"]
    channel: str
    host: str = "127.0.0.1"
    port: Port = 29536
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 1_000_000


class Drive(Section):
    """The servo drive; torques and speeds of the motor shaft."""

    node_id: NodeId
    controller_node_id: NodeId
    profile: Name
    gear_ratio: Annotated[float, Field(gt=0.0, le=10_000.0, strict=False)]
    rated_torque_nm: PositiveTorque = Field(alias="rated_torque")
    max_torque_nm: PositiveTorque = Field(alias="max_torque")
    max_speed_rad_s: Speed = Field(alias="max_speed")
    torque_slope_nm_s: TorqueRate = Field(alias="torque_slope")
    controller_heartbeat_s: PositiveTime = Field(alias="controller_heartbeat")
    controller_heartbeat_timeout_s: PositiveTime = Field(alias="controller_heartbeat_timeout")
    drive_heartbeat_s: PositiveTime = Field(alias="drive_heartbeat")
    setpoint_timeout_s: PositiveTime = Field(alias="setpoint_timeout")
    abort_connection_option: OptionCode
    quick_stop_option: OptionCode
    fault_reaction_option: OptionCode


class ModbusDevice(Section):
    """A device on Modbus TCP or RTU."""

    transport: Literal["tcp", "rtu"]
    host: str = "127.0.0.1"
    port: Port = 502
    serial_port: str = ""
    baudrate: Annotated[int, Field(ge=1200, le=4_000_000)] = 115_200
    unit_id: UnitId
    profile: Name
    poll_every_s: PositiveTime = Field(alias="poll_every")
    timeout_s: PositiveTime = Field(alias="timeout")


class BrakeDevice(ModbusDevice):
    """The lock brake and its supply: T = k_b I."""

    torque_constant_nm_per_a: TorquePerCurrent = Field(alias="torque_constant")
    max_current_a: Current = Field(alias="max_current")
    time_constant_s: PositiveTime = Field(alias="time_constant")


class TorqueSensor(Section):
    """A torque transducer."""

    full_scale_nm: PositiveTorque = Field(alias="full_scale")
    accuracy_fraction: Fraction = Field(alias="accuracy")
    noise_fraction: Fraction = Field(alias="noise")
    lag_s: Time = Field(alias="lag")


class AngleSensor(Section):
    """A rotary encoder."""

    resolution_bits: Bits = Field(alias="resolution")
    noise_rad: Angle = Field(alias="noise")
    lag_s: Time = Field(alias="lag")


class Sensors(Section):
    """What the measuring amplifier samples; a sensor that the bench does not have is left out."""

    torque_in: TorqueSensor | None = None
    torque_out: TorqueSensor | None = None
    angle_in: AngleSensor
    angle_out: AngleSensor | None = None


class Fixture(Section):
    """Compliance of the lock and what is between it and the unit."""

    stiffness_nm_per_arcmin: Stiffness = Field(alias="stiffness")


class QuadrantLine(Section):
    """T_out = offset + slope T_in in one quadrant (sign of torque, loading or unloading)."""

    slope: Annotated[float, Field(gt=0.0, le=10_000.0, strict=False)]
    offset_nm: SignedTorque = Field(alias="offset")


class Calibration(Section):
    """A stored torque ratio of this bench for one model."""

    id: Name
    model: str
    made: dt.date
    due: dt.date
    load_positive: QuadrantLine
    unload_positive: QuadrantLine
    load_negative: QuadrantLine
    unload_negative: QuadrantLine


class Bench(Section):
    """A whole bench."""

    bench: BenchHeader
    can: CanBus
    drive: Drive
    amplifier: ModbusDevice
    brake: BrakeDevice
    remote_io: ModbusDevice
    sensors: Sensors
    fixture: Fixture
    calibrations: Annotated[tuple[Calibration, ...], Field(strict=False)] = ()
