"""What the frames of a scan take on their wire: bits per scan, time, and the shortest period that a wire allows."""

from __future__ import annotations

import math
from collections.abc import Iterator

from definitions.units import PERIOD
from recipes.checks.expectations import Finding
from recipes.schema.bench_schema import Bench, ModbusDevice
from recipes.schema.recipe_schema import Recipe
from recipes.text.quantity import show

FRAME_BITS = 135
"""An 8-byte CAN frame with worst-case bit stuffing and the gap after it."""

SYNC_BITS = 55
"""A SYNC without data, likewise."""

PDOS_PER_SCAN = 3
"""One receive and two transmit PDOs."""

HEARTBEAT_BITS = 65
"""A heartbeat with its one byte, likewise."""

SCAN_BITS = SYNC_BITS + PDOS_PER_SCAN * FRAME_BITS

REQUEST_BYTES = 8
"""Modbus RTU: address, function, register, count, CRC."""

REPLY_BYTES = 5
"""Modbus RTU: address, function, count and CRC of the shortest reply; its registers come on top."""

SILENT_CHARACTERS = 3.5
"""Modbus RTU: silence after a frame; devices may want more, none less."""


def bus_us(bitrate: int) -> float:
    """Return how long the frames of one scan occupy a CAN bus, at worst [µs]."""
    return SCAN_BITS * 1e6 / bitrate


def line_s(device: ModbusDevice, registers: int) -> float:
    """Return the shortest time of one reading over a serial line [s]: request, reply, the silence after each."""
    bits = 1 + 8 + (device.parity != "none") + device.stopbits
    characters = REQUEST_BYTES + REPLY_BYTES + 2 * registers + 2 * SILENT_CHARACTERS
    return characters * bits / device.baudrate


def shortest_period_s(bench: Bench) -> float:
    """Return the shortest period in which a scan's frames fit on the CAN bus [s]; infinite where heartbeats fill it."""
    drive = bench.drive
    heartbeat_bits_s = HEARTBEAT_BITS * (1.0 / drive.controller_heartbeat_s + 1.0 / drive.drive_heartbeat_s)
    free_bits_s = bench.can.bitrate - heartbeat_bits_s
    return SCAN_BITS / free_bits_s if free_bits_s > 0.0 else math.inf


def check_bus(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """The frames of a scan, and the heartbeats meanwhile, fit on the CAN bus within its period."""
    period_s, shortest_s = recipe.sampling.period_s, shortest_period_s(bench)
    if period_s >= shortest_s:
        return
    found = f"{show(period_s, PERIOD)}, though a CAN bus of {bench.can.bitrate / 1000:g} kbit/s"
    if math.isinf(shortest_s):
        hint = "Raise the bus's bitrate on the drive and in the bench file, or send heartbeats less often."
        yield Finding(("sampling", "period"), f"{found} is full of heartbeats alone", "no period on this bus", hint)
        return
    found += f" needs {show(shortest_s, PERIOD, 4)} for the frames of a scan"
    found += f" (SYNC and {PDOS_PER_SCAN} PDOs, {SCAN_BITS} bits at worst, and heartbeats meanwhile)"
    hint = "Raise the period, or the bus's bitrate on the drive and in the bench file."
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
