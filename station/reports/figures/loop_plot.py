"""The picture of a run: the hysteresis loop, its branches, mean curve and limits; made without a display."""

from __future__ import annotations

import io
import textwrap
import unicodedata
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.evaluation.pipeline import Result
from analysis.loop.branches import Branch
from analysis.loop.method import Method
from station.records.samples.history import History

INK, GRID, RAW = "#1f2933", "#d9dee4", "#c3ccd5"
LOADING, UNLOADING, MEAN, LIMIT = "#0b6e99", "#c2571a", "#1f2933", "#b00020"
SIZE_INCH = (8.4, 5.6)
MOST_POINTS = 6000
MOST_LETTERS = 84
"""Letters of a title that have room side by side; of those that are twice as wide, as Chinese ones, half as many."""

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
}


def loop_figure(history: History | None, analysis: Result | None, method: Method, title: str) -> Figure:
    """Return the figure; without an analysis it shows all samples alone, without a history the branches alone."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE_INCH, dpi=150, layout="constrained")
        axes = figure.subplots()
        _raw(axes, history, under=analysis is not None)
        if analysis is not None:
            _branches(axes, analysis)
            _references(axes, analysis, method)
            _zoom(axes, analysis, method)
        axes.set_xlabel("torque at the output  [N·m]")
        axes.set_ylabel("wind-up at the output  [arcmin]")
        axes.set_title(in_lines(title), loc="left", fontsize=11, fontweight="bold", parse_math=False)
        axes.grid(color=GRID, linewidth=0.6)
        axes.axhline(0, color=INK, linewidth=0.7)
        axes.axvline(0, color=INK, linewidth=0.7)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="lower right", frameon=True, framealpha=0.9, edgecolor=GRID, fontsize=8.5)
    return figure


def in_lines(title: str) -> str:
    """Return a title with its lines broken where they would be wider than the picture, which would shrink beside them.

    Whoever draws it draws it with `parse_math=False`: a unit may be named with two dollar signs.
    """
    wide = any(unicodedata.east_asian_width(sign) in "WF" for sign in title)
    letters = MOST_LETTERS // 2 if wide else MOST_LETTERS
    lines = title.split("\n")
    return "\n".join(line if len(line) <= letters else textwrap.fill(line, letters) for line in lines)


def png(figure: Figure) -> bytes:
    """Return a figure as PNG bytes, without a date in them."""
    stream = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(stream, format="png", metadata={"Software": "lostmotion"})
    return stream.getvalue()


def _raw(axes: Axes, history: History | None, *, under: bool) -> None:
    """Draw every sample up to the last scan, wide and pale so that it shows under the branches; mark the alarm."""
    if history is None:
        return
    shown = history.thinned(MOST_POINTS)
    torque, windup = history.torque_nm[shown], history.windup_arcmin[shown]
    colour, width = (RAW, 3.6) if under else (INK, 1.2)
    axes.plot(torque, windup, color=colour, linewidth=width, solid_capstyle="round", label="all samples", zorder=1)
    index = history.alarm_index
    if index is None:
        return
    at = history.torque_nm[index], history.windup_arcmin[index]
    axes.plot(*at, color=LIMIT, marker="X", markersize=9, linestyle="", label="alarm", zorder=5)
    axes.plot(torque[-1:], windup[-1:], color=INK, marker="s", markersize=5, linestyle="", label="last scan", zorder=5)


def _branches(axes: Axes, analysis: Result) -> None:
    curves = analysis.curves
    for branches, colour, name in (
        (curves.forward, LOADING, "torque rising"),
        (curves.backward, UNLOADING, "torque falling"),
    ):
        for number, branch in enumerate(branches):
            label = name if number == 0 else None
            axes.plot(branch.torque_nm, branch.angle_arcmin, color=colour, linewidth=1.3, alpha=0.85, label=label)
    axes.plot(curves.mean.torque_nm, curves.mean.angle_arcmin, color=MEAN, linewidth=1.1, linestyle="--", label="mean")


def _references(axes: Axes, analysis: Result, method: Method) -> None:
    """Mark rated torque and the ±3 % band, where backlash and lost motion are read."""
    reference = method.reference_nm
    axes.axvspan(-0.03 * reference, 0.03 * reference, color=GRID, alpha=0.6, zorder=0)
    for side, branch in ((1, analysis.curves.backward[0]), (-1, analysis.curves.forward[0])):
        if branch.covers(side * reference, side * reference):
            reached = float(branch.at(np.array([side * reference]))[0])
            axes.vlines(side * reference, 0, reached, color=INK, linewidth=0.8, linestyle=":")
            text = f"{side * reference:+g} N·m".replace("-", "−")
            axes.annotate(
                text,
                (side * reference, 0),
                xytext=(0, -5 * side),
                textcoords="offset points",
                fontsize=8,
                va="top" if side > 0 else "bottom",
                ha="center",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
            )


def _zoom(axes: Axes, analysis: Result, method: Method) -> None:
    """Draw what decides on backlash, the few percent around zero, in a window of its own."""
    band = 0.09 * method.reference_nm
    curves = analysis.curves
    inside = axes.inset_axes((0.06, 0.64, 0.36, 0.32))
    torque = np.linspace(-band, band, 121)
    first = curves.forward[0], curves.backward[0]
    if not all(branch.covers(-band, band) for branch in first):
        inside.remove()
        return
    rising, falling = (branch.at(torque) for branch in first)
    inside.plot(torque, rising, color=LOADING, linewidth=1.4)
    inside.plot(torque, falling, color=UNLOADING, linewidth=1.4)
    inside.plot(torque, (rising + falling) / 2, color=MEAN, linewidth=1.0, linestyle="--")
    at = 0.03 * method.reference_nm
    low, high = (float(branch.at(np.array([at]))[0]) for branch in first)
    arrow = {"arrowstyle": "<->", "color": INK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
    inside.annotate("", (at, high), (at, low), arrowprops=arrow)
    text = width_text(curves.forward, curves.backward, at)
    # Above the upper branch: beside the arrow the mean curve passes.
    place: Any = {"xytext": (-4, 5), "textcoords": "offset points", "ha": "right", "va": "bottom"}
    inside.annotate(text, (at, max(low, high)), fontsize=8.5, fontweight="bold", **place)
    _limits(inside, analysis, at, *first)
    inside.axvspan(-band / 3, band / 3, color=GRID, alpha=0.6, zorder=0)
    inside.axhline(0, color=INK, linewidth=0.6)
    inside.axvline(0, color=INK, linewidth=0.6)
    inside.tick_params(labelsize=7.5)
    several = ", cycle 1" if len(curves.forward) > 1 else ""
    inside.set_title(f"around zero{several}; ±3 % shaded", fontsize=8, loc="left")


def width_text(rising: Sequence[Branch], falling: Sequence[Branch], torque_nm: float) -> str:
    """Return the width of the loop at a torque: of several cycles their mean, as the table of the metrics has it."""
    at = np.array([torque_nm])
    pairs = [
        pair for pair in zip(rising, falling, strict=True) if all(one.covers(torque_nm, torque_nm) for one in pair)
    ]
    widths = [float(down.at(at)[0] - up.at(at)[0]) for up, down in pairs]
    return f"{abs(np.mean(widths)):.3f}′" + (f", mean of {len(widths)} cycles" if len(widths) > 1 else "")


def _limits(inside: Axes, analysis: Result, at_nm: float, rising: Branch, falling: Branch) -> None:
    """Show how wide the loop may be where its width is judged, centred on the mean curve."""
    metric = _metric(analysis, "backlash_width_3pct")
    if metric is None or metric.wanted.max is None:
        return
    for side in (-at_nm, at_nm):
        middle = float(rising.at(np.array([side]))[0] + falling.at(np.array([side]))[0]) / 2
        half = metric.wanted.max / 2
        inside.errorbar(
            side, middle, yerr=half, color=LIMIT, capsize=7, linewidth=0, elinewidth=0, markersize=0, capthick=1.6
        )
    inside.plot([], [], color=LIMIT, linewidth=1.6, label=f"limit {metric.wanted.max:g}′")
    inside.legend(loc="lower right", frameon=False, fontsize=7.5)


def _metric(analysis: Result, name: str) -> Any:
    return next((metric for metric in analysis.metrics if metric.wanted.id == name), None)
