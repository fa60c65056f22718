"""What is on the CAN bus of a bench with a period: frames of scan and drive, heartbeats, and sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from definitions.number_formats import SIZES
from definitions.profiles.drive import DriveProfile, MappedObject
from drivers.config import CanSensorConfig
from recipes import Bench, Recipe
from recipes.checks.bus_load import BusFrame
from recipes.schema.sequence_schema import SpeedCycles


def bus_frames(
    recipe: Recipe, bench: Bench, drive: DriveProfile, sensors: Sequence[CanSensorConfig]
) -> Iterator[BusFrame]:
    """Yield every frame with a period; that with the speed set-point only where the recipe has cycles by speed."""
    by_speed = any(isinstance(step, SpeedCycles) for step in recipe.sequence)
    yield BusFrame("SYNC", 0)
    for received in drive.receive_pdos:
        if by_speed or {item.name for item in received.objects} != {"target_velocity"}:
            yield BusFrame(f"RPDO {received.number}", _size(received.objects))
    for sent in drive.transmit_pdos:
        yield BusFrame(f"TPDO {sent.number}", _size(sent.objects))
    yield BusFrame("heartbeat of the controller", 1, bench.drive.controller_heartbeat_s)
    yield BusFrame("heartbeat of the drive", 1, bench.drive.drive_heartbeat_s)
    for one, sensor in zip(bench.can_devices, sensors, strict=True):
        if sensor.heartbeat_s:
            yield BusFrame(f"heartbeat of {one.name}", 1, sensor.heartbeat_s)
        for frame in sensor.frames:
            yield BusFrame(f"0x{frame.identifier:03X} of {one.name}", frame.size, one.update_every_s or 0.0)


def _size(objects: Sequence[MappedObject]) -> int:
    return sum(SIZES[item.type] for item in objects)
