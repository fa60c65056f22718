"""Amplifier, brake and remote I/O without wires: each asked at its own period, its values ageing in between.

A device that is slow by a fault measures when it is asked and answers later; it is asked again when it has answered.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from definitions.image import AGE_NEVER, REMOTE_IO_FIELDS, Image, Link, Orders
from virtual_bench.config import BenchConfig
from virtual_bench.device_values import remote_io_shows
from virtual_bench.faults.injector import FaultInjector
from virtual_bench.physics.plant import SAMPLE_US, Plant, Sample

LINKS: dict[str, int] = {
    "amplifier": int(Link.AMPLIFIER),
    "brake": int(Link.BRAKE),
    "remote_io": int(Link.REMOTE_IO),
}
CURRENT_STEP_A = 1e-3
TEMPERATURE_STEP_C = 0.1

DEVICES = frozenset(f"modbus.{device}" for device in LINKS)
"""Targets of faults that keep a device from answering, or its answers from being believed."""


class Answer(NamedTuple):
    """An answer: the scan in whose course it comes, and what was measured when it was asked for."""

    comes: int
    values: Any


class SlowDevices:
    """The Modbus devices of a bench in virtual time: they put what they send into the next image.

    `sample_scan`, `brake_scan` and `io_scan` are the scans at which it arrives.
    """

    def __init__(self, config: BenchConfig, plant: Plant, faults: FaultInjector, period_ns: int, image: Image) -> None:
        self._image = image
        self.sample_scan = self.brake_scan = self.io_scan = -AGE_NEVER
        self._plant = plant
        self._faults = faults
        self._period_ns = period_ns
        self._sample_every = max(round(config.amplifier_every_s * 1e9 / period_ns), 1)
        self._brake_every = max(round(config.brake_every_s * 1e9 / period_ns), 1)
        self._io_every = max(round(config.remote_io_every_s * 1e9 / period_ns), 1)
        self._brake_on, self._brake_current_a = 0, 0.0  # as last ordered
        self._on_their_way: dict[str, Answer] = {}

    def write_brake(self, orders: Orders) -> None:
        """Let the brake's supply take the order, when it is a new one and reaches it."""
        if orders.brake_on == self._brake_on and orders.brake_current_a == self._brake_current_a:
            return
        if self._faults.device("brake")[0] in ("off", "exception", "silence"):
            return
        self._brake_on, self._brake_current_a = orders.brake_on, orders.brake_current_a
        current = round(orders.brake_current_a / CURRENT_STEP_A) * CURRENT_STEP_A if orders.brake_on else 0.0
        self._plant.set_brake_current(current)

    def answer(self, scan: int) -> None:
        """Let the devices answer whose turn it is in this scan."""
        if not self._faults.active:
            self._on_their_way.clear()
            if scan % self._sample_every == 0:
                self._take_shown(scan)
            if scan % self._brake_every == 0:
                self._take_brake(self._read_brake(), scan)
            if scan % self._io_every == 0:
                self._take_io(self._read_io(), scan)
            return
        came = self._came("amplifier", scan, self._sample_every, self._plant.sample)
        if came is not None and self._frozen("amplifier"):
            self.sample_scan = scan + 1
        elif came is not None:
            self._take_sample(came.values, scan)
        # values of a device whose life counter stands still go on ageing, as in the driver
        came = self._came("brake", scan, self._brake_every, self._read_brake)
        if came is not None and not self._frozen("brake"):
            self._take_brake(came.values, scan)
        came = self._came("remote_io", scan, self._io_every, self._read_io)
        if came is not None and not self._frozen("remote_io"):
            self._take_io(came.values, scan)

    def links_lost(self) -> int:
        """Return the bits of `Link` for the devices that faults have cut off."""
        if DEVICES.isdisjoint(self._faults.targets):
            return 0
        return sum(bit for device, bit in LINKS.items() if self._faults.device(device)[0] in ("off", "exception"))

    def _came(self, device: str, scan: int, every: int, read: Callable[[], Any]) -> Answer | None:
        """Return the answer that comes before the next scan, to the request of this scan or to one before it."""
        if scan % every and DEVICES.isdisjoint(self._faults.targets) and not self._on_their_way:
            return None
        verb, value = self._faults.device(device)
        if verb != "slow":
            self._on_their_way.pop(device, None)
            return Answer(scan, read()) if verb in ("", "freeze") and scan % every == 0 else None
        if device not in self._on_their_way:
            late_scans = max(round(value * 1e6 / self._period_ns), 1) - 1
            self._on_their_way[device] = Answer(scan + late_scans, read())
        answer = self._on_their_way[device]
        return self._on_their_way.pop(device) if scan >= answer.comes else None

    def _frozen(self, device: str) -> bool:
        return self._faults.device(device)[0] == "freeze"

    def _take_shown(self, scan: int) -> None:
        """Take the newest sample, which no fault disturbs: by far the most, so without making one."""
        plant, image = self._plant, self._image
        shown, counter = plant.shown, plant.counter
        image.torque_in_nm = shown.torque_in_nm
        image.torque_out_nm = shown.torque_out_nm
        image.angle_in_rad = shown.angle_in_rad
        image.angle_out_rad = shown.angle_out_rad
        image.sample_counter = counter & 0xFFFFFFFF
        image.sample_time_us = counter * SAMPLE_US & 0xFFFFFFFF
        image.sample_status = shown.saturated
        self.sample_scan = scan + 1

    def _take_sample(self, sample: Sample, scan: int) -> None:
        image = self._image
        image.torque_in_nm = sample.torque_in_nm
        image.torque_out_nm = sample.torque_out_nm
        image.angle_in_rad = sample.angle_in_rad
        image.angle_out_rad = sample.angle_out_rad
        image.sample_counter = sample.counter
        image.sample_time_us = sample.time_us
        image.sample_status = sample.status
        self.sample_scan = scan + 1

    def _read_brake(self) -> tuple[float, int]:
        return (self._plant.brake_current_a, self._brake_on)

    def _take_brake(self, values: tuple[float, int], scan: int) -> None:
        self._image.brake_current_a, self._image.brake_on = values
        self.brake_scan = scan + 1

    def _read_io(self) -> dict[str, float]:
        shown = remote_io_shows(self._plant, self._faults)
        return {
            field.name: round(shown[field.name] / TEMPERATURE_STEP_C) * TEMPERATURE_STEP_C
            if field.unit == "°C"
            else int(shown[field.name])
            for field in REMOTE_IO_FIELDS
        }

    def _take_io(self, values: dict[str, float], scan: int) -> None:
        for name, value in values.items():
            setattr(self._image, name, value)
        self.io_scan = scan + 1
