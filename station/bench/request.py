"""What is asked for, checked before anything moves: recipe, bench, profiles, unit and scenario."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path

import drivers
from definitions.profiles.drive import DriveProfile
from definitions.program import Program
from definitions.protections import NOT_TRIED, UNPROVEN, missing_text
from drivers.can.identifiers import identifier_problems
from drivers.errors import Problem as DriverProblem
from drivers.modbus.part_fields import PART_FIELDS, part_problems
from drivers.servo_drive.objects import missing_protections, output_brake_problems
from recipes import (
    Bench,
    Problem,
    Recipe,
    RecipeError,
    check,
    default_bench,
    find_bench,
    find_recipe,
    parse_bench,
    parse_recipe,
    read_bytes,
    warnings,
)
from recipes.checks.bus_load import BusFrame, bus_findings, bus_us
from recipes.checks.missing_profile import missing_profile
from recipes.compiler.compiler import compile_program
from recipes.text.yaml_source import refuse_misleading
from station.atomic_file import read_file
from station.bench.assemble import drive_brake_config, drive_profile, modbus_profile
from station.bench.bus_traffic import bus_frames
from station.bench.commissioned import (
    commissioning_note,
    is_virtual_drive,
    parts_of,
    read_protocol,
    standings,
    watchdogs_measured,
)
from station.bench.files import named_bench
from station.bench.measuring import (
    can_sensors,
    channel_problems,
    channels,
    channels_not_proven,
    missing_of_brake,
    missing_of_drive_brake,
)
from station.documents.commissioning import StepDone
from station.errors import StationError
from station.records.master_parts import ProductRecipe, product_recipe
from station.records.run_record import BENCH_COPY, PROFILE_ENDINGS, PROFILES, RECIPE_COPY, RunRecord
from station.there import is_file, is_folder, is_there

DRIVER_PROFILES = Path(drivers.__file__).parent / "profiles"

PART_NAMES = {"amplifier": "Amplifier", "brake": "Brake", "remote_io": "Remote I/O"}

TRACE_ENDINGS = (".csv", ".parquet", ".tdms")
"""By which a name is that of a file, and not of a stored run."""


@dataclass(frozen=True)
class Source:
    """A file as it was read once: these bytes are parsed, checked, and kept in the record."""

    path: Path
    content: bytes

    @classmethod
    def read(cls, path: Path) -> Source:
        """Read a file; RecipeError when it cannot be read."""
        return cls(path, read_bytes(path))

    def recipe(self) -> Recipe:
        """Return the recipe in these bytes; RecipeError with all of its problems."""
        return parse_recipe(self.content, str(self.path))

    def bench(self) -> Bench:
        """Return the bench in these bytes; RecipeError with all of its problems."""
        return parse_bench(self.content, str(self.path))

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes, as hexadecimal digits."""
        return hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True)
class Job:
    """A recipe on a bench, both loaded and checked against each other."""

    recipe: Recipe
    bench: Bench
    recipe_source: Source
    bench_source: Source

    @cached_property
    def program(self) -> Program:
        """What the controller steps through."""
        return compile_program(self.recipe, self.bench)

    @property
    def product(self) -> ProductRecipe:
        """Whom the master parts of the bench are to speak for."""
        return product_recipe(self.recipe, self.recipe_source.sha256)

    @property
    def warnings(self) -> list[str]:
        """What of the recipe may be meant, but is not usual."""
        return [f"recipe {one.as_warning()}" for one in warnings(self.recipe, self.bench, self.recipe_source.path)]

    @cached_property
    def drive_notes(self) -> tuple[str, ...]:
        """What every result on this bench says of its drive: what it lacks, what nobody tried, what nobody measured.

        Of its commissioning too, where something has changed since.

        What the drive of a virtual bench does is known from itself.
        """
        profile = self._drive_profile
        untried = f"drive profile '{profile.profile.name}': {NOT_TRIED}. Compare every value with the drive's manual."
        said = [] if profile.tried_on_hardware else [untried]
        said += [missing_text(one) for one in missing_protections(profile)]
        is_virtual = self.bench.bench.embedded or self.bench.pace is not None
        said += [] if is_virtual or self.watchdogs is not None else [UNPROVEN]
        return tuple(said + ([self.commissioning] if self.commissioning else []))

    @cached_property
    def commissioning(self) -> str:
        """What has to be said of this bench's commissioning, '' where it holds or never began.

        Raises:
            RecordError: the protocol of the bench is damaged.

        """
        protocol = read_protocol(self.bench_source.path, self.bench)
        if not protocol.steps:
            return ""
        return commissioning_note(standings(protocol, parts_of(self.bench, self.profile_sources)))

    @property
    def _drive_profile(self) -> DriveProfile:
        return drive_profile(self.profile_sources[self.bench.drive.profile])

    @cached_property
    def watchdogs(self) -> StepDone | None:
        """The measurement of the drive's watchdogs on this bench, as it is now; None where there is none that passed.

        Raises:
            RecordError: the protocol of the bench is damaged.

        """
        return watchdogs_measured(self.bench_source.path, self.bench, self.profile_sources)

    @property
    def virtual(self) -> bool:
        """Whether its units are virtual: on an embedded bench, and wherever the drive can only be the virtual one.

        A virtual bench that was started by itself looks like a real one, but for what every run checks in its drive.
        """
        shipped = DRIVER_PROFILES / "virtual-drive.yaml"
        return self.bench.bench.embedded or is_virtual_drive(self._drive_profile, shipped)

    @property
    def no_automatic_run(self) -> str:
        """Why no run may start by itself on this bench and no jog may begin, with what to do; '' where they may.

        A drive that is not the virtual one has to have shown that it ends its torque when the program dies.

        Raises:
            RecordError: the protocol of the bench is damaged.

        """
        if self.virtual or self.watchdogs is not None:
            return ""
        path = self.bench_source.path
        return (
            f"{path}: the watchdogs of drive '{self._drive_profile.profile.name}' were not measured on this bench as "
            f"it is now. For the next step, run: lostmotion bench status --bench {path}"
        )

    @property
    def profile_names(self) -> tuple[str, ...]:
        """Device profiles that the bench file names, each once."""
        return self.bench.profile_names

    @cached_property
    def profile_paths(self) -> dict[str, Path]:
        """Files of the device profiles; RecipeError with every one that is not there."""
        paths, problems = dict[str, Path](), list[Problem]()
        for name in self.profile_names:
            try:
                paths[name] = find_profile(name, self.bench_source.path)
            except RecipeError as error:
                problems += error.problems
        if problems:
            raise RecipeError(problems)
        return paths

    @cached_property
    def profile_sources(self) -> dict[str, Source]:
        """The device profiles, each read once and in order; RecipeError with the problems of all of them."""
        sources = {name: Source.read(path) for name, path in self.profile_paths.items()}
        problems: list[Problem] = []
        on_modbus = {one.profile for one in self.bench.modbus_devices.values()}
        for name, source in sources.items():
            try:
                if name == self.bench.drive.profile:
                    drive_profile(source)
                elif name in on_modbus:
                    modbus_profile(source)
            except RecipeError as error:
                problems += error.problems
        try:
            can_sensors(self.bench, sources)
        except RecipeError as error:
            problems += error.problems
        if problems:
            raise RecipeError(problems)
        return sources

    @cached_property
    def bus_frames(self) -> tuple[BusFrame, ...]:
        """Every frame with a period on the CAN bus, as the device profiles have them."""
        drive = drive_profile(self.profile_sources[self.bench.drive.profile])
        return tuple(bus_frames(self.recipe, self.bench, drive, can_sensors(self.bench, self.profile_sources)))

    @property
    def bus_us(self) -> float:
        """How long the frames of one scan occupy the CAN bus, at worst [µs]."""
        return bus_us(self.bus_frames, self.bench.can.bitrate)

    @cached_property
    def not_proven(self) -> tuple[str, ...]:
        """What the devices of this bench cannot prove, a sentence each: it stands in every result."""
        said = [
            f"{PART_NAMES.get(name, name)}: no identity in profile {device.profile}. Only its address says which device"
            " answers."
            for name, device in self.bench.modbus_devices.items()
            if modbus_profile(self.profile_sources[device.profile]).identity is None
        ]
        if self.bench.brake is not None:
            said += missing_of_brake(modbus_profile(self.profile_sources[self.bench.brake.profile]))
        if self.bench.drive_brake is not None:
            said += missing_of_drive_brake(self.bench.drive_brake)
        return (*said, *channels_not_proven(self.bench, can_sensors(self.bench, self.profile_sources)))


def find_profile(name: str, bench_path: Path) -> Path:
    """Return a profile's file: from `profiles/` beside the bench file, from beside it, or the shipped one.

    That of a CAN sensor may be a DBC file. RecipeError with every place that names one which is nowhere.
    """
    folders = (bench_path.parent / "profiles", bench_path.parent, DRIVER_PROFILES)
    places = [folder / f"{name}{ending}" for folder in folders for ending in PROFILE_ENDINGS]
    for place in places:
        if place.is_file():
            return place
    shipped = [path for path in DRIVER_PROFILES.iterdir() if path.suffix in PROFILE_ENDINGS]
    raise missing_profile(name, bench_path, shipped)


def trace_file(name: str) -> Path | None:
    """Return the file of a trace that was measured elsewhere; None for the name of a stored run.

    Raises:
        StationError: what is named is a file by its ending, and is not there.

    """
    path = Path(name)
    if is_file(path):
        return path
    if path.suffix in TRACE_ENDINGS:
        what = "is a folder; name the file in it" if is_folder(path) else "there is no such file"
        raise StationError(f"{name}: {what}")
    return None


def as_written(path: Path) -> Source:
    """Read a bench file that is named, and has nothing left empty where it is no copy in a record."""
    source = Source.read(path)
    named_bench(source.content, path)
    return source


def _bench_file(name: str | None, recipe: Recipe | None) -> Path:
    """Return the file of the bench that was named, or of the one that this recipe runs on."""
    if name is None and recipe is not None:
        return default_bench(recipe)[0]
    return find_bench(name or "")


def stored_job(run: RunRecord) -> Job:
    """Load recipe and bench of a stored run as they were accepted then: what is out of date since was not on its day.

    Raises:
        RecipeError: what stands in recipe, bench or a profile cannot be accepted any more.
        RecordError: run.json is damaged, or one of the files cannot be read now.

    """
    return _loaded(
        lambda: _stored_source(run.folder / RECIPE_COPY), lambda _: _stored_bench(run), run.day(), in_record=True
    )


def stored_job_on(run: RunRecord, bench_name: str) -> Job:
    """Load the recipe of a stored run as it was accepted then, for a bench as it is today; otherwise as `load_job`."""
    job = _loaded(
        lambda: _stored_source(run.folder / RECIPE_COPY),
        lambda recipe: as_written(_bench_file(bench_name, recipe)),
        None,
        in_record=True,
    )
    _check_parts(job)
    return job


def _stored_bench(run: RunRecord) -> Source:
    """Read the bench file of a record, whose profiles are there too: no other, as the shipped one, is taken for them.

    What else lies in the folder of the profiles is nobody's.
    """
    source = _stored_source(run.folder / BENCH_COPY)
    for name in source.bench().profile_names:
        places = [run.folder / PROFILES / f"{name}{ending}" for ending in PROFILE_ENDINGS]
        _stored_source(next((place for place in places if is_there(place) is not False), places[0]))
    return source


def _stored_source(path: Path) -> Source:
    """Read a file of a record; RecordError when it cannot be read: that may pass, and says nothing of its content."""
    return Source(path, read_file(path))


def load_job(recipe_name: str | Source, bench_name: str | None, day: date | None = None) -> Job:
    """Load recipe, bench and profiles and check them against each other; every file is read exactly once.

    The recipe is named, or was read already. `day` is the one that calibrations have to be in date on, else today.

    Raises:
        RecipeError: with all problems of both files, or all that speaks against the pair.

    """
    job = _loaded(
        lambda: recipe_name if isinstance(recipe_name, Source) else Source.read(find_recipe(recipe_name)),
        lambda recipe: None if bench_name is None and recipe is None else as_written(_bench_file(bench_name, recipe)),
        day,
    )
    _check_parts(job)
    return job


def _told(one: DriverProblem, path: Path, part: str) -> Problem:
    found = f"a profile that {one.what}: {one.found}"
    return Problem(str(path), 0, 0, part, found, one.expected, f"{_begun(one.next_step)}.")


def _begun(text: str) -> str:
    return text[:1].upper() + text[1:]


def _check_parts(job: Job) -> None:
    """Refuse device profiles that do not deliver what their parts of the bench need; RecipeError with all of them."""
    names = {name: device.profile for name, device in job.bench.modbus_devices.items()}
    profiles = {name: modbus_profile(job.profile_sources[profile]) for name, profile in names.items()}
    parts = {part: profiles[part] for part in PART_FIELDS if part in profiles}
    problems = [
        _told(one, job.profile_sources[names[part]].path, part)
        for part in parts
        for one in part_problems(parts, channels(job.bench))
        if one.where.startswith(f"{part} ")
    ]
    measuring = {name: profile for name, profile in profiles.items() if name not in PART_FIELDS}
    path, sensors = str(job.bench_source.path), can_sensors(job.bench, job.profile_sources)
    problems += [
        Problem(path, 0, 0, "channels", f"{one.found} in {one.where}", one.expected, f"{_begun(one.next_step)}.")
        for one in channel_problems(job.bench, measuring, sensors)
    ]
    drive = drive_profile(job.profile_sources[job.bench.drive.profile])
    node_ids = job.bench.drive.node_id, job.bench.drive.controller_node_id
    problems += [
        Problem(path, 0, 0, "can_devices", f"{one.where}: {one.found}", one.expected, f"{_begun(one.next_step)}.")
        for one in identifier_problems(sensors, drive, *node_ids)
    ]
    brake = drive_brake_config(job.bench)
    problems += [
        Problem(path, 0, 0, "drive_brake", f"{one.where}: {one.found}", one.expected, f"{_begun(one.next_step)}.")
        for one in (() if brake is None else output_brake_problems(brake, drive))
    ]
    problems += [job.recipe.problem(*one) for one in bus_findings(job.recipe, job.bench, job.bus_frames)]
    if problems:
        raise RecipeError(problems)


def _loaded(
    read_recipe: Callable[[], Source],
    read_bench: Callable[[Recipe | None], Source | None],
    day: date | None,
    *,
    in_record: bool = False,
) -> Job:
    """Read both files, and check each and the pair; `read_bench` is told the recipe, None where that is none.

    in_record: the recipe is the copy in a record.
    """
    problems: list[Problem] = []
    recipe: Recipe | None = None
    bench: Bench | None = None
    try:
        recipe_source = read_recipe()
        if not in_record:
            refuse_misleading(recipe_source.content, str(recipe_source.path))
        recipe = recipe_source.recipe()
    except RecipeError as error:
        problems += error.problems
    try:
        bench_source = read_bench(recipe)
        bench = None if bench_source is None else bench_source.bench()
    except RecipeError as error:
        problems += error.problems
    if recipe is None or bench is None or bench_source is None or problems:
        raise RecipeError(problems)
    found = check(recipe, bench, recipe_source.path, day, in_record=in_record)
    if found:
        raise RecipeError(found)
    job = Job(recipe, bench, recipe_source, bench_source)
    _ = job.profile_sources
    return job
