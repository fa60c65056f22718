"""The loop that a model is identified from: of a stored run, or of a trace measured elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.method import Method
from analysis.loop.windup import measured_windup
from analysis.models.samples import LoopSamples, loop_samples, samples_of_branches
from analysis.trace.runs import commanded_runs
from analysis.trace.trace import Trace
from analysis.trace.trace_files import read_trace
from analysis.trace.units import FloatArray
from analysis.uncertainty.figures import SensorFigures
from definitions.program import Sweep
from definitions.units import ARCMIN_PER_RAD
from recipes import load_recipe
from station.bench.figures import figures_of
from station.bench.files import load_named_bench
from station.bench.request import trace_file
from station.cli.runs.evaluate_anew import method_without_run
from station.errors import StationError
from station.records.clocks import VIRTUAL, clock_of
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.results.evaluation import decision_of, method_of, wanted_of
from station.results.export_origin import origin_of
from station.results.run_analysis import complete_run


@dataclass(frozen=True)
class Source:
    """A trace and how it is read: `method` None takes output torque and angle as they stand there.

    sweep: how the torque of its sweep goes, and the scan period [s]; None where a run had none, and for files.
    result: the evaluation with its branches, None where there was nothing to evaluate by. figures: what the bench
    declares of its sensors, None where it is not known.
    """

    name: str
    trace: Trace
    serial: str = ""
    virtual: bool = False
    method: Method | None = None
    result: Result | None = None
    figures: SensorFigures | None = None
    sweep: tuple[Sweep, float] | None = None


def trace_source(name: str, recipe: str | None, data: Path, bench: str | None = None) -> Source:
    """Return the trace of a stored run, read by its own recipe, or of a file, read by the recipe given, if any.

    Raises:
        StationError, RecipeError, AnalysisError: what cannot be found or read.

    """
    path = trace_file(name)
    if path is None:
        if recipe is not None or bench is not None:
            raise StationError("--recipe and --bench are for files; a stored run has its own. Leave them out")
        return _of_run(Store(data).find(name))
    source = _of_file(path)
    if recipe is None:
        return source
    stand = None if bench is None else load_named_bench(bench)
    method = method_without_run(load_recipe(recipe), stand)
    return replace(source, method=method, figures=None if stand is None else figures_of(stand))


def loop_source(name: str, recipe: str | None, bench: str | None, data: Path) -> Source:
    """Return a source with its loop evaluated, where there is a recipe to evaluate it by; raises as `trace_source`."""
    source = trace_source(name, recipe, data, bench)
    if recipe is None or source.method is None:
        return source
    asked = load_recipe(recipe)
    return replace(source, result=analyse(source.trace, source.method, wanted_of(asked), decision_of(asked)))


def _of_file(path: Path) -> Source:
    """Return the trace of a file, with whose it is where the file was exported from a run."""
    trace = read_trace(path)
    origin = origin_of(path, trace)
    if origin is None:
        return Source(str(path), trace)
    origin.check_complete()
    if origin.objections:
        raise StationError(f"{path}: {origin.objections[0]}; the file was not evaluated. Export the run again")
    return Source(str(path), trace, "" if origin.changed else origin.run.serial, origin.virtual)


def _of_run(run: RunRecord) -> Source:
    found = complete_run(run)
    manifest = run.manifest()
    virtual = clock_of(manifest.clock) == VIRTUAL or bool(manifest.unit.virtual)
    method = method_of(found.job.recipe, found.job.bench)
    program = found.job.program
    sweep = next(((one.sweep, program.period_s) for one in program.segments if one.sweep is not None), None)
    figures = figures_of(found.job.bench, period_s=found.job.recipe.sampling.period_s)
    return Source(run.id, found.trace, manifest.serial, virtual, method, found.result, figures, sweep)


def loop_of(source: Source) -> LoopSamples:
    """Return the loop: the branches as evaluated, with every correction; without a recipe, torque over angle as given.

    Raises:
        AnalysisError: a column is missing, or there is no loop in the trace.
        StationError: both angles are there and no recipe says what they are.

    """
    if source.result is not None:
        curves = source.result.curves
        return samples_of_branches(curves.forward, curves.backward, angle_noise_arcmin=angle_noise_arcmin(source))
    angle, torque = channels_of(source)
    return loop_samples(angle, torque, commanded_runs(source.trace) or None)


def angle_noise_arcmin(source: Source) -> float:
    """Return the noise of the wind-up [arcmin, rms] that the steps of the encoders stand for; 0 where none is known."""
    if source.figures is None or source.method is None:
        return 0.0
    shafts = (
        ("angle_in_rad", source.figures.angle_in, source.method.ratio),
        ("angle_out_rad", source.figures.angle_out, 1.0),
    )
    steps = [
        one.step_rad * ARCMIN_PER_RAD / ratio
        for channel, one, ratio in shafts
        if one is not None and getattr(source.trace, channel) is not None
    ]
    return math.hypot(*steps) / math.sqrt(12.0)


def channels_of(source: Source) -> tuple[FloatArray, FloatArray]:
    """Return wind-up [arcmin] and output torque [N·m] sample by sample; AnalysisError naming a missing column."""
    torque = source.trace.channel("torque_out_nm", "evaluation without a recipe")
    if source.method is None:
        if source.trace.angle_in_rad is not None and source.trace.angle_out_rad is not None:
            raise StationError(
                f"file {source.name} has the angles of both shafts, but does not say which shaft is locked. Name the "
                "recipe with --recipe",
            )
        what = "evaluation without a recipe"
        return source.trace.channel("angle_out_rad", what) * ARCMIN_PER_RAD, torque
    windup = measured_windup(source.trace, source.method)
    fixture = source.method.fixture_stiffness_nm_per_arcmin if windup.angles == "loaded" else None
    return (windup.arcmin if fixture is None else windup.arcmin - torque / fixture), torque
