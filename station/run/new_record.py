"""The record of a run that is about to start: who, what, on which bench, by which software, and every file as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from station.atomic_file import as_json
from station.bench.request import Job, Source
from station.bench.virtual_unit import NOT_NAMED, VirtualUnit
from station.documents.manifest import BenchSource, RecipeSource, Setup, StudyPlace, Unit
from station.records.data_folder import Store
from station.records.master_parts import master_parts
from station.records.program_file import PROGRAM, plain_program
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RunRecord
from station.version import software
from station.wall_clock import WALL_CLOCK


class Wanted(NamedTuple):
    """What was asked for beside recipe and bench.

    unit: of a virtual bench that this program starts or simulates, else None. clock: one of `CLOCKS`. clock_right: why
    the computer's clock is right, where entries of the chain are later.
    """

    serial: str
    unit: VirtualUnit | None
    scenario: Source | None
    operator: str | None
    clock: str
    retest_reason: str | None = None
    study: StudyPlace | None = None
    clock_right: str = ""


def bench_source(job: Job) -> BenchSource:
    """Return the bench file of a job, as a manifest names it."""
    bench = job.bench.bench
    return BenchSource(
        name=bench.name,
        revision=bench.revision,
        sha256=job.bench_source.sha256,
        file=str(job.bench_source.path),
        embedded=bench.embedded,
        public_key=bench.public_key,
        fixture=job.bench.fixture.name,
    )


def unit_of(job: Job, unit: VirtualUnit | None, master: str | None = None) -> Unit:
    """Return the unit under test of a job, as a manifest names it: a virtual one is never left without a name."""
    unnamed = NOT_NAMED if job.virtual else None
    return Unit(
        model=job.recipe.unit_under_test.model,
        virtual=unnamed if unit is None else unit.name,
        noise_seed=None if unit is None else unit.seed,
        master=master,
    )


def new_record(data: Path, job: Job, wanted: Wanted, *, notes: list[str]) -> RunRecord:
    """Create the record of a run that is about to start, in a folder of its own below `data`.

    Raises:
        RecordError: the folder cannot be written.

    """
    scenario, master = wanted.scenario, job.bench.master_part(wanted.serial)
    recipe = job.recipe
    notes = [*notes, *job.not_proven]
    setup = Setup(
        recipe=RecipeSource(
            name=recipe.recipe.name,
            revision=recipe.recipe.revision,
            sha256=job.recipe_source.sha256,
            file=str(job.recipe_source.path),
        ),
        bench=bench_source(job),
        software=software(),
        unit=unit_of(job, wanted.unit, None if master is None else master.expect),
        scenario=None if scenario is None else str(scenario.path),
        operator=wanted.operator,
        retest_reason=wanted.retest_reason,
        clock=wanted.clock,
        period_ns=recipe.sampling.period_ns,
        study=wanted.study,
        notes=(*notes, *job.drive_notes),
    )
    files = {RECIPE_COPY: job.recipe_source.content, BENCH_COPY: job.bench_source.content}
    files |= {f"profiles/{source.path.name}": source.content for source in job.profile_sources.values()}
    files[PROGRAM] = as_json(plain_program(job.program))
    files |= {} if scenario is None else {"scenario.yaml": scenario.content}
    store = Store(data)
    if master is None:
        checked = master_parts(store, job.bench, WALL_CLOCK.now(), job.product)
        notes = [*setup.notes, *(one.text for one in checked)]
        setup = replace(setup, notes=tuple(notes))
    record = store.create(wanted.serial, setup, files, own=True, clock_right=wanted.clock_right)
    if store.warnings:
        record.update(notes=[*setup.notes, *store.warnings])
    return record
