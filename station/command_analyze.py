"""`lostmotion analyze`: metrics of a stored run, or of a CSV or Parquet trace measured elsewhere."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from analysis import Method, Result, Trace, analyse, read_trace
from recipes import Bench, Recipe, find_bench, load_bench, load_recipe
from station.command_run import exit_code
from station.errors import StationError
from station.evaluation import decision_of, evaluate_trace, method_of, trace_of, wanted_of
from station.record_check import check_file, read_table
from station.record_store import MANIFEST, RunRecord, Store
from station.request import recipe_path
from station.result_view import result_console, show_result
from station.timing_proof import timing_objections


def analyze(trace: str, recipe: str | None, bench: str | None, data: Path, *, as_json: bool) -> int:
    """Analyse a trace and print its result; return the exit code of its verdict.

    Raises:
        StationError, RecipeError, AnalysisError: what cannot be read, or what the method needs and the trace lacks.

    """
    path = Path(trace)
    if path.is_file():
        if recipe is None:
            raise StationError(f"{trace}: --recipe is missing: it says how the trace is evaluated")
        result = _elsewhere(path, recipe, bench)
    elif path.suffix in (".csv", ".parquet"):
        raise StationError(f"{trace}: there is no such file")
    else:
        run = RunRecord(path) if (path / MANIFEST).is_file() else Store(data).find(trace)
        result = _stored(run, recipe, bench)
    if as_json:
        sys.stdout.write(json.dumps(result, ensure_ascii=False) + "\n")
    else:
        show_result(result_console(), result)
    return exit_code(result)


def _head(recipe: Recipe, recipe_file: Path) -> dict[str, Any]:
    sha256 = hashlib.sha256(recipe_file.read_bytes()).hexdigest()
    return {"name": recipe.recipe.name, "revision": recipe.recipe.revision, "sha256": sha256}


def _elsewhere(path: Path, recipe_name: str, bench_name: str | None) -> dict[str, Any]:
    recipe_file = recipe_path(recipe_name)
    recipe = load_recipe(recipe_file)
    bench = None if bench_name is None else load_bench(find_bench(bench_name))
    found = analyse(read_trace(path), _method(recipe, bench), wanted_of(recipe), decision_of(recipe))
    return {
        "run": None,
        "serial": None,
        "recipe": _head(recipe, recipe_file),
        "state": "analyzed",
        **found.to_dict(),
        "timing": None,
        "alarms": [],
        "record": str(path),
    }


def _method(recipe: Recipe, bench: Bench | None) -> Method:
    """Return the method for a trace measured elsewhere: without a bench nothing is known of its fixture."""
    if bench is not None:
        return method_of(recipe, bench)
    unit, measurement = recipe.unit_under_test, recipe.measurement
    return Method(
        ratio=unit.ratio,
        rated_torque_nm=unit.rated_torque_nm,
        reference_torque_nm=measurement.reference_torque_nm,
        loading=recipe.loading,
        output_torque=measurement.output_torque,
    )


def _stored(run: RunRecord, recipe_name: str | None, bench_name: str | None) -> dict[str, Any]:
    """Evaluate a stored run anew, by its own recipe or by another one; the record itself is not touched."""
    manifest = run.manifest()
    state = run.state()
    if state != "complete":
        raise StationError(f"{run.id}: the run is {state}: it has no complete trace. See 'lostmotion show'")
    recipe_file = run.folder / "recipe.yaml" if recipe_name is None else recipe_path(recipe_name)
    recipe = load_recipe(recipe_file)
    bench = load_bench(run.folder / "bench.yaml" if bench_name is None else find_bench(bench_name))
    timing = run.read_json("timing.json")
    read_back = check_file(run.samples, manifest["records"])
    broken = [f"the record is not sound: {problem}" for problem in read_back.problems]
    table = read_table(run.samples)
    sampling = recipe.sampling
    objections = broken + timing_objections(table, timing, sampling.missed_periods_fraction, sampling.sample_age_s)
    segments = run.read_json("program.json")["segments"]
    trace: Trace = trace_of(table, segments, bench, manifest["period_ns"], run.id)
    found: Result = evaluate_trace(trace, recipe, bench, objections)
    return {
        "run": run.id,
        "serial": manifest["serial"],
        "recipe": _head(recipe, recipe_file),
        "state": state,
        **found.to_dict(),
        "timing": timing,
        "alarms": run.read_json("result.json")["alarms"],
        "record": str(run.folder),
    }
