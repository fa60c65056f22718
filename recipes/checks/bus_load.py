"""What the frames of a scan take on their wire: bits per scan, time, and the shortest period that a wire allows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from definitions.units import PERIOD
from recipes.checks.expectations import Finding
from recipes.schema.bench_schema import Bench
from recipes.schema.device_schema import ModbusDevice
from recipes.schema.recipe_schema import Recipe
from recipes.text.quantity import show

LARGEST_LOAD = 0.95
"""Share of a CAN bus that frames with a period may take, at worst: the rest is for emergencies, SDO and repetitions."""


class BusFrame(NamedTuple):
    """A frame with a period: what it is, its bytes, and how often it comes; 0 for once in every scan."""

    what: str
    size: int
    every_s: float = 0.0

    @property
    def bits(self) -> int:
        """Bits on the bus at worst: a stuffed bit after every fourth, and the gap behind it (ISO 11898-1)."""
        stuffed = 34 + 8 * self.size
        return 10 + stuffed + (stuffed - 1) // 4 + 3


REQUEST_BYTES = 8
"""Modbus RTU: address, function, register, count, CRC."""

REPLY_BYTES = 5
"""Modbus RTU: address, function, count and CRC of the shortest reply; its registers come on top."""

SILENT_CHARACTERS = 3.5
"""Modbus RTU: silence after a frame; devices may want more, none less."""


def bus_us(frames: Sequence[BusFrame], bitrate: int) -> float:
    """Return how long the frames of one scan occupy a CAN bus, at worst [µs]."""
    return sum(frame.bits for frame in frames if not frame.every_s) * 1e6 / bitrate


def line_s(device: ModbusDevice, registers: int) -> float:
    """Return the shortest time of one reading over a serial line [s]: request, reply, the silence after each."""
    bits = 1 + 8 + (device.parity != "none") + device.stopbits
    characters = REQUEST_BYTES + REPLY_BYTES + 2 * registers + 2 * SILENT_CHARACTERS
    return characters * bits / device.baudrate


def shortest_period_s(frames: Sequence[BusFrame], bitrate: int) -> float:
    """Return the shortest period in which a scan's frames fit on the CAN bus [s].

    Infinite where those that come in their own time fill it.
    """
    of_a_scan = sum(frame.bits for frame in frames if not frame.every_s)
    free_bits_s = LARGEST_LOAD * bitrate - sum(frame.bits / frame.every_s for frame in frames if frame.every_s)
    return of_a_scan / free_bits_s if free_bits_s > 0.0 else math.inf


def bus_findings(recipe: Recipe, bench: Bench, frames: Sequence[BusFrame]) -> Iterator[Finding]:
    """All frames with a period fit on the CAN bus within `LARGEST_LOAD`; `frames` as the device profiles have them."""
    bitrate = bench.can.bitrate
    period_s, shortest_s = recipe.sampling.period_s, shortest_period_s(frames, bitrate)
    if period_s >= shortest_s:
        return
    found = f"{show(period_s, PERIOD)}, though a CAN bus of {bitrate / 1000:g} kbit/s"
    own = sorted((frame for frame in frames if frame.every_s), key=lambda frame: frame.every_s)
    told = ", ".join(f"{frame.what} every {show(frame.every_s, PERIOD)}" for frame in own)
    if math.isinf(shortest_s):
        hint = "Raise the bus's bitrate on all devices and in the bench file, or let them send less often."
        yield Finding(
            ("sampling", "period"), f"{found} is full without the scan: {told}", "no period on this bus", hint
        )
        return
    of_a_scan = [frame for frame in frames if not frame.every_s]
    found += f" needs {show(shortest_s, PERIOD, 4)} for the frames of a scan"
    found += (
        f" ({', '.join(frame.what for frame in of_a_scan)}: {sum(frame.bits for frame in of_a_scan)} bits at worst)"
    )
    found += f", beside {told}, at {LARGEST_LOAD:.0%} load"
    hint = "Raise the period, or the bus's bitrate on all devices and in the bench file."
    yield Finding(("sampling", "period"), found, f"at least {show(shortest_s, PERIOD, 4)}", hint)


def check_line(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """An amplifier on a serial line gets a sample over it within a period, and every other device when it is asked."""
    sensors, period_s = bench.sensors, recipe.sampling.period_s
    if bench.amplifier is not None:
        channels = (sensors.torque_in, sensors.torque_out, sensors.angle_in, sensors.angle_out)
        # one register for each channel and for the sample counter: what the profile reads is that or more
        yield from _over_a_line(bench.amplifier, 1 + sum(one is not None for one in channels), period_s)
    sources = [] if bench.channels is None else list(bench.channels.by_name.values())
    for device in bench.devices:
        every_s = max(period_s, device.poll_every_s)
        yield from _over_a_line(device, sum(one.device == device.name for one in sources), every_s)


def _over_a_line(device: ModbusDevice, registers: int, period_s: float) -> Iterator[Finding]:
    if device.transport != "rtu":
        return
    needed_s = line_s(device, registers)
    if period_s < needed_s:
        found = f"{show(period_s, PERIOD)}, though one sample over {device.serial_port} takes at least "
        found += f"{show(needed_s, PERIOD, 4)} at {device.baudrate} baud: request, reply and the silence after each"
        hint = "Raise the period, or the amplifier's baudrate on the device and in the bench file; or use Modbus TCP."
        yield Finding(("sampling", "period"), found, f"at least {show(needed_s, PERIOD, 4)}", hint)
