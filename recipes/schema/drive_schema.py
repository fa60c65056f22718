"""Servo drive in a bench file: its CAN bus, its identity there, its ratings and its protections."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from definitions.units import PERIOD, RAD_PER_ARCSEC
from recipes.text.quantity import show
from recipes.text.section import (
    Age,
    Host,
    Name,
    Port,
    Section,
    SmallAngle,
    Speed,
    Stiffness,
    Torque,
    TorqueSlope,
    Word,
    refusal,
)

NodeId = Annotated[int, Field(ge=1, le=127)]
OptionCode = Annotated[int, Field(ge=-32768, le=32767)]
Bitrate = Literal[10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000]


class CanBus(Section):
    """CAN bus of the drive: socketcand by host, port and channel, slcan by the serial port in `channel`."""

    interface: Literal["socketcand", "socketcan", "slcan", "virtual"]
    channel: Word
    host: Host = "127.0.0.1"
    port: Port = 29536
    bitrate: Bitrate = 1000000


class Drive(Section):
    """Servo drive: identity on the bus, ratings of its motor, and the protections written into it before arming.

    angle_agreement: how far the drive's position and the angle sensor of the loaded shaft may move apart before the run
    is stopped, play of gearbox and couplings included. coupling_stiffness: of what is between motor and that sensor, at
    the loaded shaft; its twist is allowed on top.
    """

    node_id: NodeId
    controller_node_id: NodeId
    profile: Name
    gear_ratio: Annotated[float, Field(gt=0, le=10000)]
    rated_torque_nm: Torque
    max_torque_nm: Torque
    max_speed_rad_s: Speed
    torque_slope_nm_s: TorqueSlope
    controller_heartbeat_s: Age
    controller_heartbeat_timeout_s: Age
    drive_heartbeat_s: Age
    setpoint_timeout_s: Age
    abort_connection_option: OptionCode
    quick_stop_option: OptionCode
    fault_reaction_option: OptionCode
    reversed: bool = False
    """The motor's positive direction turns the loaded shaft backwards."""
    angle_agreement_rad: SmallAngle = 360 * RAD_PER_ARCSEC
    coupling_stiffness_nm_per_arcmin: Stiffness | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Drive:
        if self.node_id == self.controller_node_id:
            hint = "Give the controller a number that no device on the bus has, such as 126."
            raise refusal(
                f"{self.node_id} for the drive and the controller",
                "two different node numbers",
                hint,
                at="controller_node_id",
            )
        if self.controller_heartbeat_timeout_s < 2 * self.controller_heartbeat_s:
            found = show(self.controller_heartbeat_timeout_s, PERIOD)
            allowed = f"at least twice controller_heartbeat, {show(2 * self.controller_heartbeat_s, PERIOD)}"
            raise refusal(found, allowed, "One late heartbeat would stop the drive.", at="controller_heartbeat_timeout")
        return self
