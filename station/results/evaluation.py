"""From a run's record to metrics and verdict: the trace, the method, and what speaks against deciding at all."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.fixture_curve import FixtureCurve
from analysis.loop.method import Decision, Method, MetricWanted
from analysis.torque_ratio.quadrants import Quadrants, TorqueLine
from analysis.trace.trace import ROLES, SegmentInfo, Trace
from analysis.uncertainty.figures import SensorFigures
from analysis.validity.evidence import RunFacts
from definitions.program import Segment
from definitions.states import LOADED
from definitions.units import ARCMIN_PER_RAD
from recipes import OWN, Bench, Calibration, Recipe, Selection, SpeedCycles, StepCycles, TorqueCycles, selected
from station.bench.figures import figures_of, fixture_of
from station.bench.measuring import CHANNEL_OF_SENSOR, channels
from station.documents.manifest import Manifest
from station.documents.ratio import BenchHead, RatioLine, RatioRecord
from station.errors import StationError
from station.records.program_file import SegmentRow
from station.records.samples.table import Table
from station.records.samples.zeroes import ZEROES, from_zero

ALIGNMENTS: Mapping[str, Literal["correct", "two_speeds", "report"]] = {
    "declared": "correct",
    "two_speeds": "two_speeds",
    "report": "report",
}
"""How a recipe says that channels are put on one clock, and how the method does."""

Channels = dict[str, Any]
"""Channels of a trace by name, each an array: keyword arguments of its class, whose other fields are no arrays."""

AS_RECORDED = {
    "temperature_c": "housing_temp_c",
    "drive_torque_nm": "drive_torque_nm",
    "drive_angle_rad": "drive_angle_rad",
}
"""Channel of a trace, and the field of the image that it is."""

LOADED_AHEAD = ("scipy.ndimage", "scipy.optimize", "numpy.polynomial", "pyarrow.parquet")
"""What an evaluation loads when it first needs it: most of a second on a slow computer."""


def load_ahead() -> None:
    """Load it now, so that it is no part of the time between the end of the motion and the verdict."""
    for name in LOADED_AHEAD:
        import_module(name)
    import_module("pyarrow").array([0.0])  # its first array looks for pandas, and loads it where it is installed


def method_of(recipe: Recipe, bench: Bench) -> Method:
    """Return how a run of this recipe on this bench is evaluated."""
    measurement = recipe.measurement
    stored = measurement.output_torque == "calibrated" and measurement.calibration == "stored"
    fixture, lock = fixture_of(bench, recipe.unit_under_test.ratio)
    return replace(
        method_of_recipe(recipe),
        quadrants=_stored_quadrants(newest_calibration(recipe, bench)) if stored else None,
        fixture_stiffness_nm_per_arcmin=fixture,
        locked_stiffness_nm_per_arcmin=lock,
        fixture_curve=_fixture_curve(bench),
        lags_s=lags_of(bench, recipe.sampling.period_s),
        planned_nm_s=planned_rates(recipe, bench),
    )


def _fixture_curve(bench: Bench) -> FixtureCurve | None:
    stored = bench.fixture.curve
    if stored is None:
        return None
    torque = tuple(point.torque_nm for point in stored.points)
    return FixtureCurve(torque, tuple(point.deflection_arcmin for point in stored.points), stored.angles, stored.id)


def method_of_recipe(recipe: Recipe) -> Method:
    """Return what a recipe alone says of the method; nothing of the bench."""
    unit, measurement = recipe.unit_under_test, recipe.measurement
    return Method(
        ratio=unit.ratio,
        rated_torque_nm=unit.rated_torque_nm,
        reference_torque_nm=measurement.reference_torque_nm,
        loading=recipe.loading,
        output_torque=measurement.output_torque,
        alignment=ALIGNMENTS[measurement.alignment],
        left_open=measurement.left_open,
        break_torque_nm=measurement.break_torque_nm,
        stiffness_break_t1_nm=measurement.break_torque_t1_nm,
        stiffness_break_t2_nm=measurement.break_torque_t2_nm,
        catalogue_stiffness_nm_per_arcmin=unit.stiffness_nm_per_arcmin,
        catalogue_offset_nm=unit.loading_torque_ratio.offset_nm if recipe.loading == "input" else None,
        check_limits=recipe.validity.limits(),
    )


def planned_rates(recipe: Recipe, bench: Bench | None) -> tuple[float, float] | None:
    """Return the slowest and the fastest torque rate of the measured branches [N·m/s], holds between steps included.

    None where one of them is not known: a cycle by speed needs the gear of the bench's drive.
    """
    rates: list[float] = []
    for step in recipe.sequence:
        if isinstance(step, TorqueCycles):
            rates.append(step.torque_rate_nm_s)
        elif isinstance(step, StepCycles):
            height_nm = step.peak_torque_nm / step.steps
            rates += [step.torque_rate_nm_s, height_nm / (height_nm / step.torque_rate_nm_s + step.dwell_s)]
        elif isinstance(step, SpeedCycles):
            if bench is None:
                return None
            unit = recipe.unit_under_test
            over = unit.ratio if recipe.loading == "input" else 1.0
            at_output_rad_s = step.speed_rad_s / bench.drive.gear_ratio / over
            rates.append(at_output_rad_s * unit.stiffness_nm_per_arcmin * ARCMIN_PER_RAD)
    return (min(rates), max(rates)) if rates else None


def lags_of(bench: Bench, period_s: float) -> dict[str, float]:
    """Return how late each channel of this bench is in a scan of this period [s], beside the delays of the record."""
    there = {name: getattr(bench.sensors, name) for name in CHANNEL_OF_SENSOR}
    return {
        CHANNEL_OF_SENSOR[name]: sensor.lag_s + bench.unasked_delay(name, period_s)
        for name, sensor in there.items()
        if sensor is not None
    }


def newest_calibration(recipe: Recipe, bench: Bench) -> Calibration:
    """Return the newest calibration of the bench for the recipe's model; StationError when there is none."""
    model = recipe.unit_under_test.model
    newest = bench.newest_calibration(model)
    if newest is None:
        raise StationError(
            f"bench {bench.bench.name}: no stored calibration of the torque ratio for {model}. Calibrate on this "
            "bench and enter the result in its file, or write 'calibration: measured' in the recipe",
        )
    return newest


def _stored_quadrants(stored: Calibration) -> Quadrants:
    rows = (stored.load_positive, stored.unload_positive, stored.load_negative, stored.unload_negative)
    lines = [TorqueLine(row.offset_nm, row.slope) for row in rows]
    return Quadrants(lines[0], lines[1], lines[2], lines[3], transition_rad=stored.transition_rad)


def wanted_of(recipe: Recipe, selection: Selection = OWN) -> list[MetricWanted]:
    """Return the metrics that the recipe asks for, or the chosen ones, with the recipe's limits."""
    return [
        MetricWanted(
            id=one.id,
            branch=one.branch,
            side=None if one.side == "both" else one.side,
            torque_nm=one.torque_nm,
            band=one.band,
            variant=one.variant,
            fit=one.fit,
            min=one.min,
            max=one.max,
            max_standard_deviation=one.max_standard_deviation,
        )
        for one in selected(recipe, selection)
    ]


def decision_of(recipe: Recipe) -> Decision:
    """Return the rule by which limits decide."""
    return Decision(recipe.decision.rule, recipe.decision.guard_factor)


def trace_of(
    table: Table, segments: Sequence[SegmentRow | Segment], bench: Bench, period_ns: int, source: str
) -> Trace:
    """Return the measured trace of a record: fresh samples under the recipe's torque, tared, angles from reference.

    Args:
        table: all records of the run.
        segments: the program's segment table.
        bench: which sensors there were.
        period_ns: scan period.
        source: name for messages.

    """
    kept = table[evaluated(table)]
    if not len(kept):
        raise StationError(f"run {source} ended before anything was measured. Measure the unit again")
    measured: Channels = {**measured_channels(kept, bench)}
    return Trace(
        t_s=kept["scan"] * (period_ns * 1e-9),
        **measured,
        delays_s=_delays(kept, measured, period_ns),
        segment=kept["orders"]["segment"].astype(np.int64),
        segments=segment_table(segments),
        source=source,
    )


def evaluated(table: Table) -> npt.NDArray[np.bool_]:
    """Return which records of a run are samples of its trace: new ones, under the recipe's torque."""
    counter = table["image"]["sample_counter"]
    fresh = np.ones(len(table), dtype=np.bool_)
    fresh[1:] = counter[1:] != counter[:-1]
    return fresh & np.isin(table["orders"]["state"], sorted(LOADED))


def measured_channels(table: Table, bench: Bench) -> dict[str, npt.NDArray[np.float64]]:
    """Return the channels of a trace that the bench has, for every record: torques tared, angles from their zero."""
    image, there = table["image"], channels(bench)
    measured = {name: from_zero(table, name) for name in ZEROES if name in there}
    return measured | {name: image[field].copy() for name, field in AS_RECORDED.items() if field in image}


def _delays(table: Table, channels: Collection[str], period_ns: int) -> dict[str, npt.NDArray[np.float64]]:
    """Return how long before its sample each channel was measured [s]; records of before have no such fields."""
    image = table["image"]
    fields = {name: f"{name.rsplit('_', 1)[0]}_delay_scans" for name in CHANNEL_OF_SENSOR.values() if name in channels}
    return {name: image[field] * (period_ns * 1e-9) for name, field in fields.items() if field in image}


def segment_table(segments: Sequence[SegmentRow | Segment]) -> dict[int, SegmentInfo]:
    """Return the analysis' segment table; roles that it does not evaluate become `other`."""
    table = {}
    for row in segments:
        role = row.role if row.role in ROLES else "other"
        table[row.index] = SegmentInfo(role, row.direction if role != "other" else 0, row.cycle)
    return table


def evaluate_trace(  # noqa: PLR0917 - what was measured, by what, on what, and what speaks against it
    trace: Trace,
    recipe: Recipe,
    bench: Bench,
    objections: list[str],
    facts: RunFacts | None = None,
    selection: Selection = OWN,
    *,
    draws: int = 0,
) -> Result:
    """Evaluate and judge; `objections` speak against the record as a whole, `facts` say how it was recorded.

    selection: metrics to report instead of the recipe's. draws: of Monte Carlo beside the uncertainty budget.
    """
    method, wanted = method_of(recipe, bench), wanted_of(recipe, selection)
    figures = figures_for(recipe, bench)
    rule = decision_of(recipe)
    return analyse(trace, method, wanted, rule, objections, facts=facts, figures=figures, draws=draws)


def figures_for(recipe: Recipe, bench: Bench) -> SensorFigures:
    """Return what the bench declares of its sensors, and of the stored calibration when the recipe goes by one."""
    stored = recipe.measurement.output_torque == "calibrated" and recipe.measurement.calibration == "stored"
    return figures_of(bench, newest_calibration(recipe, bench) if stored else None, recipe.sampling.period_s)


def ratio_of(result: Result, run: Manifest, bench: Bench) -> RatioRecord | None:
    """Return the torque ratio that a run measured, as calibration.json; None when it measured none."""
    quadrants = result.quadrants
    if quadrants is None or not quadrants.fits:
        return None
    return RatioRecord(
        id=f"{run.id}-ratio",
        bench=BenchHead(name=bench.bench.name, revision=bench.bench.revision),
        model=run.unit.model,
        made=run.started,
        transition_rad=quadrants.transition_rad,
        quadrants={
            name: RatioLine(
                slope=fit.slope,
                offset_nm=fit.offset_nm,
                u_slope=fit.u_slope,
                u_offset_nm=fit.u_offset_nm,
                correlation=fit.correlation,
                residual_sd_nm=fit.residual_sd_nm,
                r_squared=fit.r_squared,
                points=fit.points,
                flagged=int(fit.flagged.size),
                theil_sen_slope=fit.theil_sen_slope,
                theil_sen_offset_nm=fit.theil_sen_offset_nm,
            )
            for name, fit in quadrants.fits.items()
        },
    )
