"""`lostmotion blank` and `lostmotion calibration`: what a run measured of the bench itself, as blocks for its file."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

from analysis import FixtureCurve, Trace, blank_curve, measure, read_trace
from recipes import Bench, Recipe, find_bench, load_bench, load_recipe
from station.bench.request import recipe_path, trace_file
from station.commands.analyze import method_without_run
from station.errors import StationError
from station.record.check import read_table
from station.record.run_record import RunRecord
from station.record.store import Store
from station.results.evaluation import trace_of

YEAR = timedelta(days=365)
DIGITS = 6
CALIBRATION = "calibration.json"


def blank(
    trace: str, recipe: str | None, bench: str | None, data: Path, *, name: str | None, due: str | None, as_json: bool
) -> int:
    """Print the block `fixture` of a bench file, from a loop on a rigid dummy; return 0.

    Args:
        trace: stored run, or a CSV, Parquet or TDMS file.
        recipe: how a file was loaded; a run has its own.
        bench: bench that a file comes from.
        data: folder of the runs.
        name: id of the blank test.
        due: day on which it is to be repeated, a year later by default.
        as_json: JSON instead of YAML.

    Raises:
        StationError, RecipeError, AnalysisError: what cannot be read, or a trace without a whole loop.

    """
    source, made, method_recipe, method_bench, label = _source(trace, recipe, bench, data)
    method = method_without_run(method_recipe, method_bench)
    bare = replace(method, fixture_stiffness_nm_per_arcmin=None, fixture_curve=None)
    found = measure(source, bare)
    curve = blank_curve(found.loops, found.angles, name or label)
    _print({"fixture": _fixture_block(curve, made, _due(due, made))}, _fixture_yaml, as_json=as_json)
    return 0


def calibration(run: str, data: Path, *, due: str | None, as_json: bool) -> int:
    """Print the torque ratio that a run measured as an entry of `calibrations` in a bench file; return 0.

    Raises:
        StationError: the run has measured none.

    """
    record = Store(data).find(run)
    if not (record.folder / CALIBRATION).is_file():
        raise StationError(
            f"{record.id}: the run measured no torque ratio; needed is a complete run of a recipe with a step calibrate"
        )
    stored = record.read_json(CALIBRATION)
    made = _day(str(stored["made"]))
    block: dict[str, Any] = {
        "id": stored["id"],
        "model": stored["model"],
        "made": made.isoformat(),
        "due": _due(due, made).isoformat(),
    }
    if stored.get("transition_rad") is not None:
        block["transition"] = f"{stored['transition_rad']:.{DIGITS}g} rad"
    for quadrant, line in stored["quadrants"].items():
        block[quadrant] = {
            "slope": _rounded(line["slope"]),
            "offset": f"{line['offset_nm']:.{DIGITS}g} N·m",
            "u_slope": _rounded(line["u_slope"]),
            "u_offset": f"{line['u_offset_nm']:.{DIGITS}g} N·m",
            "correlation": _rounded(line["correlation"]),
            "residual_sd": f"{line['residual_sd_nm']:.{DIGITS}g} N·m",
        }
    _print({"calibrations": [block]}, _calibration_yaml, as_json=as_json)
    return 0


def _source(
    trace: str, recipe: str | None, bench: str | None, data: Path
) -> tuple[Trace, date, Recipe, Bench | None, str]:
    """Return trace, day, recipe and bench of a file or a stored run, and a name for the blank test."""
    path = trace_file(trace)
    if path is not None:
        if recipe is None:
            raise StationError(f"{trace}: --recipe is missing: it says how the dummy was loaded, and the ratio")
        own = None if bench is None else load_bench(find_bench(bench))
        made = datetime.fromtimestamp(path.stat().st_mtime, UTC).date()
        return read_trace(path), made, load_recipe(recipe_path(recipe)), own, f"blank-{made.isoformat()}"
    run = Store(data).find(trace)
    return _of_run(run, recipe, bench)


def _of_run(run: RunRecord, recipe: str | None, bench: str | None) -> tuple[Trace, date, Recipe, Bench | None, str]:
    if run.state() != "complete":
        raise StationError(f"{run.id}: the run is {run.state()}; needed is a complete one")
    manifest = run.manifest()
    own = load_recipe(run.folder / "recipe.yaml" if recipe is None else recipe_path(recipe))
    where = load_bench(run.folder / "bench.yaml" if bench is None else find_bench(bench))
    segments = run.read_json("program.json")["segments"]
    trace = trace_of(read_table(run.samples), segments, where, manifest["period_ns"], run.id)
    made = _day(str(manifest["started"]))
    return trace, made, own, where, f"blank-{made.isoformat()}"


def _fixture_block(curve: FixtureCurve, made: date, due: date) -> dict[str, Any]:
    ends = (curve.torque_nm[0], curve.torque_nm[-1])
    turned = curve.deflection_arcmin[-1] - curve.deflection_arcmin[0]
    if not turned > 0:
        raise StationError("the fixture does not deflect at all: check the angle that the trace holds")
    return {
        "stiffness": f"{(ends[1] - ends[0]) / turned:.{DIGITS}g} N·m/arcmin",
        "curve": {
            "id": curve.id,
            "made": made.isoformat(),
            "due": due.isoformat(),
            "angles": curve.angles,
            "points": [
                {"torque": f"{torque:.{DIGITS}g} N·m", "deflection": f"{angle:.{DIGITS}g} arcmin"}
                for torque, angle in zip(curve.torque_nm, curve.deflection_arcmin, strict=True)
            ],
        },
    }


def _fixture_yaml(block: dict[str, Any]) -> str:
    fixture, curve = block["fixture"], block["fixture"]["curve"]
    lines = ["fixture:", f"  stiffness: {fixture['stiffness']}      # chord of the curve", "  curve:"]
    lines += [f"    {key}: {curve[key]}" for key in ("id", "made", "due", "angles")]
    lines += ["    points:"] + [f"      - {_flow(point)}" for point in curve["points"]]
    return "\n".join(lines) + "\n"


def _calibration_yaml(block: dict[str, Any]) -> str:
    (entry,) = block["calibrations"]
    lines = [f"    {key}: {_flow(value) if isinstance(value, dict) else value}" for key, value in entry.items()]
    return "\n".join(["calibrations:", f"  - {lines[0].strip()}", *lines[1:]]) + "\n"


def _flow(values: dict[str, Any]) -> str:
    return "{" + ", ".join(f"{key}: {value}" for key, value in values.items()) + "}"


def _print(block: dict[str, Any], to_yaml: Any, *, as_json: bool) -> None:
    sys.stdout.write(json.dumps(block, ensure_ascii=False) + "\n" if as_json else to_yaml(block))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _day(text: str) -> date:
    return datetime.fromisoformat(text).date()


def _due(text: str | None, made: date) -> date:
    """Return the day given, or a year after it was made."""
    if text is None:
        return made + YEAR
    try:
        due = date.fromisoformat(text)
    except ValueError:
        raise StationError(f"--due: found '{text}'; needed is a date such as 2027-03-31") from None
    if due <= made:
        raise StationError(f"--due: found {due}; needed is a day after {made}, when it was made")
    return due
