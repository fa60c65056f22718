"""One run evaluated by a question: the function that the processes of this computer and those of a cluster call alike.

Nothing is written, and nothing but the run and the question decides the answer.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import date
from functools import cache, lru_cache
from pathlib import Path

from analysis.evaluation.pipeline import Result as Found
from analysis.trace.errors import AnalysisError
from recipes import Bench, Recipe, RecipeError, parse_bench, parse_recipe
from station.archive.fetch import folder_of
from station.archive.full_rows import REPLACE, opened
from station.archive.place import Place
from station.archive.settings import ArchiveSettings
from station.archive.trace_rows import rows_in, trace_in
from station.atomic_file import read_file
from station.documents.archived import TraceFacts
from station.documents.manifest import MANIFEST
from station.documents.result import MetricValue
from station.errors import StationError
from station.quality.recipe_change import RecipeChange, changed_recipe, place_of
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RunRecord
from station.records.seal import alterations, fingerprint
from station.records.timing_proof import facts_of_counts
from station.reevaluation.question import Question
from station.results.evaluation import evaluate_trace
from station.results.judged import judged_by_selection, judged_in
from station.results.run_analysis import recorded_trace
from station.results.trace_origin import check_recipe_fits, measured_unit, objections_to_bench
from station.version import software

SOFTWARE_DIGITS = 12
MOST_RECIPES = 64


@dataclass(frozen=True)
class Job:
    """A run to evaluate: its id, the SHA-256 of its run.json, its own verdict, and where it is read.

    folder: of its record on this computer, '' for none. archive, object, group: row group of its whole record there, or
    of its trace, whose digest is `trace_sha256`; then whole, whole_group are those of its whole record.
    """

    run: str
    serial: str
    sha256: str
    verdict: str
    folder: str = ""
    archive: ArchiveSettings | None = None
    object: str = ""
    group: int = 0
    trace_sha256: str = ""
    whole: str = ""
    whole_group: int = 0


@dataclass(frozen=True)
class SideOutcome:
    """A side of the metric whose definition is on trial; coverage_factor: the k of its U = k·u."""

    side: str
    value: float | None
    uncertainty: float | None
    coverage_factor: float | None = None


@dataclass(frozen=True)
class MetricOutcome:
    """A metric as it was evaluated, on the side that it goes by; limited: whether it has a limit, and decides.

    sides: of the metric that a question changes; none of any other.
    """

    id: str
    branch: str
    side: str
    value: float | None
    uncertainty: float | None
    verdict: str | None
    limited: bool = True
    sides: tuple[SideOutcome, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What became of a job; error: why it could not be evaluated, '' where it was. software: that evaluated it.

    processor_s: processor time that it took.
    """

    run: str
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    metrics: tuple[MetricOutcome, ...] = ()
    error: str = ""
    software: str = ""
    processor_s: float = 0.0


@cache
def software_key() -> str:
    """Return which program this is: its version, and the beginning of the SHA-256 of its files."""
    own = software()
    return f"{own.version} {(own.files_sha256 or '')[:SOFTWARE_DIGITS]}"


def evaluate_one(job: Job, question: Question) -> Outcome:
    """Return what a run says by a question; an error of the run is an outcome, too."""
    begun = time.process_time()
    return replace(_outcome(job, question), processor_s=time.process_time() - begun)


def _outcome(job: Job, question: Question) -> Outcome:
    try:
        found, recipe, own_bytes = _from_trace(job, question) if job.trace_sha256 else _from_record(job, question)
    except (StationError, RecipeError, AnalysisError, OSError) as error:
        return Outcome(job.run, error=str(error) or type(error).__name__, software=software_key())
    judged = judged_by_selection(judged_in(found), recipe, question.selection)
    place = None if question.change is None else place_of(_recipe(own_bytes), question.change.metric)
    metrics = tuple(_metric_outcome(one, tried=number == place) for number, one in enumerate(judged.metrics))
    return Outcome(job.run, judged.verdict, judged.reasons, metrics, software=software_key())


def _metric_outcome(one: MetricValue, *, tried: bool) -> MetricOutcome:
    sides = tuple(
        SideOutcome(name, side.value, side.uncertainty, one.coverage_factor) for name, side in one.sides.items()
    )
    said = (one.id, one.branch, one.side, one.value, one.uncertainty, one.verdict, bool(one.limits))
    return MetricOutcome(*said, sides if tried else ())


def _from_record(job: Job, question: Question) -> tuple[Found, Recipe, bytes]:
    """Evaluate the whole record, from its folder or from the archive; every file and every scan of it is checked."""
    with _record(job) as run:
        own_bytes, bench_bytes = (read_file(run.folder / f"{part}.yaml") for part in ("recipe", "bench"))
        own, bench = _recipe(own_bytes), _bench(bench_bytes)
        recorded = recorded_trace(run, bench)
        day = run.day()
    counts, broken, trace = recorded.counts, recorded.objections, recorded.trace
    recipe, other = _asked(question, own, own_bytes, job.run)
    objections = objections_to_bench(recipe, bench, day) if other else []
    facts = facts_of_counts(counts, recorded.period_ns, recipe.sampling)
    return evaluate_trace(trace, recipe, bench, [*broken, *objections], facts, question.selection), recipe, own_bytes


@contextmanager
def _record(job: Job) -> Iterator[RunRecord]:
    if job.folder:
        run = RunRecord(Path(job.folder))
        altered = alterations(run)
        if altered:
            raise StationError(f"the record of the run was altered: {altered[0]}. Restore it from a backup")
        yield run
        return
    place = _place(job.archive)
    with folder_of(place, job.object, job.group, job.run) as folder:
        run = RunRecord(folder)
        if fingerprint(folder / MANIFEST).sha256 != job.sha256:
            raise StationError(f"archive object {job.object}: the run.json of run {job.run} has changed. {REPLACE}")
        kept = run.manifest().files or {}
        wrong = next((name for name, one in kept.items() if _sha256(folder / name) != one.sha256), None)
        if wrong is not None:
            raise StationError(f"archive object {job.object}: the file {wrong} of run {job.run} has changed. {REPLACE}")
        yield run


def _sha256(path: Path) -> str:
    return fingerprint(path).sha256 if path.is_file() else ""


def _from_trace(job: Job, question: Question) -> tuple[Found, Recipe, bytes]:
    """Evaluate the trace of the archive, whose facts name the run.json that it was made of."""
    place = _place(job.archive)
    with place.opened(job.object) as stream:
        table = rows_in(opened(stream, job.object), job.group, job.object)
    facts, trace = trace_in(table, job.trace_sha256, job.object)
    _check_facts(job, facts)
    if (
        facts.counts.holds is None and job.whole
    ):  # archived by an older version; the record knows whether a ramp was held
        return _from_record(replace(job, object=job.whole, group=job.whole_group, trace_sha256=""), question)
    own_bytes = facts.recipe.encode()
    own, bench = _recipe(own_bytes), _bench(facts.bench.encode())
    recipe, other = _asked(question, own, own_bytes, job.run)
    objections = objections_to_bench(recipe, bench, date.fromisoformat(facts.day)) if other else []
    recorded = facts_of_counts(facts.counts, facts.period_ns, recipe.sampling)
    found = evaluate_trace(trace, recipe, bench, [*facts.objections, *objections], recorded, question.selection)
    return found, recipe, own_bytes


def _check_facts(job: Job, facts: TraceFacts) -> None:
    if (facts.run, facts.sha256) != (job.run, job.sha256):
        raise StationError(
            f"archive object {job.object}: row group {job.group} has the trace of run {facts.run}, expected {job.run}. "
            f"{REPLACE}"
        )


def _asked(question: Question, own: Recipe, own_bytes: bytes, run: str) -> tuple[Recipe, bool]:
    """Return the recipe that a run is evaluated by, and whether anything is other than it was."""
    if question.change is not None:
        return _recipe(_changed(own_bytes, question.change)), True
    if not question.recipe:
        return own, question.selection.made
    recipe = _recipe(question.recipe)
    check_recipe_fits(recipe, Path(question.recipe_file), measured_unit(own), run)
    return recipe, question.selection.made or question.recipe != own_bytes


@lru_cache(MOST_RECIPES)
def _changed(content: bytes, change: RecipeChange) -> bytes:
    return changed_recipe(content, change)


@lru_cache(MOST_RECIPES)
def _recipe(content: bytes) -> Recipe:
    return parse_recipe(content, RECIPE_COPY)


@lru_cache(MOST_RECIPES)
def _bench(content: bytes) -> Bench:
    return parse_bench(content, BENCH_COPY)


_PLACES: dict[str, Place] = {}


def _place(settings: ArchiveSettings | None) -> Place:
    """Return an archive, opened once in a process."""
    if settings is None:
        raise StationError("the run is neither in its folder nor in the archive. Restore it from a backup")
    key = settings.model_dump_json()
    if key not in _PLACES:
        _PLACES[key] = Place(settings)
    return _PLACES[key]
