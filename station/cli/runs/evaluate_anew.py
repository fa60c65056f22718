"""A trace evaluated anew: one measured elsewhere, or that of a stored run, with what is said beside its verdict."""

from __future__ import annotations

import hashlib
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path

from analysis.evaluation.pipeline import Result as Found
from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method
from analysis.trace.trace_files import read_trace
from recipes import (
    OWN,
    PRESETS,
    Bench,
    Recipe,
    RecipeError,
    Selection,
    check_alone,
    find_bench,
    find_recipe,
    load_recipe,
    warnings,
)
from recipes.text.yaml_source import read_bytes
from station.bench.files import load_named_bench
from station.bench.request import Source
from station.documents.manifest import RecipeHead, Software
from station.documents.result import Evaluation, Judged, Result
from station.documents.timing import Timing
from station.errors import StationError
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RESULT, TIMING, RunRecord
from station.records.seal import alterations
from station.reports.stored_result import stored_result
from station.results.evaluation import decision_of, figures_for, method_of, method_of_recipe, planned_rates, wanted_of
from station.results.export_origin import Origin, origin_of
from station.results.judged import judged_by_selection, judged_in
from station.results.run_analysis import evaluate_run
from station.results.trace_origin import check_recipe_fits, measured_unit, objections_to_bench
from station.results.unit_hint import in_other_unit, torque_unit_hint
from station.run.conclusion import NOT_DECIDABLE
from station.version import version
from station.wall_clock import WALL_CLOCK


def known_preset(name: str) -> None:
    """Refuse a preset that does not exist."""
    if name not in PRESETS:
        near = get_close_matches(name, PRESETS, n=1)
        hint = f" Did you mean '{near[0]}'?" if near else ""
        raise StationError(f"--preset: found '{name}'; allowed: {', '.join(PRESETS)}.{hint} See 'lostmotion metrics'")


def method_without_run(recipe: Recipe, bench: Bench | None) -> Method:
    """Return the method for a trace measured elsewhere: without a bench nothing is known of its fixture."""
    if bench is not None:
        return method_of(recipe, bench)
    return replace(method_of_recipe(recipe), planned_nm_s=planned_rates(recipe, None))


def elsewhere(
    path: Path, recipe_name: str, bench_name: str | None, selection: Selection = OWN, *, draws: int = 0
) -> Evaluation:
    """Evaluate a trace that was measured elsewhere by a recipe, for its metrics or the chosen ones.

    Raises:
        StationError, RecipeError, AnalysisError: also for an exported run that has no complete trace, or measured
            another unit model.

    """
    recipe_file = find_recipe(recipe_name)
    recipe = _deciding_recipe(recipe_file)
    bench = None if bench_name is None else load_named_bench(bench_name)
    method, wanted = method_without_run(recipe, bench), wanted_of(recipe, selection)
    figures = None if bench is None else figures_for(recipe, bench)
    trace = read_trace(path)
    origin = origin_of(path, trace)
    # Most files do not say when they were measured: what is out of date today may have been so then.
    day = WALL_CLOCK.now().date() if origin is None else origin.day
    objections = [] if bench is None else objections_to_bench(recipe, bench, day)
    facts = None
    if origin is not None:
        origin.check_complete()
        origin.check_recipe(recipe, recipe_file)
        objections, facts = [*origin.objections, *objections], origin.facts(recipe.sampling)
    found = analyse(trace, method, wanted, decision_of(recipe), objections, facts=facts, figures=figures, draws=draws)
    judged = _judged_without_bench(judged_by_selection(judged_in(found), recipe, selection), bench)
    if bench is None:
        judged = _with_unknown_lag(judged, found)
    judged = _with_warnings(judged, recipe, recipe_file, bench)
    unit_hint = torque_unit_hint(trace, recipe)
    if origin is None and unit_hint:
        judged = _with_other_unit(judged, unit_hint)
    reading = f"{path}: {trace.reading}" if trace.reading else ""
    result = Evaluation(
        run=None,
        serial=None,
        recipe=_head(recipe, recipe_file),
        state="analyzed",
        verdict=judged.verdict,
        reasons=judged.reasons,
        decision=judged.decision,
        metrics=judged.metrics,
        gates=judged.gates,
        not_excluded=judged.not_excluded,
        notes=(*[text for text in (unit_hint, reading) if text], *judged.notes),
        stages=judged.stages,
        record=str(path),
        preset=selection.preset,
        selection=tuple(selection.parts),
    )
    return result if origin is None else _with_origin(result, origin, bench_name)


def _with_other_unit(judged: Judged, hint: str) -> Judged:
    """Decide nothing by a torque that stands in another unit: its stiffness is off by as much as its peak."""
    shown = next((check.figure for check in judged.gates if check.id == "stiffness_high"), None)
    if not in_other_unit(hint, shown):
        return judged
    metrics = tuple(
        replace(
            one,
            verdict=NOT_DECIDABLE,
            sides={side: replace(value, verdict=NOT_DECIDABLE) for side, value in one.sides.items()},
        )
        if one.verdict
        else one
        for one in judged.metrics
    )
    return replace(judged, verdict=NOT_DECIDABLE, metrics=metrics, reasons=(hint, *judged.reasons))


def _with_origin(result: Evaluation, origin: Origin, bench_name: str | None) -> Evaluation:
    """Return the result of an exported file with the run that it comes from, whose verdict it must repeat.

    It need not where recipe, bench, metrics or the trace itself are others: that is a new evaluation.
    """
    other_bench = bench_name is None or not origin.is_own("bench", _sha256(find_bench(bench_name)))
    other = bool(result.selection) or not origin.is_own("recipe", result.recipe.sha256)
    reevaluated = origin.changed or other_bench or other
    original = origin.run.verdict
    if not reevaluated and not origin.objections and result.verdict != original:
        again = f"Export run {origin.run.id} again, and look at what 'lostmotion analyze' says of the run itself"
        said = _unlike_the_run(result.verdict, original, origin.run.software, again)
        result = replace(result, verdict=NOT_DECIDABLE, reasons=(said, *result.reasons))
    bench = None
    if other_bench and bench_name is not None:
        named = load_named_bench(bench_name).bench
        bench = f"{named.name} rev {named.revision}"
    return replace(
        result,
        serial=None if origin.changed else origin.run.serial,
        bench=origin.run.bench,
        unit=origin.unit,
        scenario=origin.run.scenario,
        operator=origin.run.operator,
        clock=origin.run.clock,
        notes=(origin.text(), *origin.unknown, *result.notes),
        reevaluated=reevaluated,
        reevaluated_bench=bench,
        original_verdict=original,
        origin=origin.document(),
    )


def reevaluate(
    run: RunRecord, recipe_name: str | None, bench_name: str | None, selection: Selection = OWN, *, draws: int = 0
) -> Evaluation:
    """Evaluate a complete run anew, by its own recipe or another one; the record itself is not touched.

    An altered record is not evaluated: what it would be evaluated by may be what was altered.

    Raises:
        StationError: the recipe is for another unit model, or for a unit loaded on the other side.

    """
    altered = alterations(run)
    if altered:
        return evaluation_of(replace(stored_result(run), metrics=()))
    manifest = run.manifest()
    own_recipe, own_bench = run.folder / RECIPE_COPY, run.folder / BENCH_COPY
    recipe_file = own_recipe if recipe_name is None else find_recipe(recipe_name)
    bench_file = own_bench if bench_name is None else find_bench(bench_name)
    recipe = Source.read(recipe_file).recipe() if recipe_name is None else _deciding_recipe(recipe_file)
    bench = Source.read(bench_file).bench() if bench_name is None else load_named_bench(bench_file)
    check_recipe_fits(recipe, recipe_file, measured_unit(Source.read(own_recipe).recipe()), run.id)
    other_bench = read_bytes(bench_file) != read_bytes(own_bench)
    reevaluated = selection.made or other_bench or read_bytes(recipe_file) != read_bytes(own_recipe)
    objections = objections_to_bench(recipe, bench, run.day()) if reevaluated else []
    _, found = evaluate_run(run, recipe, bench, selection, objections, draws=draws)
    judged = _with_warnings(judged_by_selection(judged_in(found), recipe, selection), recipe, recipe_file, bench)
    original = manifest.verdict
    if not reevaluated and judged.verdict != original:
        again = "Measure again, and report the record as a defect of the program"
        said = _unlike_the_run(judged.verdict, original, manifest.software, again)
        judged = replace(judged, verdict=NOT_DECIDABLE, reasons=(said, *found.reasons))
    return Evaluation(
        run=run.id,
        serial=manifest.serial,
        attempt=manifest.attempt,
        recipe=_head(recipe, recipe_file),
        bench=manifest.bench,
        unit=manifest.unit,
        scenario=manifest.scenario,
        operator=manifest.operator,
        retest_reason=manifest.retest_reason,
        before=manifest.before,
        clock=manifest.clock,
        state=manifest.state,
        verdict=judged.verdict,
        reasons=judged.reasons,
        decision=judged.decision,
        metrics=judged.metrics,
        gates=judged.gates,
        not_excluded=judged.not_excluded,
        notes=judged.notes,
        stages=judged.stages,
        timing=run.read(Timing, TIMING),
        alarms=run.read(Result, RESULT).alarms,
        record=str(run.folder),
        preset=selection.preset,
        selection=tuple(selection.parts),
        reevaluated=reevaluated,
        reevaluated_bench=f"{bench.bench.name} rev {bench.bench.revision}" if other_bench else None,
        original_verdict=original,
    )


def evaluation_of(result: Result) -> Evaluation:
    """Return a stored result as that of an evaluation which was not made."""
    return Evaluation(**{one.name: getattr(result, one.name) for one in fields(Result)})


def _deciding_recipe(recipe_file: Path) -> Recipe:
    """Load a recipe that is named for a measurement; RecipeError also for a limit that none can fail or meet."""
    recipe = load_recipe(recipe_file)
    idle = check_alone(recipe, recipe_file)
    if idle:
        raise RecipeError(idle)
    return recipe


def _head(recipe: Recipe, recipe_file: Path) -> RecipeHead:
    return RecipeHead(name=recipe.recipe.name, revision=recipe.recipe.revision, sha256=_sha256(recipe_file))


def _sha256(file: Path) -> str:
    return hashlib.sha256(read_bytes(file)).hexdigest()


def _judged_without_bench(judged: Judged, bench: Bench | None) -> Judged:
    """Return a result; by a guard band nothing passes while nobody knows the errors of the sensors."""
    if bench is not None or judged.verdict != "PASS" or judged.decision.rule != "guard_band":
        return judged
    said = "the guard band uses U; without a bench U is only the scatter between cycles: name the bench (--bench)"
    return replace(judged, verdict=NOT_DECIDABLE, reasons=(said, *judged.reasons))


def _unlike_the_run(verdict: str, original: str | None, made_by: Software, again: str) -> str:
    """Return what is said of an evaluation by the run's own recipe and bench that gives another verdict.

    again: what to do where the version is not what makes the difference.
    """
    was, now = made_by.version, version()
    software = (
        f"both by lostmotion {now}. {again}"
        if was == now
        else f"by lostmotion {was} then, and by {now} now. Evaluate it by {was}, or measure again"
    )
    return f"the run's own verdict is {original}, re-evaluated it is {verdict}: {software}"


def _with_unknown_lag(judged: Judged, found: Found) -> Judged:
    """Return a result that says so when nobody knows how late torque and angle are against each other."""
    said = [check.text for check in found.checks if check.id == "lag" and check.passed is None]
    return replace(judged, notes=(*(f"{text}; name the bench (--bench)" for text in said), *judged.notes))


def _with_warnings(judged: Judged, recipe: Recipe, recipe_file: Path, bench: Bench | None) -> Judged:
    said = [f"recipe {one.as_warning()}" for one in warnings(recipe, bench, recipe_file)]
    return replace(judged, notes=(*said, *judged.notes))
