"""Jogs of a bench: where they are kept, what one is made of, and whether one is on.

A jog is recorded like a run, in a folder below the runs. Its recipe only says which unit is on the bench: nothing of it
is run, and nothing is judged.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from definitions.plain_data import exact
from definitions.program import Program
from recipes.compiler.jog import ENABLING_DEVICE, PERIOD_NS, compile_jog, jog_bench, jog_speed_rad_s
from recipes.schema.bench_schema import Bench
from station.atomic_file import read_file
from station.bench.assemble import modbus_profile
from station.bench.commissioned import watchdogs_measured
from station.bench.request import Job
from station.documents.commissioning import StepDone
from station.documents.manifest import RECORDING
from station.errors import StationError
from station.records.data_folder import Store
from station.records.program_file import PROGRAM
from station.records.run_record import RunRecord
from station.records.seal import data_folder
from station.run.way_back.last_run import last_run_of, why_not_free
from station.run.way_back.recoveries import NEWEST_LOOKED_AT, recoveries

FOLDER = "jogs"


@dataclass(frozen=True)
class JogJob(Job):
    """A jog on a bench. `bench`: with the little speed and torque of a jog; `whole`: as its file has it."""

    whole: Bench
    speed_rad_s: float

    @cached_property
    def program(self) -> Program:
        """What the controller steps through: the state of a jog, and nothing of the recipe."""
        return compile_jog(self.whole, self.speed_rad_s)

    @cached_property
    def watchdogs(self) -> StepDone | None:
        """As of any job: measured on the bench as its file has it, whose speed and torque are not those of a jog."""
        return watchdogs_measured(self.bench_source.path, self.whole, self.profile_sources)


def jog_job(job: Job, share: float) -> JogJob:
    """Return the jog on the bench of a job, at this share of its largest speed, above 0 and at most 1.

    Raises:
        StationError: the bench has no enabling device, or the share is none.

    """
    if not 0.0 < share <= 1.0:
        raise StationError(
            f"--speed: found {share:g}; allowed are values above 0, up to 1 of the largest speed of a jog"
        )
    name = job.bench.remote_io.profile
    profile = modbus_profile(job.profile_sources[name])
    fields = {field.name for block in (profile.read, *profile.read_also) for field in block.fields}
    if ENABLING_DEVICE not in fields:
        raise StationError(
            f"bench '{job.bench.bench.name}' has no enabling device, so it has no jog: profile {name} of its remote "
            f"I/O has no field '{ENABLING_DEVICE}'. Wire a three-position enabling device, and add the field"
        )
    sampling = job.recipe.sampling.model_copy(update={"period_ns": PERIOD_NS})
    return JogJob(
        recipe=job.recipe.model_copy(update={"sampling": sampling}),
        bench=jog_bench(job.bench),
        recipe_source=job.recipe_source,
        bench_source=job.bench_source,
        whole=job.bench,
        speed_rad_s=share * jog_speed_rad_s(job.bench),
    )


def jogs(data: Path) -> Store:
    """Return the jogs of a data folder."""
    return Store(data / FOLDER)


def jog_is_on(data: Path) -> bool:
    """Say whether somebody jogs the bench of a data folder; one whose record cannot be read counts as on."""
    return any(_is_on(one) for one in jogs(data).newest(1))


def program_of(jog: RunRecord) -> Program:
    """Return the program of a jog as it was recorded.

    Raises:
        StationError: it cannot be read.

    """
    path = jog.folder / PROGRAM
    try:
        return exact(Program, json.loads(read_file(path)), unlimited=True)
    except (ValueError, TypeError) as error:
        raise StationError(f"{path}: cannot be read: {error}") from error


def stored_jog(jog: RunRecord, job: Job) -> JogJob:
    """Return a recorded jog as it was, of recipe and bench in its record; StationError where it cannot be read."""
    recorded = program_of(jog).jog
    if recorded is None:
        raise StationError(f"{jog.folder / PROGRAM}: is not the program of a jog. Name another record")
    whole = jog_job(job, 1.0)
    return replace(whole, speed_rad_s=recorded.speed_rad_s)


def find_record(data: Path, name: str, *, alone: bool = False) -> tuple[RunRecord, bool]:
    """Return a run as `Store.find` does, or the jog of that id, and whether it is a jog; alone: as there.

    Raises:
        StationError: there is neither.

    """
    below = jogs(data)
    found = below.by_id(name) if name.strip() else None
    run = Store(data).find(name, alone=alone) if found is None else found
    return run, data_folder(run).name == FOLDER and run.has(PROGRAM) and program_of(run).jog is not None


def why_no_jog(data: Path, job: Job) -> str:
    """Return why no jog may begin now, with what to do; '' where one may.

    There are people at the shaft, so the drive has to have shown that it ends its torque when the program dies: what
    keeps a run from starting by itself keeps a jog from beginning.

    Raises:
        StationError: a record or the protocol of the bench cannot be read.

    """
    if jog_is_on(data):
        return "A jog is in progress. End it first."
    if any(_is_on(run) for run in Store(data).newest(NEWEST_LOOKED_AT)):
        return "A run is in progress. Wait for its end."
    if any(_is_on(one) for one in recoveries(data).newest(NEWEST_LOOKED_AT)):
        return "The recovery after a fault is in progress. Wait for its end."
    if job.no_automatic_run:
        return f"{job.no_automatic_run}."
    if job.bench.bench.embedded:
        return ""  # its virtual bench ended with the run before
    run = last_run_of(data, job)
    # A jog leaves the lock open, however it ends, so nothing is wound up behind it.
    to_do = "Recover the bench first: the unit may be wound up."
    return "" if run is None else why_not_free(data, run, to_do)


def _is_on(record: RunRecord) -> bool:
    try:
        return record.manifest().state == RECORDING and not record.deserted()
    except StationError:
        return False
