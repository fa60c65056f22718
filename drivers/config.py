"""The bench's hardware as plain data: what a caller fills in to get a `drivers.wire_bench.WireBench`.

Nothing here reads files. SI units; the profiles are those of `definitions.profiles`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from definitions.profiles.can import CanFrame, CanIdentity
from definitions.profiles.drive import DriveProfile, StartupObject
from definitions.profiles.modbus import ModbusProfile
from drivers.pace import PaceConfig

ALL_CHANNELS = ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
"""Measured channels of a bench with all four sensors."""


@dataclass(frozen=True)
class CanConfig:
    """How to reach the CAN bus; `host` and `port` for socketcand, `serial_port` for slcan, else `channel`."""

    interface: Literal["socketcand", "socketcan", "slcan", "virtual"]
    channel: str = "can0"
    host: str = "127.0.0.1"
    port: int = 29536
    bitrate: int = 1_000_000
    serial_port: str = ""
    serial_baudrate: int = 115_200
    serial_settle_s: float = 2.0
    """slcan: wait after the port was opened; many adapters restart then."""
    connect_timeout_s: float = 3.0
    send_timeout_s: float = 0.002
    """Longest time that one send may hold the scan; beyond it the bus is lost. Kernels round up to their tick."""

    @property
    def where(self) -> str:
        """The bus as a person would look for it."""
        if self.interface == "socketcand":
            return f"socketcand {self.host}:{self.port} channel {self.channel}"
        if self.interface == "slcan":
            return f"slcan {self.serial_port}"
        return f"{self.interface} {self.channel}"


@dataclass(frozen=True)
class DriveConfig:
    """The servo drive as mounted on this bench; torques and speeds at the motor unless the name says otherwise."""

    node_id: int
    controller_node_id: int
    profile: DriveProfile
    gear_ratio: float
    """Motor turns per turn of the loaded shaft."""
    rated_torque_nm: float
    max_torque_nm: float
    max_speed_rad_s: float
    torque_slope_nm_s: float
    controller_heartbeat_s: float
    controller_heartbeat_timeout_s: float
    drive_heartbeat_s: float
    setpoint_timeout_s: float
    abort_connection_option: int
    quick_stop_option: int
    fault_reaction_option: int
    output_mask: int = 0
    """Digital outputs of the drive that are ours: bits of 0x60FE:1, let through by 0x60FE:2."""
    reversed: bool = False
    """The motor turns the loaded shaft against the drive's own positive direction."""
    boot_timeout_s: float = 3.0
    """Longest wait for the drive's boot-up message and its first operational heartbeat."""
    listen_before_reset_s: float = 0.15
    """Time for which another controller is listened for; several heartbeats of a controller fit into it."""
    sdo_reply_timeout_s: float = 1.0
    """Longest wait for the answer to one SDO request; a busy computer needs far longer than the drive."""
    sdo_tries: int = 2
    """Times that an SDO request is sent before the drive counts as silent, at least 1."""
    setup_timeout_s: float = 75.0
    """Longest time for the objects of the whole set-up, so that a drive that answers late cannot prolong it.

    It is time for 250 transfers of 0.3 s; a drive with eight PDOs each way takes 160."""


@dataclass(frozen=True)
class ModbusConfig:
    """One Modbus device: how to reach it, how often it is read, and its register map."""

    transport: Literal["tcp", "rtu"]
    unit_id: int
    profile: ModbusProfile
    poll_every_s: float
    timeout_s: float
    host: str = "127.0.0.1"
    port: int = 502
    serial_port: str = ""
    baudrate: int = 19_200
    parity: Literal["N", "E", "O"] = "N"
    stop_bits: Literal[1, 2] = 1
    worst_reply_s: float | None = None
    """RTU: longest time after a request in which its reply may still come; three time-outs when None."""
    reassert_s: float = 0.25
    """An unchanged order is written again after this time, so that a lost write cannot stay."""
    connect_timeout_s: float = 3.0

    @property
    def line(self) -> str:
        """The connection; devices with the same line share it, one request at a time."""
        return f"{self.host}:{self.port}" if self.transport == "tcp" else self.serial_port

    @property
    def where(self) -> str:
        """The device as a person would look for it."""
        return f"{self.profile.profile.name} at {self.line} unit {self.unit_id}"


@dataclass(frozen=True)
class DriveBrakeConfig:
    """A brake at a digital output of the drive: its bit of 0x60FE:1, and the bit of 0x60FD that says that it is on."""

    output_bit: int
    input_bit: int | None = None


@dataclass(frozen=True)
class ChannelConfig:
    """Where a measured channel comes from: value = field × scale + zero, in the unit of the channel.

    What proves that a value is new: `proof_field`, which must have changed within `still_s`: at once (0) a counter or
    time stamp, within a stated time the noise of a value. Without it every answer is taken for a new value.
    """

    channel: str
    device: str
    field: str
    scale: float = 1.0
    zero: float = 0.0
    proof_field: str = ""
    still_s: float = 0.0


@dataclass(frozen=True)
class NamedDevice:
    """A Modbus device that measures; one of several blocks has an entry for each, under the same name."""

    name: str
    modbus: ModbusConfig


@dataclass(frozen=True)
class CanSensorConfig:
    """A sensor on the CAN bus of the drive: the frames that it sends; a CANopen node is set up and started by NMT.

    `identity`: what 0x1018 of a node must hold. `startup`: objects that are written into it. `heartbeat_s`: how often
    it says its state, written into it and watched; 0 where nobody asks for it. `synchronous`: its frames answer SYNC.
    """

    name: str
    node_id: int | None
    frames: tuple[CanFrame, ...]
    identity: CanIdentity | None = None
    startup: tuple[StartupObject, ...] = ()
    heartbeat_s: float = 0.0
    synchronous: bool = False
    sdo_reply_timeout_s: float = 1.0
    sdo_tries: int = 2
    setup_timeout_s: float = 20.0
    first_frame_timeout_s: float = 2.0
    """Longest wait for each of its frames before the scan."""

    @property
    def where(self) -> str:
        """The sensor as a person would look for it."""
        return f"{self.name} on CAN" if self.node_id is None else f"{self.name} on CAN, node {self.node_id}"


@dataclass(frozen=True)
class WireBenchConfig:
    """Everything a bench needs to open its wires.

    All measured channels come from the amplifier, or each from where `sources` says; then there is no amplifier, and
    `measuring` are the Modbus devices, with all of their blocks, and `can_sensors` those on the bus of the drive.
    """

    period_ns: int
    can: CanConfig
    drive: DriveConfig
    amplifier: ModbusConfig | None
    brake: ModbusConfig | None
    remote_io: ModbusConfig
    drive_brake: DriveBrakeConfig | None = None
    """In place of `brake`: one of the two is there."""
    pace: PaceConfig | None = None
    """Where a virtual bench waits for the scan; None for a bench with a clock of its own, as real ones have."""
    channels: tuple[str, ...] = ALL_CHANNELS
    """The channels that this bench has sensors for; amplifier or sources must deliver each."""
    brake_fixed_current_a: float = 0.0
    """What a brake is taken to have that is on, was never ordered a current, and does not measure it."""
    measuring: tuple[NamedDevice, ...] = ()
    sources: tuple[ChannelConfig, ...] = ()
    can_sensors: tuple[CanSensorConfig, ...] = ()
    modbus_devices: tuple[str, ...] = ("amplifier", "brake", "remote_io")
    """Names of the Modbus devices in the order of the bench file, in which a virtual bench counts their answers."""

    @property
    def modbus(self) -> tuple[ModbusConfig, ...]:
        """All Modbus devices; one that measures is there once for each of its blocks."""
        parts = (*(one.modbus for one in self.measuring), self.amplifier, self.brake, self.remote_io)
        return tuple(one for one in parts if one is not None)
