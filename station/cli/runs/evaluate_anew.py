"""A trace evaluated anew: one measured elsewhere, or that of a stored run, with what is said beside its verdict."""

from __future__ import annotations

import hashlib
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from analysis.evaluation.pipeline import Result, analyse
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
    left_out,
    load_bench,
    load_recipe,
    warnings,
)
from station.bench.request import recipe_path
from station.cli.runs.show import stored_result
from station.errors import StationError
from station.records.run_record import RESULT, RunRecord
from station.records.seal import alterations
from station.results.evaluation import decision_of, figures_for, method_fields, method_of, wanted_of
from station.results.export_origin import Origin, origin_of
from station.results.run_analysis import evaluate_run
from station.results.trace_origin import check_recipe_fits, objections_to_bench
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
    return Method(**method_fields(recipe))


def elsewhere(
    path: Path, recipe_name: str, bench_name: str | None, selection: Selection = OWN, *, draws: int = 0
) -> dict[str, Any]:
    """Evaluate a trace that was measured elsewhere by a recipe, for its metrics or the chosen ones.

    Raises:
        StationError, RecipeError, AnalysisError: also for an exported run that has no complete trace, or measured
            another unit model.

    """
    recipe_file = recipe_path(recipe_name)
    recipe = _deciding_recipe(recipe_file)
    bench = None if bench_name is None else load_bench(find_bench(bench_name))
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
    plain = _judged_without_bench(_judged_by_selection(found.to_dict(), recipe, selection), bench)
    if bench is None:
        plain = _with_unknown_lag(plain, found)
    result = {
        "run": None,
        "serial": None,
        "recipe": _head(recipe, recipe_file),
        "state": "analyzed",
        **_selection_fields(selection),
        **_with_warnings(plain, recipe, recipe_file, bench),
        "timing": None,
        "alarms": [],
        "record": str(path),
    }
    return result if origin is None else _with_origin(result, origin, bench_name)


def _with_origin(result: dict[str, Any], origin: Origin, bench_name: str | None) -> dict[str, Any]:
    """Return the result of an exported file with the run that it comes from, whose verdict it must repeat.

    It need not where recipe, bench, metrics or the trace itself are others: that is a new evaluation.
    """
    other_bench = bench_name is None or not origin.is_own("bench", _sha256(find_bench(bench_name)))
    other = bool(result["selection"]) or not origin.is_own("recipe", result["recipe"]["sha256"])
    reevaluated = origin.changed or other_bench or other
    original = origin.run["verdict"]
    judged: dict[str, Any] = {}
    if not reevaluated and not origin.objections and result["verdict"] != original:
        again = f"Export run {origin.run['id']} again, and look at what 'lostmotion analyze' says of the run itself"
        judged = _unlike_the_run(result, original, origin.run, again)
    bench = None
    if other_bench and bench_name is not None:
        named = load_bench(find_bench(bench_name)).bench
        bench = f"{named.name} rev {named.revision}"
    return {
        **result,
        **judged,
        "serial": None if origin.changed else origin.run["serial"],
        **origin.badges(),
        "notes": [origin.text(), *result["notes"]],
        "reevaluated": reevaluated,
        "reevaluated_bench": bench,
        "original_verdict": original,
        "origin": origin.to_dict(),
    }


def reevaluate(
    run: RunRecord, recipe_name: str | None, bench_name: str | None, selection: Selection = OWN, *, draws: int = 0
) -> dict[str, Any]:
    """Evaluate a complete run anew, by its own recipe or another one; the record itself is not touched.

    An altered record is not evaluated: what it would be evaluated by may be what was altered.

    Raises:
        StationError: the recipe is for another unit model, or for a unit loaded on the other side.

    """
    altered = alterations(run)
    if altered:
        return stored_result(run) | {"metrics": [], "original_verdict": None}
    manifest = run.manifest()
    own_recipe, own_bench = run.folder / "recipe.yaml", run.folder / "bench.yaml"
    recipe_file = own_recipe if recipe_name is None else recipe_path(recipe_name)
    bench_file = own_bench if bench_name is None else find_bench(bench_name)
    recipe = load_recipe(recipe_file) if recipe_name is None else _deciding_recipe(recipe_file)
    bench = load_bench(bench_file)
    check_recipe_fits(recipe, recipe_file, load_recipe(own_recipe), run)
    other_bench = bench_file.read_bytes() != own_bench.read_bytes()
    reevaluated = selection.made or other_bench or recipe_file.read_bytes() != own_recipe.read_bytes()
    objections = objections_to_bench(recipe, bench, run.day()) if reevaluated else []
    _, found = evaluate_run(run, recipe, bench, selection, objections, draws=draws)
    plain = _with_warnings(_judged_by_selection(found.to_dict(), recipe, selection), recipe, recipe_file, bench)
    original = manifest["verdict"]
    if not reevaluated and plain["verdict"] != original:
        again = "Measure again, and report the record as a defect of the program"
        plain |= _unlike_the_run(plain | {"reasons": list(found.reasons)}, original, manifest, again)
    return {
        "run": run.id,
        "serial": manifest["serial"],
        "recipe": _head(recipe, recipe_file),
        **{
            key: manifest[key]
            for key in ("attempt", "bench", "unit", "scenario", "operator", "clock")
            if key in manifest
        },
        "state": manifest["state"],
        **_selection_fields(selection),
        **plain,
        "reevaluated": reevaluated,
        "reevaluated_bench": f"{bench.bench.name} rev {bench.bench.revision}" if other_bench else None,
        "original_verdict": original,
        "timing": run.read_json("timing.json"),
        "alarms": run.read_json(RESULT)["alarms"],
        "record": str(run.folder),
    }


def _deciding_recipe(recipe_file: Path) -> Recipe:
    """Load a recipe that is named for a measurement; RecipeError also for one with a limit that no unit can fail."""
    recipe = load_recipe(recipe_file)
    idle = check_alone(recipe, recipe_file)
    if idle:
        raise RecipeError(idle)
    return recipe


def _head(recipe: Recipe, recipe_file: Path) -> dict[str, Any]:
    return {"name": recipe.recipe.name, "revision": recipe.recipe.revision, "sha256": _sha256(recipe_file)}


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _selection_fields(selection: Selection) -> dict[str, Any]:
    return {"preset": selection.preset, "selection": selection.parts}


def _judged_by_selection(plain: dict[str, Any], recipe: Recipe, selection: Selection) -> dict[str, Any]:
    """Return a result; by a choice of metrics that leaves out what the recipe has a limit for, nothing passes."""
    if not selection.made or plain["verdict"] != "PASS":
        return plain
    left = left_out(recipe, selection)
    if not left:
        return plain
    verb = "leaves" if len(selection.parts) == 1 else "leave"
    said = f"{selection.text} {verb} out what the recipe has limits for: {', '.join(left)}"
    return plain | {"verdict": NOT_DECIDABLE, "reasons": [said, *plain["reasons"]]}


def _judged_without_bench(plain: dict[str, Any], bench: Bench | None) -> dict[str, Any]:
    """Return a result; by a guard band nothing passes while nobody knows the errors of the sensors."""
    if bench is not None or plain["verdict"] != "PASS" or plain["decision"]["rule"] != "guard_band":
        return plain
    said = (
        "the guard band is of U, and without a bench U holds the scatter of the cycles alone; name the bench (--bench)"
    )
    return plain | {"verdict": NOT_DECIDABLE, "reasons": [said, *plain["reasons"]]}


def _unlike_the_run(plain: dict[str, Any], original: str, run: dict[str, Any], again: str) -> dict[str, Any]:
    """Return verdict and reasons of an evaluation by the run's own recipe and bench that gives another verdict.

    again: what to do where the version is not what makes the difference.
    """
    was, now = run["software"]["version"], version()
    software = (
        f"both by lostmotion {now}. {again}"
        if was == now
        else f"by lostmotion {was} then, and by {now} now. Evaluate it by {was}, or measure again"
    )
    said = f"the run's own verdict is {original}, evaluated anew it is {plain['verdict']}: {software}"
    return {"verdict": NOT_DECIDABLE, "reasons": [said, *plain["reasons"]]}


def _with_unknown_lag(plain: dict[str, Any], found: Result) -> dict[str, Any]:
    """Return a result that says so when nobody knows how late torque and angle are against each other."""
    said = [check.text for check in found.checks if check.id == "lag" and check.passed is None]
    return plain | {"notes": [*(f"{text}; name the bench (--bench)" for text in said), *plain["notes"]]}


def _with_warnings(plain: dict[str, Any], recipe: Recipe, recipe_file: Path, bench: Bench | None) -> dict[str, Any]:
    said = [f"recipe {one.as_warning()}" for one in warnings(recipe, bench, recipe_file)]
    return plain | {"notes": [*said, *plain["notes"]]}
