"""A bench file: its sections, what must fit between them, and what follows from them for a scan."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal

from pydantic import Field, model_validator

from definitions.method import Loading
from definitions.units import DURATION, SPEED, TORQUE
from recipes.schema.calibration_schema import Calibration, Fixture
from recipes.schema.channel_schema import CHANNELS, CanSensor, Channels
from recipes.schema.device_schema import BrakeDevice, DriveBrake, MeasuringDevice, ModbusDevice
from recipes.schema.drive_schema import CanBus, Drive
from recipes.schema.sensor_schema import Sensors
from recipes.text.problems import one_of
from recipes.text.quantity import show
from recipes.text.section import (
    Host,
    Interval,
    Name,
    Port,
    PublicKey,
    Quantity,
    Revision,
    Section,
    Speed,
    Torque,
    refusal,
)

PARTS = ("amplifier", "brake", "remote_io")
MOST_MEASURING = 6
"""Devices of `devices`: with brake and remote I/O as many as a message to a virtual bench has room for."""

JOG_SHARE = 0.25
"""Of the servo's largest speed and torque: the most that a jog may have."""

RESERVED = frozenset({*PARTS, "drive", "can", "pace", "ready", "unit"})
"""Names that a virtual bench says something else by."""


class BenchHeader(Section):
    """Name of a bench, the shaft that its servo loads, and what it is built for."""

    name: Name
    revision: Revision
    loading: Loading
    embedded: bool = False
    """The program starts this bench itself."""
    models: tuple[Name, ...] = ()
    """Models that fit this bench; empty when any does."""
    public_key: PublicKey | None = None
    """Key by which the computer of this bench signs its runs."""


class MasterPart(Section):
    """A unit whose verdict is known, which shows whether the bench still measures right; good ones and bad ones.

    It is no product: it counts in no statistics of units, and may be measured any number of times.
    """

    serial: Name
    expect: Literal["PASS", "FAIL"]
    """Verdict that a sound bench gives it."""
    every_s: Interval = 86400.0
    """How often it is measured at least."""


class TorqueControl(Section):
    """How the torque of a ramp is controlled. gain: integral gain in 1/s, 2π times the crossover frequency of the loop.

    It belongs to drive, couplings and sensors of this bench: `lostmotion bench tune` measures it.
    """

    gain_per_s: Annotated[float, Field(gt=0, le=1000)] = 15.0
    """Crossover at 2.4 Hz; 2.4 to 4 Hz is a decade below the first resonance of the virtual bench."""


class JogSection(Section):
    """How a technician turns the loaded shaft with the enabling device pressed; needs `enabling_device` in remote_io.

    max_speed, max_torque: of that shaft, at most a quarter of what the servo has; left out, a tenth of its largest
    speed and a fifth of its rated torque. longest_press: an enabling device that is pressed for longer counts as stuck.
    """

    max_speed_rad_s: Speed | None = None
    max_torque_nm: Torque | None = None
    longest_press_s: Annotated[float, Quantity(DURATION, at_least=1, up_to=120)] = 30.0


class PaceOfBench(Section):
    """Where a virtual bench that was started by itself waits for the scan; real hardware has no such thing."""

    host: Host = "127.0.0.1"
    port: Port


class Bench(Section):
    """A bench file as loaded."""

    bench: BenchHeader
    can: CanBus
    drive: Drive
    amplifier: ModbusDevice | None = None
    """The device of all measured channels; left out where `channels` name a device for each."""
    brake: BrakeDevice | None = None
    drive_brake: DriveBrake | None = None
    remote_io: ModbusDevice
    devices: Annotated[tuple[MeasuringDevice, ...], Field(max_length=MOST_MEASURING)] = ()
    can_devices: Annotated[tuple[CanSensor, ...], Field(max_length=16)] = ()
    channels: Channels | None = None
    sensors: Sensors
    fixture: Fixture
    torque_control: TorqueControl = TorqueControl()
    jog: JogSection | None = None
    """Limits of a jog; left out, those that follow from the servo."""
    pace: PaceOfBench | None = None
    """A virtual bench on wires that waits for the scan; a bench without it lives by its own clock."""
    calibrations: Annotated[tuple[Calibration, ...], Field(max_length=200)] = ()
    master_parts: Annotated[tuple[MasterPart, ...], Field(max_length=20)] = ()

    @model_validator(mode="after")
    def _one_setting_per_serial_line(self) -> Bench:
        lines: dict[str, tuple[str, tuple[int, str, int]]] = {}
        for name, device in self.modbus_devices.items():
            if device.transport != "rtu":
                continue
            setting = (device.baudrate, device.parity, device.stopbits)
            other, first = lines.setdefault(device.serial_port, (name, setting))
            if setting != first:
                found = f"{_line_text(setting)} on {device.serial_port}, where {other} has {_line_text(first)}"
                hint = "All devices on one serial line need the same settings."
                at = name if name in PARTS else "devices"
                raise refusal(found, "one setting of baudrate, parity and stopbits per serial port", hint, at=at)
        return self

    @model_validator(mode="after")
    def _each_channel_from_somewhere(self) -> Bench:
        if self.channels is None and self.amplifier is None:
            hint = "Add the section 'amplifier', or 'channels' with the source of each measured channel."
            raise refusal("neither amplifier nor channels", "one of them", hint)
        if self.channels is None and (self.devices or self.can_devices):
            hint = "Add 'channels', which say what is measured by which device; or delete the devices."
            at = "devices" if self.devices else "can_devices"
            raise refusal(f"{at} without channels", "both or none", hint, at=at)
        if self.channels is not None and self.amplifier is not None:
            hint = "Move the amplifier to 'devices', give it a name, and use that name in 'channels'."
            raise refusal("both amplifier and channels", "one of the two", hint, at="amplifier")
        return self

    @model_validator(mode="after")
    def _one_brake(self) -> Bench:
        if (self.brake is None) == (self.drive_brake is None):
            found = "neither brake nor drive_brake" if self.brake is None else "both brake and drive_brake"
            hint = "Give 'brake' for a supply on Modbus, 'drive_brake' for an output of the drive."
            raise refusal(found, "one of the two", hint, at="brake")
        return self

    @model_validator(mode="after")
    def _jog_is_slow_and_weak(self) -> Bench:
        if self.jog is None:
            return self
        for option, value, largest, kind in (
            ("max_speed", self.jog.max_speed_rad_s, self.max_loading_speed_rad_s, SPEED),
            ("max_torque", self.jog.max_torque_nm, self.max_loading_torque_nm, TORQUE),
        ):
            if value is not None and value > largest * JOG_SHARE:
                allowed = f"at most {show(largest * JOG_SHARE, kind)}, a quarter of the servo's limit"
                hint = "People are near the shaft: a jog is slow and weak."
                raise refusal(show(value, kind), allowed, hint, at=f"jog.{option}")
        return self

    @model_validator(mode="after")
    def _sources_fit(self) -> Bench:
        if self.channels is None:
            return self
        named = [(one.name, f"devices.{place}.name") for place, one in enumerate(self.devices)]
        named += [(one.name, f"can_devices.{place}.name") for place, one in enumerate(self.can_devices)]
        names = [name for name, _ in named]
        for place, (name, at) in enumerate(named):
            if name in RESERVED or name in names[:place]:
                allowed = f"a name that no other device has, and none of {', '.join(sorted(RESERVED))}"
                raise refusal(f"'{name}'", allowed, at=at)
        sources = self.channels.by_name
        for name in CHANNELS:
            if (name in sources) != (getattr(self.sensors, name) is not None):
                found = f"{name} in {'channels' if name in sources else 'sensors'} alone"
                hint = "Add it to the other section, or delete it."
                raise refusal(found, "each measured channel in sensors and in channels", hint, at=f"channels.{name}")
        for name, source in sources.items():
            if source.device not in names:
                allowed = one_of(names)
                raise refusal(f"'{source.device}'", allowed, at=f"channels.{name}.device")
        return self

    @model_validator(mode="after")
    def _each_master_part_once(self) -> Bench:
        serials = [part.serial for part in self.master_parts]
        for place, serial in enumerate(serials):
            if serial in serials[:place]:
                raise refusal(
                    f"'{serial}' a second time", "each master part once", "Delete one.", f"master_parts.{place}"
                )
        return self

    @model_validator(mode="after")
    def _each_calibration_by_itself(self) -> Bench:
        """The newest one of a model is used: of two of one day nobody could say which, nor of one id which was used."""
        ids: dict[str, Calibration] = {}
        days: dict[tuple[str, date], Calibration] = {}
        for place, one in enumerate(self.calibrations):
            at = f"calibrations.{place}"
            if ids.setdefault(one.id, one) is not one:
                first = ids[one.id]
                found = f"'{one.id}' of {one.model}, made {one.made}, and of {first.model}, made {first.made}"
                raise refusal(found, "an id for each calibration", "Rename or delete one.", at=f"{at}.id")
            first = days.setdefault((one.model, one.made), one)
            if first is not one:
                found = f"'{first.id}' and '{one.id}' of {one.model}, both made {one.made}"
                hint = "The newest one is used: delete the one that does not hold."
                raise refusal(found, "one calibration of a model in a day", hint, at=f"{at}.made")
        return self

    @property
    def modbus_devices(self) -> dict[str, ModbusDevice]:
        """All devices on Modbus, by their names."""
        named: dict[str, ModbusDevice | None] = {"amplifier": self.amplifier, "brake": self.brake}
        named |= {"remote_io": self.remote_io} | {one.name: one for one in self.devices}
        return {name: device for name, device in named.items() if device is not None}

    @property
    def lock_brake(self) -> BrakeDevice | DriveBrake:
        """The brake that locks a shaft, wherever it is connected."""
        brake = self.brake or self.drive_brake
        assert brake is not None  # noqa: S101 - one is there: `_one_brake`
        return brake

    @property
    def profile_names(self) -> tuple[str, ...]:
        """Device profiles that the file names, each once: first that of the drive."""
        modbus = [one.profile for one in self.modbus_devices.values()]
        return tuple(dict.fromkeys([self.drive.profile, *modbus, *(one.profile for one in self.can_devices)]))

    @property
    def sample_every_s(self) -> float:
        """Longest time between two values of a measured channel, by what the file says [s]."""
        return self.sample_every(0.0)

    def sample_every(self, period_s: float) -> float:
        """Longest time between two values of a measured channel in a scan of this period [s].

        Nothing is asked more often than once a scan, and the blocks of the devices on one line one after the other.
        """
        if self.channels is None:
            return 0.0 if self.amplifier is None else max(self.amplifier.poll_every_s, period_s)
        named = {one.device for one in self.channels.by_name.values()}
        sent = [one.update_every_s or period_s for one in self.can_devices if one.name in named]
        return max([self._asked_every(period_s), *sent])

    def _asked_every(self, period_s: float) -> float:
        """Longest time between two requests for the same channel on Modbus, where `channels` name devices [s]."""
        sources = [] if self.channels is None else list(self.channels.by_name.values())
        slowest = 0.0
        for device in self.devices:
            on_the_line = {one.name for one in self.devices if one.line == device.line}
            asked = {(one.device, one.proof_field or one.field) for one in sources if one.device in on_the_line}
            slowest = max(slowest, device.poll_every_s, period_s * len(asked))
        return slowest

    def skew(self, period_s: float) -> float:
        """Limit of the difference between the delays of torque and angle in a scan of this period [s].

        Channels that do not share a counter or time stamp are measured each in its time, and how long before the scan
        is known within what lies between two values of the slowest of them: that comes on top. What answers SYNC was
        measured at SYNC.
        """
        sources = {} if self.channels is None else self.channels.by_name
        samples = {(one.device, one.alive_field) for one in sources.values() if one.alive in ("counter", "time_stamp")}
        apart = len(samples) > 1 or any(one.alive in ("noise", "arrival") for one in sources.values())
        named = {one.device for one in sources.values()}
        sent = [one.update_every_s or 0.0 for one in self.can_devices if one.name in named]
        return self.sensors.skew_s + (max([self._asked_every(period_s), *sent]) if apart else 0.0)

    def unasked_delay(self, sensor: str, period_s: float) -> float:
        """Mean time from the sending of a channel that nobody asks for to the scan that takes it [s].

        Such a sensor on CAN sends in its own time, and a scan takes the newest it has: anything up to that time or to
        the period is passed, whichever is shorter. Of what is asked for the record knows the time.
        """
        source = None if self.channels is None else getattr(self.channels, sensor)
        every = next((one.update_every_s for one in self.can_devices if source and one.name == source.device), None)
        return min(every, period_s) / 2.0 if every else 0.0

    def master_part(self, serial: str) -> MasterPart | None:
        """Return the master part with this serial number; None for a product."""
        return next((part for part in self.master_parts if part.serial == serial), None)

    def newest_calibration(self, model: str) -> Calibration | None:
        """Newest stored calibration for a model, None when there is none."""
        return max((one for one in self.calibrations if one.model == model), key=lambda one: one.made, default=None)

    @property
    def max_loading_torque_nm(self) -> float:
        """Largest torque that the servo brings to the loaded shaft, through its gearbox [N·m]."""
        return self.drive.max_torque_nm * self.drive.gear_ratio

    @property
    def max_loading_speed_rad_s(self) -> float:
        """Largest speed of the loaded shaft [rad/s]."""
        return self.drive.max_speed_rad_s / self.drive.gear_ratio


def _line_text(setting: tuple[int, str, int]) -> str:
    baudrate, parity, stopbits = setting
    return f"{baudrate} baud, parity {parity}, {stopbits} stop bit{'s' if stopbits > 1 else ''}"
