"""What another recipe would have changed in a run, as plain data and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.trace.errors import AnalysisError
from controller.controller import Controller
from controller.held_lock import Left
from recipes import Recipe, check, find_recipe
from station.bench.request import Job, Source
from station.documents.result import Judged, MetricValue, Result
from station.documents.timing import Timing
from station.errors import StationError
from station.records.program_file import StoredProgram
from station.records.run_record import RESULT, TIMING, RunRecord
from station.records.samples.table import Table
from station.reports.result_text import limits_text
from station.results.divergence import Beside, FirstDifference
from station.results.judged import judged_in
from station.results.trace_origin import check_recipe_fits, measured_unit
from station.results.what_if import (
    InterlockChange,
    MetricChange,
    ShadowWatch,
    Stored,
    interlock_changes,
    judge,
    same_load,
    tare_changes,
    verdict_changes,
)
from station.run.conclusion import NOT_DECIDABLE


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherRecipe:
    """The recipe that is asked about."""

    name: str
    revision: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdicts:
    """The verdict as recorded and by the other recipe, and why the other one; None for a run without any."""

    recorded: str | None
    other: str | None
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What another recipe would have changed in a run; `exact`: its controller would have ordered the same."""

    recipe: OtherRecipe
    refused: tuple[str, ...]
    same_load: bool
    divergence: FirstDifference | None
    exact: bool
    interlocks: tuple[InterlockChange, ...]
    tares: tuple[str, ...]
    metrics: tuple[MetricChange, ...]
    verdict: Verdicts
    changed: bool


class Question:
    """Another recipe asked of a run: its interlocks and its controller look on while the run is replayed.

    Args:
        name: the other recipe, a file or the name of a shipped one.
        run: the run.
        job: the run's own recipe and bench.
        left: how the bench was left before the run, for a recovery.

    Raises:
        StationError: the other recipe is for another unit, another loaded shaft, or another period.
        RecipeError: the other recipe cannot be read.

    """

    def __init__(self, name: str, run: RunRecord, job: Job, left: Left | None) -> None:
        path = find_recipe(name)
        source = Source.read(path)
        recipe = source.recipe()
        check_recipe_fits(recipe, path, measured_unit(job.recipe), run.id)
        _check_period(recipe, path, job.recipe, run)
        self._run = run
        self._own = job
        # Limits below the recorded load are what is asked about: what `run` says of them is told, not a refusal.
        self._other = Job(recipe, job.bench, source, job.bench_source)
        self._shadow = ShadowWatch(job.program, self._other.program)
        self.controller = Controller(job.program, self._shadow, left)
        self.beside = Beside(self.controller, Controller(self._other.program, None, left))

    def answer(self, table: Table) -> Answer:
        """Return what the other recipe would have changed.

        Args:
            table: all records of the run, which was replayed identically and is not altered.

        """
        run, own, other = self._run, self._own.program, self._other
        manifest, divergence = run.manifest(), self.beside.divergence
        recorded = run.read(Result, RESULT) if run.has(RESULT) else None
        before = None if recorded is None else recorded.verdict
        verdict: str | None = before
        reasons: Sequence[str] = ()
        metrics: tuple[MetricChange, ...] = ()
        if run.state() == "complete" and recorded is not None:
            judged = self._judged(table, recorded)
            verdict, reasons = judged.verdict, judged.reasons
            metrics = verdict_changes(recorded.metrics, judged.metrics)
        refused = [str(one) for one in check(other.recipe, other.bench, other.recipe_source.path, run.day())]
        against = [f"a run would refuse the recipe: {one}" for one in refused]
        if divergence is not None:
            # What was recorded from there on is no measurement by the other recipe, whatever it looks like.
            when = divergence.at(manifest.period_ns)
            against.insert(0, f"the run would have differed from {when} on: {divergence.cause}")
        if against:
            verdict, reasons = NOT_DECIDABLE, against
        alike = same_load(own, other.program)
        interlocks, tares = interlock_changes(table, self._shadow, divergence), tare_changes(table, own, other.program)
        other_way = divergence is not None or refused or not alike or interlocks or tares
        return Answer(
            recipe=OtherRecipe(name=other.recipe.recipe.name, revision=other.recipe.recipe.revision),
            refused=tuple(refused),
            same_load=alike,
            divergence=None if divergence is None else divergence.document(manifest.period_ns),
            exact=divergence is None,
            interlocks=interlocks,
            tares=tuple(tares),
            metrics=metrics,
            verdict=Verdicts(recorded=before, other=verdict, reasons=tuple(reasons)),
            changed=bool(other_way or metrics or verdict != before),
        )

    def _judged(self, table: Table, recorded: Result) -> Judged:
        """Return the other recipe's result; what spoke against the run besides its recipe speaks against this too."""
        own = self._result(self._own, table, [])
        objections = [reason for reason in recorded.reasons if reason not in own.reasons]
        if own.verdict != recorded.verdict and not objections:
            said = f"the run's own verdict is {recorded.verdict}, re-evaluated it is {own.verdict}"
            objections = [f"{said}: the software is not the one that made it"]
        return self._result(self._other, table, objections)

    def _result(self, job: Job, table: Table, objections: list[str]) -> Judged:
        run = self._run
        # Which ramps are measured, and which only condition the unit, is the recipe's word: no order tells them apart.
        asked = job is self._other and self.beside.divergence is None
        segments = job.program.segments if asked else StoredProgram.of(run).segments
        stored = Stored(segments, run.read(Timing, TIMING), run.id)
        try:
            found = judge(table, job.recipe, job.bench, stored, objections)
        except (AnalysisError, StationError) as error:
            return Judged(verdict=NOT_DECIDABLE, reasons=(str(error),))
        return judged_in(found)


def _check_period(recipe: Recipe, path: Path, own: Recipe, run: RunRecord) -> None:
    """Refuse a recipe of another period: images that were taken every 1 ms are none of a run that takes every 2 ms."""
    period_ns, own_ns = recipe.sampling.period_ns, own.sampling.period_ns
    if period_ns != own_ns:
        raise StationError(
            f"{path}: sampling.period: found {period_ns * 1e-6:g} ms; run {run.id} was scanned every "
            f"{own_ns * 1e-6:g} ms. Choose a recipe with period: {own_ns * 1e-6:g} ms"
        )


def what_if_lines(found: Answer, period_ns: int) -> list[str]:
    """Return what the other recipe would have changed, for a person: what is exact first, then what is not."""
    recipe, divergence, verdict = found.recipe, found.divergence, found.verdict
    lines = [f"with {recipe.name} revision {recipe.revision}:"]
    lines += [f"  a run would refuse it: {one}" for one in found.refused]
    if not found.same_load:
        text = "it commands another load; its effect on the unit is not known"
        same = "its load profile differs, but gives the same orders as far as the run went"
        lines.append(f"  {same if divergence is None else text}")
    if divergence is not None:
        when = f"scan {divergence.scan} ({divergence.t_s:.3f} s, {divergence.state})"
        lines.append(f"  first difference at {when}: {divergence.cause}")
        lines.append("  with the other recipe, the run would have been different from there on")
    lines += [_interlock_line(one, period_ns) for one in found.interlocks if one.exact]
    inexact = [_interlock_line(one, period_ns) for one in found.interlocks if not one.exact]
    told = [*(f"  {text}" for text in found.tares), *(_metric_line(one) for one in found.metrics)]
    if found.exact:
        lines += told
    elif inexact or told:
        lines.append("  estimated values, calculated from the recorded load and not from the load of the other recipe:")
        lines += [f"  {line}" for line in (*inexact, *told)]
    if verdict.recorded != verdict.other:
        why = f": {verdict.reasons[0]}" if verdict.reasons else ""
        lines.append(f"  verdict: {verdict.recorded} as recorded, {verdict.other} with the other recipe{why}")
    if not found.changed:
        lines.append("  with the other recipe, nothing would have changed")
    return lines


def _interlock_line(one: InterlockChange, period_ns: int) -> str:
    when = f"scan {one.first_scan} ({one.first_scan * period_ns * 1e-9:.3f} s, {one.state}, {one.torque_out_nm:g} N·m)"
    text = {
        "new": f"would have been raised at {when}",
        "gone": f"would not have been raised; the run raised it at {when}",
        "moved": f"would have been raised at scan {one.other_scan} instead of {one.recorded_scan}",
    }[one.change]
    return f"  interlock {one.id} ({one.reaction}) {text}"


def _metric_line(change: MetricChange) -> str:
    def side(metric: MetricValue | None) -> str:
        if metric is None:
            return "not asked for"
        bounds = limits_text(metric.limits)
        value = "no value" if metric.value is None else f"{metric.value:.4g} {metric.unit}"
        return f"{value} ({bounds or 'no limit'}): {metric.verdict or 'not judged'}"

    branch = f" {change.branch}" if change.branch else ""
    return f"  {change.id}{branch}: {side(change.recorded)} -> {side(change.other)}"
