"""A bench that is commissioned: its files, what the drivers want of them, and its Modbus devices looked at by hand."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from drivers.config import WireBenchConfig
from drivers.errors import DriverError, Problem
from drivers.modbus.device import ModbusDevice
from drivers.modbus.frames import Outcome
from drivers.wire_bench import WireBench
from recipes import Bench, find_bench
from station.bench.assemble import wire_config
from station.bench.bench_lock import alone_on
from station.bench.commissioned import parts_of
from station.bench.request import Source, as_written, find_profile
from station.errors import BenchFaultError, StationError

PERIOD_NS = 1_000_000
"""Scan period of the steps: the one of the shipped recipes."""


class Scale(NamedTuple):
    """Scale of a channel as it is, and the place where it is written."""

    value: float
    place: str


@dataclass(frozen=True)
class OnWires:
    """A bench file whose bench is on its own wires, with the profiles that it names."""

    source: Source
    bench: Bench

    @property
    def path(self) -> Path:
        """The bench file."""
        return self.source.path

    @cached_property
    def profiles(self) -> Mapping[str, Source]:
        """Files of the profiles, by name; RecipeError for one that is not there."""
        return {name: Source.read(find_profile(name, self.path)) for name in self.bench.profile_names}

    @cached_property
    def wires(self) -> WireBenchConfig:
        """What the drivers want to be told; RecipeError with the problems of a profile."""
        return wire_config(self.bench, self.profiles, PERIOD_NS, None)

    @cached_property
    def parts(self) -> dict[str, str]:
        """Every entry of bench file and profiles, by its dotted name."""
        return parts_of(self.bench, self.profiles)

    def scale_of(self, channel: str) -> Scale | None:
        """Return the scale of a measured channel and where it is written; None for one that no file has."""
        bench = self.bench
        if bench.channels is not None:
            source = bench.channels.by_name.get(channel.rsplit("_", 1)[0])
            place = f"channels.{channel.rsplit('_', 1)[0]} of the bench file"
            return None if source is None else Scale(source.scale, place)
        if self.wires.amplifier is None:
            return None
        profile = self.wires.amplifier.profile
        field = next((one for one in profile.read.fields if one.name == channel), None)
        return None if field is None else Scale(field.scale or 1.0, f"{channel} in profile {profile.profile.name}")

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Have the bench for this process alone, and tell trouble of the wires as a fault of the bench.

        Raises:
            BenchBusyError: another process has it.
            BenchFaultError: what a driver had to say.

        """
        try:
            with alone_on(self.bench.bench.name, self.wires.can, self.wires.modbus):
                yield
        except DriverError as error:
            raise BenchFaultError(str(error)) from error


def on_wires(bench_name: str) -> OnWires:
    """Return a bench to be commissioned.

    Raises:
        RecipeError: bench file or a profile have problems.
        StationError: the program starts this bench itself, so there is nothing to commission.

    """
    path = find_bench(bench_name)
    source = as_written(path)
    bench = source.bench()
    if bench.bench.embedded:
        hint = "Start `lostmotion virtual-bench`, and name a bench file with its ports"
        raise StationError(f"{path}: the embedded virtual bench exists only during a run. {hint}")
    return OnWires(source, bench)


class ByHand:
    """The Modbus devices of a bench, opened and read without a scan; the drive is not touched."""

    def __init__(self, wires: WireBenchConfig) -> None:
        """Prepare the devices; ProfileError when a profile does not fit its part."""
        whole = WireBench(wires)
        names = [*(one.name for one in wires.measuring), *(() if wires.amplifier is None else ("amplifier",))]
        blocks = [
            f"{name} block {names[:place].count(name) + 1}" if names.count(name) > 1 else name
            for place, name in enumerate(names)
        ]
        self.measuring = dict(zip(blocks, names, strict=True))
        """The devices that measure, each block apart, with the name that the bench file has for the device."""
        self.devices: dict[str, ModbusDevice] = dict(zip(blocks, whole.amplifiers, strict=True))
        if isinstance(whole.brake, ModbusDevice):
            self.devices["brake"] = whole.brake
        self.devices["remote_io"] = whole.remote_io
        self._lines = list(dict.fromkeys(device.line for device in self.devices.values()))
        self.scan = 0
        """Milliseconds since the lines were opened: what ages count in."""
        self._opened_s = 0.0

    @contextmanager
    def opened(self, *parts: str) -> Iterator[ByHand]:
        """Open the lines and prove the identity of these devices; of all without a name.

        Raises:
            DriverError: no connection, or another device than the profile's.

        """
        try:
            for line in self._lines:
                line.open()
            self._opened_s = time.monotonic()
            problems = [problem for name in parts or tuple(self.devices) for problem in _identified(self.devices[name])]
            if problems:
                raise DriverError(*problems)
            yield self
        finally:
            for line in self._lines:
                line.close()

    def step(self) -> None:
        """Take what has come and ask for what is due; called once in every millisecond or so."""
        self.scan = int((time.monotonic() - self._opened_s) * 1e3)
        for device in self.devices.values():
            device.poll(self.scan)
            if device.line.ready(self.scan):
                device.send(self.scan)

    def block(self, part: str) -> bytes:
        """Read the block of a device at once (blocking, bounded) and return its registers as they came.

        Raises:
            DriverError: it does not answer.

        """
        device = self.devices[part]
        config, read = device.config, device.config.profile.read
        request = device.line.frames.read_request(config.unit_id, read.table, read.address, read.count)
        reply = device.line.exchange(request, config.connect_timeout_s)
        if reply.outcome is not Outcome.DATA:
            found = f"{reply.outcome.name.lower()} {reply.exception_code or ''}".strip()
            where = f"{config.where} {read.table} registers {read.address} to {read.address + read.count - 1}"
            hint = "compare table, address and count with the device's manual"
            raise DriverError(Problem("the block cannot be read", where, found, "its registers", hint))
        return bytes(reply.data)


def _identified(device: ModbusDevice) -> list[Problem]:
    """Read the identity of a device; what is wrong with it."""
    identity, config = device.config.profile.identity, device.config
    reply = device.verify()
    check = "check power, address, unit id and profile"
    if reply.outcome is not Outcome.DATA:
        found = f"{reply.outcome.name.lower()} {reply.exception_code or ''}".strip()
        return [Problem("does not answer", config.where, found, "its registers", check)]
    if identity is not None and not device.trusted:
        where = f"{config.where} {identity.table} register {identity.address}"
        return [Problem("another device answers", where, f"0x{reply.data.hex().upper()}", identity.shown, check)]
    return []


def pause(seconds: float) -> None:
    """Wait between two looks."""
    time.sleep(seconds)
