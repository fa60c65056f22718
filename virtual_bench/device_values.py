"""What the devices of the bench show of the plant, and what the brake takes: values by name, on whatever wire."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from definitions.image import REMOTE_IO_FIELDS
from virtual_bench.config import BenchConfig, CanSensorPort, ModbusPort, Shown
from virtual_bench.devices.drive_node import DriveNode
from virtual_bench.devices.modbus_servers import Device
from virtual_bench.faults.injector import FaultInjector
from virtual_bench.physics.plant import Plant

COUNTED = ("sample_counter", "sample_time_us")
"""What begins anew where it does not fit a register."""
CONTACT_CLOSES = 0.5
"""Share of its largest current from which the contact of a brake at the drive says that it is on."""
DEVICE_CYCLE_NS = 1_000_000  # of the remote I/O, which counts its cycles


def remote_io_shows(plant: Plant, faults: FaultInjector) -> dict[str, float]:
    """Return what contacts and sensors at the remote I/O show, by the names of the image.

    A sensor that the physics does not know lies in the room: it shows the room's temperature, or a closed contact.
    """
    wires = faults.wires
    in_the_room = {field.name: plant.ambient_temp_c if field.unit == "°C" else 1 for field in REMOTE_IO_FIELDS}
    return in_the_room | {
        "estop_released": wires.estop_released,
        "guard_closed": wires.guard_closed,
        "enabling_device": wires.enabling_device,
        "housing_temp_c": plant.housing_temp_c + wires.housing_offset_k,
    }


class DeviceValues:
    """Amplifier, sensors, brake and remote I/O around one plant."""

    def __init__(self, bench: BenchConfig, plant: Plant, drive: DriveNode) -> None:
        self._plant, self._drive = plant, drive
        self._brake_on = 0
        self._brake_max_a = bench.brake.max_current_a
        self._output_brake = bench.drive_brake

    def device(self, name: str, port: ModbusPort) -> Device:
        """Return what stands behind a Modbus port of this name."""
        match name:
            case "amplifier":
                return Device(port, self._read_amplifier)
            case "brake":
                return Device(port, self._read_brake, self._write_brake)
            case "remote_io":
                return Device(port, self._read_remote_io)
        return Device(port, partial(self._read_measuring, port))

    def _read_amplifier(self) -> dict[str, float]:
        sample = self._plant.sample()
        return {
            "torque_in_nm": sample.torque_in_nm,
            "torque_out_nm": sample.torque_out_nm,
            "angle_in_rad": sample.angle_in_rad,
            "angle_out_rad": sample.angle_out_rad,
            "sample_counter": sample.counter,
            "sample_time_us": sample.time_us,
            "sample_status": sample.status,
        }

    def _read_measuring(self, port: ModbusPort) -> dict[str, float]:
        blocks = (port.registers.read, *port.registers.read_also)
        types = {field.name: field.type for block in blocks for field in block.fields}
        values = self._shown(types, port.shows)
        for one in port.shows:
            if one.channel in COUNTED and types[one.field] == "u16":
                values[one.field] = int(values[one.field]) & 0xFFFF
        return values

    def read_sensor(self, port: CanSensorPort) -> dict[str, float]:
        """Return what the fields of a sensor on CAN show."""
        return self._shown([field.name for frame in port.frames for field in frame.fields], port.shows)

    def _shown(self, names: Iterable[str], shows: Iterable[Shown]) -> dict[str, float]:
        """Return what the fields of a device show; 0 in those that nobody names."""
        sample = self._read_amplifier()
        shown = {one.field: (sample[one.channel] - one.zero) / one.scale for one in shows}
        return dict.fromkeys(names, 0.0) | sample | shown

    def _read_brake(self) -> dict[str, float]:
        return {
            "brake_on": self._brake_on,
            "brake_current_a": self._plant.brake_current_a,
            "life_counter": self._life_counter(),
        }

    def _write_brake(self, values: dict[str, float]) -> None:
        ordered_a = values.get("brake_current_a", self._brake_max_a)  # a supply without set-point gives what it can
        self._brake_on = 1 if values.get("brake_on", ordered_a) else 0
        self._plant.set_brake_current(ordered_a if self._brake_on else 0.0)

    def switch_output_brake(self) -> None:
        """Let the output of the drive switch the brake, and the brake's contact the input, where it is there."""
        brake = self._output_brake
        if brake is None:
            return
        machine = self._drive.axis.machine
        on = machine.objects.digital_outputs & machine.objects.output_mask & 1 << brake.output_bit
        if bool(on) != bool(self._brake_on):
            self._brake_on = 1 if on else 0
            self._plant.set_brake_current(self._brake_max_a if on else 0.0)
        if brake.input_bit is not None:
            closed = self._plant.brake_current_a > CONTACT_CLOSES * self._brake_max_a
            machine.digital_inputs = 1 << brake.input_bit if closed else 0

    def _read_remote_io(self) -> dict[str, float]:
        return {**remote_io_shows(self._plant, self._drive.faults), "life_counter": self._life_counter()}

    def _life_counter(self) -> int:
        return self._plant.now_ns // DEVICE_CYCLE_NS & 0xFFFF
