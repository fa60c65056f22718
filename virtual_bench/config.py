"""What the virtual bench is told: plain frozen data, filled from a bench file and from device profiles.

Quantities are SI with the unit in the name. Device profiles, and the drive as it is mounted, are data of the device and
no one's behaviour: both ends of the wires have the same ones, and each makes of them what it does by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from definitions.profiles.can import CanFrame, CanIdentity
from definitions.profiles.drive import StartupObject
from definitions.profiles.modbus import ModbusProfile
from drivers.config import DriveBrakeConfig, DriveConfig

Side = Literal["input", "output"]


@dataclass(frozen=True)
class TorqueSensor:
    """A torque transducer with its amplifier channel."""

    full_scale_nm: float
    accuracy_fraction: float = 0.001  # zero and gain errors are drawn inside it
    noise_fraction: float = 0.0002  # rms, of full scale
    lag_s: float = 0.001


@dataclass(frozen=True)
class AngleSensor:
    """A rotary encoder with its counter channel."""

    resolution_bits: int
    noise_rad: float = 0.0
    lag_s: float = 0.001


@dataclass(frozen=True)
class BrakeConfig:
    """The powder brake that locks a shaft: T = k_b I, first order, with the hysteresis of its powder."""

    torque_constant_nm_per_a: float
    max_current_a: float
    time_constant_s: float
    hysteresis_fraction: float = 0.02


@dataclass(frozen=True)
class Motor:
    """What no bench file says of the motor: its inertia, and how fast the drive's loops are."""

    inertia_kgm2: float = 1.5e-4
    torque_bandwidth_hz: float = 300.0
    velocity_bandwidth_rad_s: float = 250.0


def torque_unit_nm(drive: DriveConfig) -> float:
    """Return the motor torque of one count, without sign: 0.1 % of the rated torque by CiA 402."""
    return drive.rated_torque_nm / drive.profile.scaling.torque_counts_per_rated


def sign(drive: DriveConfig) -> float:
    """Return the sign of the driven shaft's torque, angle and speed for positive counts of the drive."""
    return -1.0 if drive.reversed else 1.0


@dataclass(frozen=True)
class Catalogue:
    """What a recipe says of its model: of this a unit is made that is in no table (`catalogue_units`)."""

    model: str
    ratio: float
    rated_torque_nm: float
    stiffness_nm_per_arcmin: float
    loading_slope: float  # output torque over input torque, loading
    loading_offset_nm: float
    most: Mapping[str, float] = field(default_factory=dict)  # upper limits by metric, backlash and the like [arcmin]
    least: Mapping[str, float] = field(default_factory=dict)  # lower limits by metric, stiffness [N·m/arcmin]


@dataclass(frozen=True)
class BenchConfig:
    """A virtual bench with a unit on it."""

    unit: str  # NAME[:SEED]
    loading: Side  # the shaft that the servo drives; the other is locked
    drive: DriveConfig
    brake: BrakeConfig
    torque_in: TorqueSensor | None
    torque_out: TorqueSensor | None
    angle_in: AngleSensor
    angle_out: AngleSensor | None
    fixture_stiffness_nm_per_arcmin: float = 10_000.0  # of the lock, at the locked shaft
    noise_seed: int = 1  # what differs between two runs
    motor: Motor = Motor()
    sensor_seed: int = 1  # zero and gain errors and encoder positions: they belong to the bench, run after run
    catalogue: Catalogue | None = None  # for a unit that is made of it
    ambient_temp_c: float = 22.0
    amplifier_every_s: float = 0.001  # how often it is asked, and the others; in process the ages follow from it
    brake_every_s: float = 0.01
    remote_io_every_s: float = 0.01
    drive_brake: DriveBrakeConfig | None = None  # of a brake at an output of the drive


@dataclass(frozen=True)
class Socketcand:
    """Serve CAN as socketcand does; port 0 takes a free one."""

    host: str = "127.0.0.1"
    port: int = 0
    channel: str = "vcan0"


@dataclass(frozen=True)
class CanBus:
    """Sit on a bus that python-can opens (socketcan, slcan, ...)."""

    interface: str
    channel: str
    bitrate: int = 1_000_000


@dataclass(frozen=True)
class SlcanPort:
    """Be an slcan adapter on a serial port, which gets another name where `link` is one."""

    link: str = ""
    channel: str = "slcan"
    bitrate: int = 1_000_000


@dataclass(frozen=True)
class Shown:
    """A field of a measuring device and the channel that it shows: channel = field × scale + zero."""

    field: str
    channel: str
    scale: float = 1.0
    zero: float = 0.0


@dataclass(frozen=True)
class ModbusPort:
    """One Modbus device of the virtual bench: on TCP (port 0 takes a free one), or with `rtu` on a serial port.

    Devices whose serial ports have the same name share a line; without a name each has its own. Those whose
    `connection` has the same name share a port of TCP.
    """

    registers: ModbusProfile
    unit_id: int
    host: str = "127.0.0.1"
    port: int = 0
    rtu: bool = False
    serial_port: str = ""
    connection: str = ""
    shows: tuple[Shown, ...] = ()
    """Of a device that measures: its fields. It counts its samples in fields called as an amplifier's."""


@dataclass(frozen=True)
class CanSensorPort:
    """A sensor on the CAN bus: what it sends and how often, None for with every SYNC. `shows` as of a `ModbusPort`."""

    name: str
    node_id: int | None  # of a CANopen node, which NMT has to start
    frames: tuple[CanFrame, ...]
    every_s: float | None
    shows: tuple[Shown, ...]
    identity: CanIdentity | None = None
    startup: tuple[StartupObject, ...] = ()
    """Objects of a node that may be written; as delivered each holds 0."""


@dataclass(frozen=True)
class PaceServer:
    """Let a scan lead; port 0 takes a free one. `from_rest`: nothing moves before the first scan, however late it is.

    A bench that was started for one run is at rest until that run begins, so that the run is the same every time.
    """

    host: str = "127.0.0.1"
    port: int = 0
    from_rest: bool = False


@dataclass(frozen=True)
class ServerConfig:
    """The virtual bench as a process of its own."""

    bench: BenchConfig
    devices: Mapping[str, ModbusPort]  # amplifier, brake, remote_io and others, in the order of the bench file
    can: Socketcand | CanBus | SlcanPort = field(default_factory=Socketcand)
    can_sensors: tuple[CanSensorPort, ...] = ()
    scenario: Path | None = None
    end_with_parent: bool = False  # ends when its standard input is closed
    hands: bool = False  # its standard input says what somebody at the bench does
    pace: PaceServer | None = None  # None: by the wall clock, whatever a scan does
    truth: Path | None = None  # where the torque in the reducer over time is written at the end
