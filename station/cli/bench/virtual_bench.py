"""`lostmotion virtual-bench`: the virtual bench alone, for a controller that runs elsewhere."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import uvloop

from recipes import Bench, find_bench
from station.bench.assemble_virtual import load_scenario, server_config, vocabulary_on
from station.bench.files import FileAt, load_named_bench
from station.bench.request import find_profile
from station.bench.virtual_bench_process import play_hardware
from station.bench.virtual_unit import VirtualUnit, drawn_seed
from station.errors import StationError
from virtual_bench.config import CanBus, ModbusPort, PaceServer, ServerConfig, SlcanPort, Socketcand
from virtual_bench.devices.process_lines import log_line
from virtual_bench.physics.find_unit import find_unit
from virtual_bench.server import run

DEFAULT_BENCH = "virtual"
DEFAULT_UNIT = "P1"


def address(option: str, text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`; StationError when it is not one."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or int(port) > 65535:
        raise StationError(f"option {option}: found {text!r}; allowed is HOST:PORT, as in 127.0.0.1:29536")
    return host, int(port)


def can_bus(text: str, bench: Bench) -> Socketcand | CanBus | SlcanPort:
    """Return where the virtual drive sits.

    `HOST:PORT` serves socketcand, `slcan` is an adapter on a serial port, `socketcan:vcan0` joins a bus.
    """
    if text == "slcan":
        return SlcanPort(bitrate=bench.can.bitrate)
    interface, colon, name = text.partition(":")
    if colon and interface in ("socketcan", "slcan", "virtual"):
        return CanBus(interface, name)
    host, port = address("--can", text)
    return Socketcand(host, port, bench.can.channel)


def virtual_bench(
    bench_name: str | None,
    can: str | None,
    modbus: str | None,
    unit: str | None,
    scenario: Path | None,
    *,
    pace: str | None = None,
    seed: int | None = None,
    hands: bool = False,
) -> int:
    """Serve a virtual bench until it is interrupted; its ports are printed as one JSON line when it is ready.

    The seed of its noise goes to standard error.

    `modbus` is HOST:PORT of the measuring amplifier; brake, remote I/O and any other device take the next ports (0: any
    free ones).
    With `rtu` each device is on a serial port of its own. Serial ports that the bench file names get these names.
    With `hands` lines on standard input say what somebody at the bench does (`virtual_bench.devices.process_lines`).
    `pace` is HOST:PORT where a scan may lead the bench; without it, that of the bench file, or a free port.

    Raises:
        StationError, RecipeError, VirtualBenchError: what cannot be had as asked.

    """
    path = find_bench(bench_name or DEFAULT_BENCH)
    bench = load_named_bench(path)
    profiles = {name: find_profile(name, path) for name in bench.profile_names}
    files = {name: FileAt(at) for name, at in profiles.items()}
    faults = None if scenario is None else load_scenario(scenario, vocabulary_on(bench, files))
    chosen = VirtualUnit(DEFAULT_UNIT if unit is None else unit, drawn_seed() if seed is None else seed)
    find_unit(chosen.name)
    log_line("noise_seed", f"noise of the sensors: --seed {chosen.seed}", seed=chosen.seed)
    config = server_config(bench, profiles, chosen, scenario=scenario, embedded=False, waits=True)
    if can is not None:
        config = dataclasses.replace(config, can=can_bus(can, bench))
    if modbus == "rtu":
        config = _on_serial_ports(config)
    elif modbus is not None:
        config = _moved(config, *address("--modbus", modbus))
    if pace is not None:
        config = dataclasses.replace(config, pace=PaceServer(*address("--pace", pace)))
    config = dataclasses.replace(config, hands=hands)
    play_hardware(config)
    uvloop.run(run(config, faults))
    return 0


def _on_serial_ports(config: ServerConfig) -> ServerConfig:
    def on_one(device: ModbusPort) -> ModbusPort:
        return dataclasses.replace(device, rtu=True, serial_port="")

    return dataclasses.replace(config, devices={name: on_one(device) for name, device in config.devices.items()})


def _moved(config: ServerConfig, host: str, port: int) -> ServerConfig:
    def at(device: ModbusPort, place: int) -> ModbusPort:
        return dataclasses.replace(device, host=host, port=port + place if port else 0)

    moved = {name: at(device, place) for place, (name, device) in enumerate(config.devices.items())}
    return dataclasses.replace(config, devices=moved)
