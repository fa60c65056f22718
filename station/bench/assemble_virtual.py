"""From a bench file to the virtual bench that plays it: plant, drive, sensors and servers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from recipes import Bench, Recipe, RecipeError, load_document, parse_document
from recipes.schema.device_schema import ModbusDevice
from recipes.schema.sensor_schema import AngleSensor as AngleSensorFile
from recipes.schema.sensor_schema import TorqueSensor as TorqueSensorFile
from recipes.text.yaml_source import read_source
from station.bench.assemble import drive_brake_config, drive_config, drive_profile, modbus_profile
from station.bench.files import File, FileAt
from station.bench.measuring import can_sensors, sources
from station.bench.virtual_unit import VirtualUnit, drawn_seed
from station.records.clocks import SCAN, VIRTUAL, WALL
from virtual_bench.config import (
    AngleSensor,
    BenchConfig,
    BrakeConfig,
    CanBus,
    CanSensorPort,
    Catalogue,
    ModbusPort,
    PaceServer,
    ServerConfig,
    Shown,
    SlcanPort,
    Socketcand,
    TorqueSensor,
)
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.names import VOCABULARY, Vocabulary
from virtual_bench.faults.scenario import Scenario, Start
from virtual_bench.faults.vocabulary import FAULTS, NOT_BY_WALL_CLOCK, only_over_wires, vocabulary_of
from virtual_bench.physics.find_unit import default_unit, find_unit, units_of

Profiles = Mapping[str, Path]


def choose_unit(asked: str | None, recipe: Recipe, seed: int | None = None) -> VirtualUnit:
    """Return the unit to put on the virtual bench; VirtualBenchError when there is none like it, or of another model.

    `asked` is NAME[:SEED], by default the good unit of the recipe's model. Without `seed` one is drawn.
    """
    unit = default_unit(recipe.unit_under_test.model) if asked is None else asked
    catalogue = catalogue_of(recipe)
    found = find_unit(unit, catalogue).model
    if found != catalogue.model:
        raise VirtualBenchError(
            f"--unit: found {unit!r}, which is of model {found}, and recipe '{recipe.recipe.name}' is for model "
            f"{catalogue.model}; allowed {', '.join(units_of(catalogue.model))}. Name one of these, or leave --unit out"
        )
    return VirtualUnit(unit, drawn_seed() if seed is None else seed, catalogue)


def catalogue_of(recipe: Recipe) -> Catalogue:
    """Return what a recipe says of its model, and what it demands of it."""
    unit, metrics = recipe.unit_under_test, recipe.metrics
    return Catalogue(
        model=unit.model,
        ratio=unit.ratio,
        rated_torque_nm=unit.rated_torque_nm,
        stiffness_nm_per_arcmin=unit.stiffness_nm_per_arcmin,
        loading_slope=unit.loading_torque_ratio.slope,
        loading_offset_nm=unit.loading_torque_ratio.offset_nm,
        most={metric.id: metric.max for metric in reversed(metrics) if metric.max is not None},
        least={metric.id: metric.min for metric in reversed(metrics) if metric.min is not None},
    )


class StartOnly(BaseModel):
    """The section of a scenario that says which recipe, and with it which bench, the rest is for."""

    model_config = ConfigDict(extra="ignore", frozen=True)
    start: Start = Start()


def load_start(path: Path) -> Start:
    """Load what a scenario begins with; RecipeError with every problem of it and its place."""
    return load_document(path, StartOnly).start


def vocabulary_on(bench: Bench, profiles: Mapping[str, File]) -> Vocabulary:
    """Return the faults that a scenario may name on a bench: its devices that measure have them by their names."""
    devices = {name: modbus_profile(profiles[one.profile]) for name, one in bench.modbus_devices.items()}
    return vocabulary_of(devices, {one.name: one.node_id is not None for one in bench.can_devices})


def load_scenario(path: Path, vocabulary: Vocabulary = FAULTS) -> Scenario:
    """Load a scenario file for a bench with this vocabulary; RecipeError with every problem and its place."""
    return load_document(path, Scenario, {VOCABULARY: vocabulary})


def parse_scenario(raw: bytes, path: str, vocabulary: Vocabulary = FAULTS) -> Scenario:
    """Load a scenario from the bytes of its file; as `load_scenario`."""
    return parse_document(raw, path, Scenario, {VOCABULARY: vocabulary})


LACKING: dict[str, tuple[Callable[[str, str], bool], str, str]] = {
    WALL: (
        lambda target, verb: (target, verb) in NOT_BY_WALL_CLOCK,
        "a fault that is possible by the wall clock",
        "Leave --wall-clock out, or --wires",
    ),
    SCAN: (lambda _target, _verb: False, "", ""),
    VIRTUAL: (
        only_over_wires,
        "a fault that virtual time can have",
        "Run it over wires: add --wires to 'faults run', or leave --virtual-time out of 'run'",
    ),
}
"""Whether a clock cannot have a fault, what is allowed, and what to do."""


def check_clock(path: Path, scenario: Scenario, clock: str) -> None:
    """Refuse faults that the clock of the run cannot have; RecipeError with every one of them."""
    lacking, allowed, hint = LACKING[clock]
    wrong = [place for place, fault in enumerate(scenario.faults) if lacking(fault.target, fault.verb)]
    if wrong:
        source, faults = read_source(path), scenario.faults
        raise RecipeError(
            source.problem(("faults", place, "verb"), f"{faults[place].target} {faults[place].verb}", allowed, hint)
            for place in wrong
        )


def virtual_config(bench: Bench, profiles: Profiles, unit: VirtualUnit) -> BenchConfig:
    """Return the plant, drive and sensors that stand in for the hardware of a bench file."""
    sensors, brake = bench.sensors, bench.lock_brake
    return BenchConfig(
        unit=unit.name,
        loading=bench.bench.loading,
        drive=drive_config(bench, drive_profile(FileAt(profiles[bench.drive.profile]))),
        brake=BrakeConfig(brake.torque_constant_nm_per_a, brake.max_current_a, brake.time_constant_s),
        torque_in=_torque(sensors.torque_in),
        torque_out=_torque(sensors.torque_out),
        angle_in=_angle(sensors.angle_in),
        angle_out=None if sensors.angle_out is None else _angle(sensors.angle_out),
        fixture_stiffness_nm_per_arcmin=_lock_nm_per_arcmin(bench),
        noise_seed=unit.seed,
        catalogue=unit.catalogue,
        amplifier_every_s=bench.sample_every_s,
        brake_every_s=brake.poll_every_s,
        drive_brake=drive_brake_config(bench),
        remote_io_every_s=bench.remote_io.poll_every_s,
    )


def _lock_nm_per_arcmin(bench: Bench) -> float:
    """Return the stiffness of the virtual lock, at the locked shaft: all of its fixture that gives way."""
    parts = bench.fixture.parts
    if parts is None or bench.bench.loading == "input":
        return bench.fixture.output_side_nm_per_arcmin
    return parts.input_nm_per_arcmin


def _torque(sensor: TorqueSensorFile | None) -> TorqueSensor | None:
    if sensor is None:
        return None
    return TorqueSensor(sensor.full_scale_nm, sensor.accuracy_fraction, sensor.noise_fraction, sensor.lag_s)


def _angle(sensor: AngleSensorFile) -> AngleSensor:
    return AngleSensor(round(sensor.resolution_bits), sensor.noise_rad, sensor.lag_s)


PROOF_SHOWS = {"counter": "sample_counter", "time_stamp": "sample_time_us"}
"""What a virtual device shows in the field that proves its values new."""


def shown_by(bench: Bench, device: str) -> tuple[Shown, ...]:
    """Return what the fields of a measuring device show: the channels that come from it, and what proves them new."""
    there = [one for one in sources(bench) if one.device == device]
    told = {} if bench.channels is None else bench.channels.by_name
    proofs = {
        one.alive_field: PROOF_SHOWS[one.alive]
        for one in told.values()
        if one.device == device and one.alive_field is not None and one.alive in PROOF_SHOWS
    }
    return (
        *(Shown(one.field, one.channel, one.scale, one.zero) for one in there),
        *(Shown(field, shows) for field, shows in proofs.items()),
    )


def server_config(
    bench: Bench,
    profiles: Profiles,
    unit: VirtualUnit,
    *,
    scenario: Path | None,
    embedded: bool,
    truth: Path | None = None,
    waits: bool = False,
) -> ServerConfig:
    """Return the virtual bench as a process; an embedded one takes free loopback ports and ends with its parents.

    `waits`: it lets a scan lead.
    """
    can = bench.can

    def port(name: str, device: ModbusDevice) -> ModbusPort:
        registers = modbus_profile(FileAt(profiles[device.profile]))
        shows = shown_by(bench, name)
        if embedded:
            connection = device.line if device.transport == "tcp" else ""
            return ModbusPort(registers, device.unit_id, connection=connection, shows=shows)
        if device.transport == "rtu":
            return ModbusPort(registers, device.unit_id, rtu=True, serial_port=device.serial_port, shows=shows)
        return ModbusPort(registers, device.unit_id, device.host, device.port, connection=device.line, shows=shows)

    files = {name: FileAt(path) for name, path in profiles.items()}
    bus: Socketcand | CanBus | SlcanPort = CanBus(can.interface, can.channel, can.bitrate)
    if embedded or can.interface == "socketcand":
        bus = Socketcand(channel=can.channel) if embedded else Socketcand(can.host, can.port, can.channel)
    elif can.interface == "slcan":
        bus = SlcanPort(can.channel, bitrate=can.bitrate)
    return ServerConfig(
        bench=virtual_config(bench, profiles, unit),
        devices={name: port(name, device) for name, device in bench.modbus_devices.items()},
        can=bus,
        can_sensors=tuple(
            CanSensorPort(
                name=one.name,
                node_id=sensor.node_id,
                frames=sensor.frames,
                every_s=one.update_every_s,
                shows=shown_by(bench, one.name),
                identity=sensor.identity,
                startup=sensor.startup,
            )
            for one, sensor in zip(bench.can_devices, can_sensors(bench, files), strict=True)
        ),
        scenario=scenario,
        end_with_parent=embedded,
        pace=_pace(bench, embedded=embedded) if waits else None,
        truth=truth,
    )


def _pace(bench: Bench, *, embedded: bool) -> PaceServer:
    if embedded:
        return PaceServer(from_rest=True)
    return PaceServer() if bench.pace is None else PaceServer(bench.pace.host, bench.pace.port)
