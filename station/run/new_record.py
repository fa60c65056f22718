"""The record of a run that is about to start: who, what, on which bench, by which software, and every file as it is."""

from __future__ import annotations

import platform
from pathlib import Path
from typing import NamedTuple

from station.bench.request import Job, Source
from station.record.program_file import PROGRAM, plain_program
from station.record.run_record import RunRecord
from station.record.store import Store
from station.version import version


class Wanted(NamedTuple):
    """What was asked for beside recipe and bench; unit is that of the virtual bench, None on a real one."""

    serial: str
    unit: str | None
    scenario: Source | None
    operator: str | None
    virtual_time: bool


def new_record(data: Path, job: Job, wanted: Wanted, *, notes: list[str]) -> RunRecord:
    """Create the record of a run that is about to start, in a folder of its own below `data`.

    Raises:
        RecordError: the folder cannot be written.

    """
    scenario = wanted.scenario
    recipe, bench = job.recipe, job.bench
    manifest = {
        "recipe": {
            "name": recipe.recipe.name,
            "revision": recipe.recipe.revision,
            "sha256": job.recipe_source.sha256,
            "file": str(job.recipe_source.path),
        },
        "bench": {
            "name": bench.bench.name,
            "revision": bench.bench.revision,
            "sha256": job.bench_source.sha256,
            "file": str(job.bench_source.path),
            "embedded": bench.bench.embedded,
        },
        "software": {
            "name": "lostmotion",
            "version": version(),
            "python": platform.python_version(),
            "platform": platform.platform(),
        },
        "unit": {"model": recipe.unit_under_test.model, "virtual": wanted.unit},
        "scenario": None if scenario is None else str(scenario.path),
        "operator": wanted.operator,
        "clock": "virtual" if wanted.virtual_time else "real",
        "period_ns": recipe.sampling.period_ns,
        "verdict": None,
        "notes": notes,
        "ring": None,
    }
    files = {"recipe.yaml": job.recipe_source.content, "bench.yaml": job.bench_source.content}
    files |= {f"profiles/{name}.yaml": source.content for name, source in job.profile_sources.items()}
    files |= {} if scenario is None else {"scenario.yaml": scenario.content}
    record = Store(data).create(wanted.serial, manifest, files, own=True)
    record.write_json(PROGRAM, plain_program(job.program))
    return record
