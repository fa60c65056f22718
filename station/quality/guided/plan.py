"""The plan of a study from what a person asks, refused where it could not be evaluated when everything is measured."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from secrets import randbelow

from analysis.line.study_order import study_order
from analysis.line.type_one import LEAST, USUAL
from recipes import Recipe
from station.bench.request import Job, load_job
from station.counted import counted
from station.documents.study import CALLED, GAGE, KINDS, TYPE_ONE, StudyCell, StudyMetric, StudyPlan
from station.errors import StationError
from station.records.data_folder import check_operator, check_serial
from station.records.studies import Study, begin_study

LEAST_OF_GAGE = 2
GAGE_TRIALS = 3
MOST_STEPS = 1000
"""Measurements of a study; a type 1 study usually has 50, a gage study 10 × 3 × 3."""

MOST_SEED = 2**32


@dataclass(frozen=True)
class Asked:
    """What is asked of a new study.

    parts: serial numbers, on the virtual bench with the virtual unit behind a '=' (`P-1=P1:3`). references,
    tolerances: one for each metric, in its order, or none. trials, seed: None for the usual number, and a drawn one.
    """

    kind: str
    recipe: str
    bench: str | None
    parts: Sequence[str]
    operators: Sequence[str]
    metrics: Sequence[str]
    references: Sequence[float] = ()
    tolerances: Sequence[float] = ()
    trials: int | None = None
    share: float = 20.0
    seed: int | None = None


def begin(data: Path, name: str, asked: Asked, person: str) -> Study:
    """Begin a study: write its plan into a file of its own.

    Raises:
        StationError, RecipeError: the study could not be measured or evaluated so, or there is one of that name.
        RecordError: the file cannot be written.

    """
    return begin_study(data, name, plan_of(asked), check_operator(person))


def plan_of(asked: Asked) -> StudyPlan:
    """Return the plan of what is asked; StationError, RecipeError as `begin`."""
    if asked.kind not in KINDS:
        raise StationError(f"--kind: found {asked.kind!r:.40}; allowed are {' and '.join(KINDS)}")
    job = load_job(asked.recipe, asked.bench)
    parts, units = _parts(asked.parts, job)
    operators = [check_operator(one) for one in asked.operators]
    _refuse_twice("--part", parts)
    _refuse_twice("--operator", operators)
    _refuse_twice("--metric", asked.metrics)
    trials = asked.trials if asked.trials is not None else USUAL if asked.kind == TYPE_ONE else GAGE_TRIALS
    _check_design(asked.kind, parts, operators, trials)
    seed = randbelow(MOST_SEED) if asked.seed is None else asked.seed
    cells = study_order(parts, operators or [""], trials, seed)
    return StudyPlan(
        kind=asked.kind,
        metrics=_metrics(asked, job),
        recipe=job.recipe.recipe.name,
        revision=job.recipe.recipe.revision,
        recipe_file=str(job.recipe_source.path.resolve()),
        recipe_sha256=job.recipe_source.sha256,
        bench=job.bench.bench.name,
        bench_file=str(job.bench_source.path.resolve()),
        bench_sha256=job.bench_source.sha256,
        virtual=job.virtual,
        parts=tuple(parts),
        units=units,
        operators=tuple(operators),
        trials=trials,
        share=asked.share,
        seed=seed,
        order=tuple(StudyCell(part=one.part, operator=one.operator, trial=one.trial) for one in cells),
    )


def _parts(given: Sequence[str], job: Job) -> tuple[list[str], dict[str, str]]:
    """Return the serial numbers, and on the virtual bench the unit that each one is."""
    if not job.bench.bench.embedded:
        return [check_serial(one) for one in given], {}
    from station.bench.assemble_virtual import choose_unit  # noqa: PLC0415 - brings the virtual bench, which a real one does not need

    parts, units = [], {}
    for one in given:
        serial, _, unit = one.partition("=")
        parts.append(check_serial(serial))
        units[serial] = choose_unit(unit or None, job.recipe, 0).name
    return parts, units


def _refuse_twice(option: str, given: Sequence[str]) -> None:
    twice = next((one for one, count in Counter(given).items() if count > 1), None)
    if twice is not None:
        raise StationError(f"{option}: found {twice!r:.60} twice; allowed once. Remove one of the two")


def _check_design(kind: str, parts: Sequence[str], operators: Sequence[str], trials: int) -> None:
    wanted = [
        ("--part", len(parts), LEAST_OF_GAGE, "units"),
        ("--operator", len(operators), LEAST_OF_GAGE, "operators"),
        ("--trials", trials, LEAST_OF_GAGE, "trials"),
    ]
    if kind == TYPE_ONE:
        wanted = [("--trials", trials, LEAST, "measurements of one part")]
        if len(parts) != 1:
            raise StationError(
                f"--part: found {len(parts)} units; a type 1 study measures exactly one, whose value is known"
            )
        if len(operators) > 1:
            raise StationError(
                f"--operator: found {len(operators)} operators; a type 1 study has at most one. Name one or none"
            )
    for option, found, least, what in wanted:
        if found < least:
            hint = ". Where nobody operates the bench, name who puts the unit on, or the shifts"
            said = f"{option}: found {found}; a {CALLED[kind]} study has {least} {what} or more"
            raise StationError(said + (hint if option == "--operator" else ""))
    steps = len(parts) * max(len(operators), 1) * trials
    if steps > MOST_STEPS:
        raise StationError(f"study: found {steps} measurements; allowed are up to {MOST_STEPS}. Take fewer trials")


def _metrics(asked: Asked, job: Job) -> tuple[StudyMetric, ...]:
    """Return the metrics with reference and tolerance; refused is what would be missing at the end."""
    if not asked.metrics:
        raise StationError("--metric: found none; name the metric that the study measures")
    references = _one_each("--reference", asked.references, asked.metrics, needed=asked.kind == TYPE_ONE)
    if asked.kind == GAGE and asked.references:
        raise StationError("--reference: only a type 1 study has a reference value. Leave this option out")
    tolerances = _one_each("--tolerance", asked.tolerances, asked.metrics, needed=False)
    masters = [one for one in asked.parts if job.bench.master_part(one) is not None]
    if asked.kind == GAGE and masters:
        raise StationError(
            f"--part: {masters[0]} is a master part of bench {job.bench.bench.name}; a gage study needs units from "
            "production, because it compares their spread. Name units from production"
        )
    found = []
    for name, reference, tolerance in zip(asked.metrics, references, tolerances, strict=True):
        _check_metric(name, job.recipe)
        if tolerance is None and asked.kind == TYPE_ONE and not _has_tolerance(name, job.recipe):
            raise StationError(
                f"{job.recipe_source.path}: the metric {name} has one limit or none, so its tolerance is not known. "
                f"Write the tolerance into the recipe, '- {{id: {name.split()[0]}, tolerance: …}}', or give it with "
                "--tolerance"
            )
        if tolerance is not None and not 0.0 < tolerance < math.inf:
            raise StationError(f"--tolerance: found {tolerance:g}; allowed is upper limit minus lower limit, above 0")
        if reference is not None and not math.isfinite(reference):
            raise StationError(f"--reference: found {reference:g}; allowed is the value of the part, a number")
        found.append(StudyMetric(id=name, reference=reference, tolerance=tolerance))
    return tuple(found)


def _one_each(option: str, given: Sequence[float], metrics: Sequence[str], *, needed: bool) -> Sequence[float | None]:
    if len(given) != len(metrics) and (given or needed):
        raise StationError(
            f"{option}: found {counted(len(given), 'value')} for {counted(len(metrics), 'metric')}; give one value for "
            "each --metric, in the same order"
        )
    return given or [None] * len(metrics)


def _check_metric(name: str, recipe: Recipe) -> None:
    there = [one.id for one in recipe.metrics]
    if (name.split() or [""])[0] not in there:
        listed = ", ".join(dict.fromkeys(there))
        raise StationError(f"--metric: found '{name:.60}'; the recipe {recipe.recipe.name} has the metrics {listed}")


def _has_tolerance(name: str, recipe: Recipe) -> bool:
    same = [one for one in recipe.metrics if one.id == name.split(maxsplit=1)[0]]
    return any(one.tolerance is not None or (one.min is not None and one.max is not None) for one in same)
