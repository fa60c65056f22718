"""What fits leave over: of the mean curve beside its six-segment fit, and of the lines of the torque ratio."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.evaluation.pipeline import Result
from analysis.loop.method import Method
from analysis.torque_ratio.line_fit import FLAG_STUDENTISED
from definitions.units import ARCSEC_PER_ARCMIN
from station.reports.figures.loop_plot import GRID, INK, LIMIT, LOADING, STYLE, UNLOADING

SIZE_INCH = (8.4, 3.2)
QUADRANT_COLOURS = {
    "load_positive": LOADING, "unload_positive": UNLOADING, "load_negative": "#1b7f3b", "unload_negative": "#7b1fa2",
}  # fmt: skip


def residual_figure(result: Result, method: Method) -> Figure | None:
    """Return the figure; None when nothing was fitted."""
    fits = dict(result.quadrants.fits) if result.quadrants is not None else {}
    parts = [result.curves.fit is not None, bool(fits)]
    if not any(parts):
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE_INCH, dpi=150, layout="constrained")
        columns = list(figure.subplots(1, sum(parts), squeeze=False)[0])
        if parts[0]:
            _mean_curve(columns[0], result, method)
        if parts[1]:
            axes = columns[-1]
            for name, fit in fits.items():
                place = np.arange(1, fit.studentised.size + 1)
                label = f"{name.replace('_', ' ')}, s = {fit.residual_sd_nm:.2g} N·m"
                axes.plot(place, fit.studentised, ".", markersize=3, color=QUADRANT_COLOURS.get(name, INK), label=label)
            for side in (-FLAG_STUDENTISED, FLAG_STUDENTISED):
                axes.axhline(side, color=LIMIT, linewidth=0.9, linestyle="--")
            axes.set_title("torque ratio: studentised residuals, flagged beyond ±4", loc="left", fontsize=9)
            axes.set_xlabel("point of the line")
            axes.legend(loc="best", fontsize=7, frameon=True, framealpha=0.85, edgecolor=GRID, markerscale=2)
        for axes in columns:
            axes.grid(color=GRID, linewidth=0.6)
            axes.axhline(0, color=INK, linewidth=0.7)
    return figure


def _mean_curve(axes: Axes, result: Result, method: Method) -> None:
    mean, fit = result.curves.mean, result.curves.fit
    if fit is None:
        return
    inside = np.abs(mean.torque_nm) <= method.reference_nm
    torque = mean.torque_nm[inside]
    left = ARCSEC_PER_ARCMIN * (mean.angle_arcmin[inside] - fit.at(torque))
    axes.plot(torque, left, color=LOADING, linewidth=1.1)
    for border in (-fit.break_nm, fit.break_nm):
        axes.axvline(border, color=LIMIT, linewidth=0.9, linestyle=":")
    axes.set_title("mean curve, measured minus fitted; dotted: seams", loc="left", fontsize=9)
    axes.set_xlabel("torque at the output  [N·m]")
    axes.set_ylabel("arcsec")
