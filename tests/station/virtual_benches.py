"""Runs on virtual benches whose sensors are others each time, by a recipe that is changed for the tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from analysis.trace.trace import Trace
from benchmarks.virtual_bench_study import run
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import Job, load_job

Runs = tuple[Job, dict[int, Trace]]
"""A job, and what was seen of each of its runs by the seed of its sensors."""


def runs_by(recipe: Path, changes: Mapping[str, str], units: Mapping[int, str], folder: Path) -> Runs:
    """Runs in virtual time by a recipe with these texts changed, of units by the seed of their sensors.

    folder: where the changed recipe is written.
    """
    text = recipe.read_text(encoding="utf-8")
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    changed = folder / "changed.yaml"
    changed.write_text(text, encoding="utf-8")
    job = load_job(str(changed), None)
    found = {}
    for seed, unit in units.items():
        config = virtual_config(job.bench, job.profile_paths, choose_unit(unit, job.recipe, seed))
        found[seed] = run(job, replace(config, sensor_seed=seed)).seen
    return job, found
