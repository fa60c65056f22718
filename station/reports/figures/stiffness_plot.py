"""The stiffness curve of a run: local stiffness over torque, with the metrics drawn in where they are defined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.evaluation.pipeline import Result
from analysis.loop.branches import Branch
from analysis.loop.method import Method
from definitions.metrics import METRICS
from definitions.units import STIFFNESS
from station.documents.result import MetricValue, SideValue
from station.reports.figures.loop_plot import GRID, INK, LOADING, MEAN, STYLE
from station.reports.metric_torques import side_span
from station.reports.result_text import limits_text, number

SIZE_INCH = (8.4, 4.2)
POINTS = 241
WINDOW = 0.02
"""Half the torque step of the measured local stiffness, of the reference torque: less is noise of the encoders."""

COLOURS = ("#b00020", "#1b7f3b", "#7b1fa2", "#c2571a", "#00796b", "#5d4037", "#9e9d24", "#37474f")


def stiffness_figure(result: Result, method: Method, metrics: Sequence[MetricValue]) -> Figure | None:
    """Return the figure; None where the loop carries neither a fit nor loading branches to the reference torque."""
    curves, reference = result.curves, method.reference_nm
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE_INCH, dpi=150, layout="constrained")
        axes = figure.subplots()
        heights = [*_loading(axes, curves.forward[0], 1, reference), *_loading(axes, curves.backward[0], -1, reference)]
        if curves.fit is not None:
            torque = np.linspace(-reference, reference, 2 * POINTS)
            fitted = _positive([1.0 / slope for slope in _slopes(curves.fit.at, torque, 1e-4 * reference)])
            axes.plot(torque, fitted, color=MEAN, linewidth=1.2, linestyle="--", label="1 / m′ of the fitted mean")
            heights += fitted[np.isfinite(fitted)].tolist()
        if not heights:
            return None
        heights = [value for value in heights if value < 5 * float(np.median(heights))]
        heights += _metrics(axes, metrics, method)
        axes.set_xlim(-1.05 * reference, 1.05 * reference)
        axes.set_ylim(0.0, 1.12 * max(heights))
        axes.set_xlabel("torque at the output  [N·m]")
        axes.set_ylabel("stiffness  [N·m/arcmin]")
        axes.set_title("Stiffness over torque", loc="left", fontsize=11, fontweight="bold")
        axes.grid(color=GRID, linewidth=0.6)
        axes.axvline(0, color=INK, linewidth=0.7)
        if axes.get_legend_handles_labels()[0]:  # the negative side alone has none
            axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8.5)
    return figure


def _slopes(curve: Any, torque: Any, step: float) -> Any:
    """Compliance [arcmin/(N·m)] by central differences."""
    return (curve(torque + step) - curve(torque - step)) / (2.0 * step)


def _positive(values: Any) -> Any:
    """Return stiffnesses with those that are none (flat, or running backwards) as NaN, which is not drawn."""
    found = np.asarray(values, dtype=np.float64)
    return np.where(np.isfinite(found) & (found > 0), found, np.nan)


def local_stiffness(branch: Branch, side: int, reference: float) -> tuple[Any, Any] | None:
    """Return torque [N·m] and measured local stiffness [N·m/arcmin] of a loading branch, NaN where there is none.

    None where the branch does not cover its side to the reference torque.
    """
    step = WINDOW * reference
    torque = side * np.linspace(step, reference - step, POINTS)
    if not branch.covers(min(side * reference, 0.0), max(side * reference, 0.0)):
        return None
    with np.errstate(all="ignore"):
        return torque, _positive(1.0 / _slopes(branch.at, torque, step))


def _loading(axes: Axes, branch: Branch, side: int, reference: float) -> list[float]:
    """Draw the measured local stiffness of a loading branch; return its heights."""
    found = local_stiffness(branch, side, reference)
    if found is None:
        return []
    torque, stiffness = found
    label = "loading branch, measured" if side > 0 else None
    axes.plot(torque, stiffness, color=LOADING, linewidth=1.2, alpha=0.85, label=label)
    return [float(value) for value in stiffness[np.isfinite(stiffness)]]


def _metrics(axes: Axes, metrics: Sequence[MetricValue], method: Method) -> list[float]:
    """Draw every stiffness metric over the torque where it holds, both sides; return their heights."""
    drawn: list[float] = []
    stiff = [one for one in metrics if one.id in METRICS and METRICS[one.id].kind is STIFFNESS]
    for place, metric in enumerate(stiff):
        colour = COLOURS[place % len(COLOURS)]
        sides: Mapping[str, SideValue | MetricValue] = metric.sides or {metric.side: metric}
        row, span = METRICS[metric.id], side_span(metric, method)
        wide = row.segmented or row.span is not None
        said = []
        for name, found in sides.items():
            if found.value is None or name not in ("+", "-"):
                continue
            side = 1.0 if name == "+" else -1.0
            value = float(found.value)
            if wide and span is not None:
                axes.plot([side * span[0], side * span[1]], [value, value], color=colour, linewidth=2)
            else:
                at = metric.torque_nm or method.reference_nm
                axes.plot([side * at], [value], color=colour, marker="o", markersize=6, linestyle="")
            drawn.append(value)
            said.append(number(value, found.uncertainty or 0.005 * value))
        if said:
            branch = f" {metric.branch}" if metric.id == "stiffness_50_100" else ""
            limit = limits_text(metric.limits)
            label = " ".join([metric.id + branch, *metric.choices])
            text = f"{label}\n{' and '.join(said)}{f'   ({limit})' if limit else ''}"
            marker = {"linewidth": 2} if wide else {"marker": "o", "linestyle": ""}
            axes.plot([], [], color=colour, label=text, **marker)
    return drawn
