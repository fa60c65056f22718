"""A stored run evaluated once more, for pictures and models: trace and result by the run's own recipe and bench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from analysis.evaluation.pipeline import Result
from analysis.trace.trace import Trace
from recipes import OWN, Bench, Recipe, Selection
from station.bench.request import Job, stored_job
from station.documents.exported import Counts
from station.documents.timing import Timing
from station.errors import StationError
from station.records.program_file import StoredProgram
from station.records.run_record import TIMING, RunRecord
from station.records.samples.samples import checked_samples
from station.records.seal import alterations
from station.records.timing_proof import counts_of, facts_of_counts, objections_to_clock
from station.results.evaluation import evaluate_trace, trace_of


@dataclass(frozen=True)
class RunAnalysis:
    """What a record gives when it is evaluated: its job, the measured trace, the result."""

    job: Job
    trace: Trace
    result: Result


def evaluate_run(
    run: RunRecord,
    recipe: Recipe,
    bench: Bench,
    selection: Selection = OWN,
    objections: Sequence[str] = (),
    *,
    draws: int = 0,
) -> tuple[Trace, Result]:
    """Evaluate the samples of a complete run by a recipe and a bench; `selection` reports other metrics.

    objections: what speaks against the measurement besides what the record itself shows.

    Raises:
        RecordError, AnalysisError: what cannot be read or evaluated.

    """
    recorded = recorded_trace(run, bench)
    facts = facts_of_counts(recorded.counts, recorded.period_ns, recipe.sampling)
    against = [*recorded.objections, *objections]
    return recorded.trace, evaluate_trace(recorded.trace, recipe, bench, against, facts, selection, draws=draws)


@dataclass(frozen=True)
class RecordedTrace:
    """A trace with what its record says of it: what was counted, the scan period, and what speaks against it."""

    trace: Trace
    counts: Counts
    period_ns: int
    objections: tuple[str, ...]


def recorded_trace(run: RunRecord, bench: Bench) -> RecordedTrace:
    """Return the trace of a complete run, as a bench reads it, with what an evaluation asks of its record.

    Raises:
        StationError: it cannot be read.

    """
    manifest, timing = run.manifest(), run.read(Timing, TIMING)
    read_back, table = checked_samples(run, manifest.records)
    broken = [f"the record is not sound: {problem}" for problem in read_back.problems]
    broken += objections_to_clock(timing)
    segments = StoredProgram.of(run).segments
    trace = trace_of(table, segments, bench, manifest.period_ns, run.id)
    return RecordedTrace(trace, counts_of(table, timing), timing.period_ns, tuple(broken))


def complete_run(run: RunRecord) -> RunAnalysis:
    """Evaluate a complete, unaltered run by its own recipe and bench.

    Raises:
        StationError: the run did not come to its end, or its record was altered; there is nothing to build on.

    """
    state = run.state()
    if state != "complete":
        raise StationError(
            f"run {run.id} ended as {state}: it has no complete trace to evaluate. Measure the unit again"
        )
    altered = alterations(run)
    if altered:
        raise StationError(
            f"run {run.id} was not evaluated, because its record was altered: {altered[0]}. Restore it from a backup"
        )
    job = stored_job(run)
    trace, result = evaluate_run(run, job.recipe, job.bench)
    return RunAnalysis(job, trace, result)
