"""`lostmotion blank`: a fixture's deflection over torque, from a loop on a rigid dummy, as a block of a bench file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path

from analysis.loop.fixture_curve import FixtureCurve
from analysis.loop.measured import measure
from analysis.loop.windup import blank_curve
from analysis.trace.trace import Trace
from analysis.trace.trace_files import read_trace
from recipes import Bench, Recipe, load_recipe
from station.bench.files import load_named_bench
from station.bench.request import Source, trace_file
from station.cli.bench.blocks import DIGITS, day_of, due_day, flow, print_block, scalar
from station.cli.bench.usable_runs import check_measured, check_recorded, check_same_bench, usable
from station.cli.runs.evaluate_anew import method_without_run
from station.documents.entries import plain
from station.documents.result import Result
from station.errors import StationError
from station.records.data_folder import Store
from station.records.program_file import StoredProgram
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RESULT, RunRecord
from station.records.samples.samples import read_samples
from station.results.evaluation import trace_of
from station.results.export_origin import origin_of


@dataclass(frozen=True)
class BlankPoint:
    """A torque with its unit, and how far the fixture deflects under it."""

    torque: str
    deflection: str


@dataclass(frozen=True)
class BlankCurve:
    """The curve of a bench file: deflection over torque, which angles it holds for, when it was made and is due."""

    id: str
    made: str
    due: str
    angles: str
    points: tuple[BlankPoint, ...]


@dataclass(frozen=True)
class Fixture:
    """The block `fixture` of a bench file; its stiffness is the chord of the curve."""

    stiffness: str
    curve: BlankCurve


@dataclass(frozen=True)
class BlankTest:
    """What is printed: the block under its name."""

    fixture: Fixture


def blank(
    trace: str, recipe: str | None, bench: str | None, data: Path, *, name: str | None, due: str | None, as_json: bool
) -> int:
    """Print the block `fixture` of a bench file, from a loop on a rigid dummy; return 0.

    Args:
        trace: stored run, or a CSV, Parquet or TDMS file.
        recipe: how a file was loaded; a run has its own.
        bench: bench file of the bench that a file or a run comes from; a run has its own.
        data: folder of the runs.
        name: id of the blank test.
        due: day on which it is to be repeated, a year later by default.
        as_json: JSON instead of YAML.

    Raises:
        StationError, RecipeError, AnalysisError: what cannot be read or may not be used, a bench that is another
            one than that of the run, or a trace without a whole loop.

    """
    source, made, method_recipe, method_bench, label = _source(trace, recipe, bench, data)
    method = method_without_run(method_recipe, method_bench)
    bare = replace(method, fixture_stiffness_nm_per_arcmin=None, fixture_curve=None)
    found = measure(source, bare)
    curve = blank_curve(found.loops, found.angles, name or label)
    fixture = _fixture(curve, made, due_day(due, made))
    print_block(BlankTest(fixture), _fixture_yaml(fixture), as_json=as_json)
    return 0


def _source(
    trace: str, recipe: str | None, bench: str | None, data: Path
) -> tuple[Trace, date, Recipe, Bench | None, str]:
    """Return trace, day, recipe and bench of a file or a stored run, and a name for the blank test."""
    path = trace_file(trace)
    if path is not None:
        if recipe is None:
            raise StationError(
                f"file {trace}: --recipe is missing. Name the recipe with which the blank test (the loop on a rigid "
                "dummy) was measured"
            )
        own = None if bench is None else load_named_bench(bench)
        made = datetime.fromtimestamp(path.stat().st_mtime, UTC).date()
        return _of_file(path, own), made, load_recipe(recipe), own, f"blank-{made.isoformat()}"
    run = Store(data).find(trace)
    return _of_run(run, recipe, bench)


def _of_file(path: Path, bench: Bench | None) -> Trace:
    """Return the trace of a file; of an export, only where its run may be used and the trace is still its own."""
    trace = read_trace(path)
    origin = origin_of(path, trace)
    if origin is None:
        return trace
    origin.check_complete()
    check_measured(str(path), origin.run)
    if bench is not None:
        check_same_bench(str(path), origin.run, bench)
    objections = [*origin.objections, *(["the trace in the file is not the run's"] if origin.changed else [])]
    if objections:
        raise StationError(f"{path} was not used: {objections[0]}. Export the run again")
    check_recorded(str(path), origin.run.verdict, origin.run.reasons)
    return trace


def _of_run(run: RunRecord, recipe: str | None, bench: str | None) -> tuple[Trace, date, Recipe, Bench | None, str]:
    if run.state() != "complete":
        raise StationError(f"{run.id}: the run is {run.state()}; expected a complete run. Name another run")
    manifest = usable(run)
    check_recorded(f"run {run.id}", manifest.verdict, run.read(Result, RESULT).reasons)
    own = Source.read(run.folder / RECIPE_COPY).recipe() if recipe is None else load_recipe(recipe)
    where = Source.read(run.folder / BENCH_COPY).bench() if bench is None else load_named_bench(bench)
    check_same_bench(f"run {run.id}", manifest, where)
    segments = StoredProgram.of(run).segments
    trace = trace_of(read_samples(run), segments, where, manifest.period_ns, run.id)
    made = day_of(manifest.started)
    return trace, made, own, where, f"blank-{made.isoformat()}"


def _fixture(curve: FixtureCurve, made: date, due: date) -> Fixture:
    ends = (curve.torque_nm[0], curve.torque_nm[-1])
    turned = curve.deflection_arcmin[-1] - curve.deflection_arcmin[0]
    if not turned > 0:
        raise StationError(
            "the recorded angle does not change under load, so no fixture deflection can be calculated. Check the "
            "angle sensor, then measure again"
        )
    points = tuple(
        BlankPoint(f"{torque:.{DIGITS}g} N·m", f"{angle:.{DIGITS}g} arcmin")
        for torque, angle in zip(curve.torque_nm, curve.deflection_arcmin, strict=True)
    )
    return Fixture(
        stiffness=f"{(ends[1] - ends[0]) / turned:.{DIGITS}g} N·m/arcmin",
        curve=BlankCurve(curve.id, made.isoformat(), due.isoformat(), curve.angles, points),
    )


def _fixture_yaml(fixture: Fixture) -> str:
    curve = fixture.curve
    lines = ["fixture:", f"  stiffness: {fixture.stiffness}      # chord of the curve", "  curve:"]
    lines += [f"    {key}: {scalar(getattr(curve, key))}" for key in ("id", "made", "due", "angles")]
    lines += ["    points:"] + [f"      - {flow(plain(point))}" for point in curve.points]
    return "\n".join(lines) + "\n"
