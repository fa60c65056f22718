"""Devices on Modbus in a bench file, and the powder brake: a supply on Modbus or an output of the drive."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from recipes.text.section import Age, Current, Host, Lag, Name, Port, Section, TorqueConstant, Word, refusal

Baudrate = Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600]


class ModbusDevice(Section):
    """Device on Modbus TCP or RTU, and how often it is asked."""

    transport: Literal["tcp", "rtu"]
    host: Host = ""
    port: Port = 502
    serial_port: Word = ""
    baudrate: Baudrate = 115200
    parity: Literal["none", "even", "odd"] = "none"
    stopbits: Literal[1, 2] = 1
    unit_id: Annotated[int, Field(ge=0, le=247)]
    profile: Name
    poll_every_s: Age
    timeout_s: Age

    @property
    def line(self) -> str:
        """The connection; devices with the same line are asked one after the other."""
        return self.serial_port if self.transport == "rtu" else f"{self.host}:{self.port}"

    @model_validator(mode="after")
    def _addressed(self) -> ModbusDevice:
        if self.transport == "tcp" and not self.host:
            raise refusal("tcp and no host", "tcp with the option 'host'", "Add 'host: 192.168.0.10'.")
        if self.transport == "rtu" and not self.serial_port:
            hint = "Add 'serial_port: /dev/ttyUSB0'."
            raise refusal("rtu and no serial port", "rtu with the option 'serial_port'", hint)
        return self


class MeasuringDevice(ModbusDevice):
    """A device on Modbus that `channels` name; `name` is what they call it."""

    name: Name


class PowderBrake(Section):
    """The powder brake that locks a shaft; its torque is `torque_constant` times the current.

    max_current: of a supply that takes no current set-point, the current that it gives when it is on.
    """

    torque_constant_nm_per_a: TorqueConstant
    max_current_a: Current
    time_constant_s: Lag

    @property
    def max_torque_nm(self) -> float:
        """Torque that the brake holds at its largest current [N·m]."""
        return self.torque_constant_nm_per_a * self.max_current_a


class BrakeDevice(PowderBrake, ModbusDevice):
    """Supply on Modbus of the powder brake that locks a shaft; its torque is `torque_constant` times the current.

    max_current: of a supply that takes no current set-point, the current that it gives when it is on.
    """


class DriveBrake(PowderBrake):
    """Brake at a digital output of the servo drive, in place of the section `brake`: on where the output is set.

    output_bit: bit of 0x60FE:1, which the drive's profile maps as digital_outputs. input_bit: bit of 0x60FD,
    digital_inputs, that says that the brake is on; left out where no contact does. max_current: what its supply gives.
    """

    output_bit: Annotated[int, Field(ge=0, le=31)]
    input_bit: Annotated[int, Field(ge=0, le=31)] | None = None

    @property
    def poll_every_s(self) -> float:
        """It comes with the drive's process data, in every scan."""
        return 0.0
