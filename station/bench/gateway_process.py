"""Entry of the gateway before a bench on a cable: `python -m station.bench.gateway_process SPEC.json`.

The spec is a `BenchSpec` with a scenario and without a unit.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

import uvloop

from drivers.errors import DriverError
from recipes import Bench, RecipeError
from recipes.schema.device_schema import ModbusDevice
from station.bench.assemble import can_config, modbus_profile
from station.bench.assemble_virtual import load_scenario, vocabulary_on
from station.bench.bench_lock import alone_on
from station.bench.bench_spec import BenchSpec
from station.bench.files import FileAt, load_named_bench
from station.bench.measuring import can_sensors
from station.bench.virtual_bench_process import FIFO_PRIORITY
from station.documents.reading import read_document
from station.errors import StationError
from virtual_bench.devices.gateway import GatewayConfig, run_gateway
from virtual_bench.devices.modbus_gateway import ModbusTarget
from virtual_bench.devices.process_lines import log_line
from virtual_bench.errors import VirtualBenchError


def gateway_config(bench: Bench, profiles: Mapping[str, Path], *, end_with_parent: bool) -> GatewayConfig:
    """Return the gateway before the bench of a bench file; StationError when it has a device that is not on TCP."""

    def device(name: str, there: ModbusDevice) -> ModbusTarget:
        if there.transport != "tcp":
            raise StationError(
                f"fault gateway: the device {name} is on Modbus {there.transport}; the gateway needs Modbus TCP. "
                "Use a bench file in which all devices have Modbus TCP"
            )
        registers = modbus_profile(FileAt(profiles[there.profile]))
        return ModbusTarget(there.host, there.port, there.unit_id, registers)

    devices = {name: device(name, there) for name, there in bench.modbus_devices.items()}
    drive = bench.drive
    sensors = can_sensors(bench, {name: FileAt(path) for name, path in profiles.items()})
    return GatewayConfig(can_config(bench), drive.node_id, drive.controller_node_id, devices, sensors, end_with_parent)


def serve(bench: Bench, profiles: Mapping[str, Path], scenario: Path, *, end_with_parent: bool) -> None:
    """Run the gateway until it is told to end; it holds the bench, as a controller would.

    Raises:
        StationError, RecipeError, VirtualBenchError, DriverError: what cannot be had as asked.

    """
    config = gateway_config(bench, profiles, end_with_parent=end_with_parent)
    faults = load_scenario(scenario, vocabulary_on(bench, {name: FileAt(path) for name, path in profiles.items()}))
    with alone_on(bench.bench.name, can_config(bench), bench.modbus_devices.values()):
        uvloop.run(run_gateway(config, faults))


def _scenario(spec: BenchSpec) -> Path:
    if spec.scenario is None:
        raise StationError(
            "the fault gateway was started without a fault scenario. Start it with 'lostmotion faults gateway'"
        )
    return Path(spec.scenario)


def main() -> int:
    """Read the spec and serve; 2 when the bench cannot be had as asked."""
    try:
        spec = read_document(BenchSpec, Path(sys.argv[1]))
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
        except OSError as error:
            log_line("fifo_refused", str(error))
        profiles = {name: Path(path) for name, path in spec.profiles.items()}
        serve(load_named_bench(spec.bench), profiles, _scenario(spec), end_with_parent=True)
    except (VirtualBenchError, RecipeError, StationError, DriverError) as error:
        log_line("refused", str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
