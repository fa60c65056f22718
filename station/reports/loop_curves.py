"""What a page draws of a stored run: its loop, its local stiffness, and where on the loop each metric is read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from analysis.loop.branches import Branch
from analysis.loop.method import Method
from recipes import RecipeError
from station.documents.result import Result
from station.errors import RecordError
from station.records.run_record import RunRecord
from station.records.samples.history import history_of
from station.records.samples.samples import read_samples
from station.reports.metric_sides import worst_first
from station.reports.metric_torques import Span, torque_spans
from station.reports.stored_result import refuse_doubtful
from station.results.evaluation import method_of

if TYPE_CHECKING:
    from station.reports.illustrate import Shown

BRANCH_POINTS = 500
"""Points that a branch is drawn by: twice what a screen tells apart across the part of it that is looked at."""

RISING, FALLING = "torque rising", "torque falling"
"""How the names of the branches of a loop begin."""

SAMPLES = 1500
"""Samples of a run without an evaluation that are drawn, besides those around its alarm."""


@dataclass(frozen=True)
class Line:
    """One line: what it is, torque at the output [N·m], and wind-up [arcmin] or stiffness [N·m/arcmin]."""

    name: str
    torque_nm: tuple[float, ...]
    values: tuple[float | None, ...]

    def at(self, torque_nm: float) -> float:
        """Return the value at a torque, between its points on a straight line; of a branch, whose torque rises."""
        known = [(x, y) for x, y in zip(self.torque_nm, self.values, strict=True) if y is not None]
        return float(np.interp(torque_nm, [x for x, _ in known], [y for _, y in known]))


@dataclass(frozen=True)
class MetricPlace:
    """Torques [N·m] that a metric is read between, by the index of its row in `worst_first` of the result."""

    row: int
    spans_nm: tuple[Span, ...]


@dataclass(frozen=True)
class LoopCurves:
    """The curves of a run. `alarm`: torque and wind-up where it was stopped by one, else None.

    loop: rising and falling branch of every cycle, as they were evaluated; of a run that was not, all of its samples.
    """

    reference_nm: float
    loop: tuple[Line, ...]
    stiffness: tuple[Line, ...]
    places: tuple[MetricPlace, ...]
    alarm: tuple[float, float] | None = None


def loop_curves(run: RunRecord) -> LoopCurves:
    """Return what is drawn of a run.

    Raises:
        RecordError: the run is not concluded, its record is not as it was left, or it cannot be read.

    """
    # What draws pictures is loaded here: a page that shows curves which were made elsewhere needs none of it.
    from station.reports.figures.stiffness_plot import local_stiffness  # noqa: PLC0415
    from station.reports.report_of_run import shown_of  # noqa: PLC0415

    refuse_doubtful(run)
    try:
        shown = shown_of(run)
        method = method_of(shown.job.recipe, shown.job.bench)
        places = _places(shown.result, method)
        if shown.analysis is None:
            return _of_samples(run, shown, method, places)
    except (RecipeError, KeyError, TypeError, AttributeError, ValueError) as error:
        what = " ".join(str(error).split())
        raise RecordError(
            f"run {run.id}: its loop of torque and angle cannot be drawn: {what}. Restore the run from a backup"
        ) from error
    curves = shown.analysis.curves
    cycles = zip(curves.forward, curves.backward, strict=True)
    lines = []
    for number, (rising, falling) in enumerate(cycles, start=1):
        cycle = f", cycle {number}" if len(curves.forward) > 1 else ""
        lines += [_line(f"{RISING}{cycle}", rising), _line(f"{FALLING}{cycle}", falling)]
    sides = ((curves.forward[0], 1), (curves.backward[0], -1))
    stiffness = [(side, local_stiffness(branch, side, method.reference_nm)) for branch, side in sides]
    found = tuple(
        Line(f"side {'+' if side > 0 else '−'}", _rounded(points[0], 3), _known(points[1]))
        for side, points in stiffness
        if points is not None
    )
    return LoopCurves(method.reference_nm, tuple(lines), found, places)


def _places(result: Result, method: Method) -> tuple[MetricPlace, ...]:
    found = ((row, torque_spans(metric, method)) for row, metric in enumerate(worst_first(result.metrics)))
    return tuple(MetricPlace(row, spans) for row, spans in found if spans)


def _of_samples(run: RunRecord, shown: Shown, method: Method, places: tuple[MetricPlace, ...]) -> LoopCurves:
    """Return the samples of a run that bears no evaluation; nothing to draw where it ended before its zeroes."""
    angle_out = shown.job.bench.sensors.angle_out is not None
    history = history_of(read_samples(run), shown.job.program, angle_out=angle_out, alarm=shown.result.first_cause)
    if history is None:
        return LoopCurves(method.reference_nm, (), (), places)
    kept, index = history.thinned(SAMPLES), history.alarm_index
    line = Line("all samples", _rounded(history.torque_nm[kept], 3), _known(history.windup_arcmin[kept]))
    alarm = None if index is None else (float(history.torque_nm[index]), float(history.windup_arcmin[index]))
    return LoopCurves(method.reference_nm, (line,), (), places, alarm)


def _line(name: str, branch: Branch) -> Line:
    count = len(branch.torque_nm)
    # Evenly over its points, the ends among them: around zero, where backlash is read, it has as many as elsewhere.
    kept = np.unique(np.linspace(0, count - 1, min(BRANCH_POINTS, count)).round().astype(np.intp))
    return Line(name, _rounded(branch.torque_nm[kept], 3), _known(branch.angle_arcmin[kept]))


def _rounded(values: npt.NDArray[np.float64], digits: int) -> tuple[float, ...]:
    return tuple(np.round(values, digits).tolist())


def _known(values: npt.NDArray[np.float64]) -> tuple[float | None, ...]:
    """Return values as JSON can have them: None for what is no number."""
    return tuple(value if np.isfinite(value) else None for value in np.round(values, 5).tolist())
