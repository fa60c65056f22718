"""The proof of timing as a picture: how late scans began and how long they worked."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from station.documents.timing import Timing
from station.reports.figures.loop_plot import GRID, LIMIT, LOADING, STYLE

SIZE_INCH = (8.4, 2.4)


def timing_figure(proof: Timing) -> Figure | None:
    """Return histograms of wake-up latency and work over the period; None where a run has none, as in virtual time."""
    histograms = proof.histograms_us or {}
    period_us = proof.period_ns / 1000.0
    titles = {"lateness": "wake-up latency", "work": "work"}
    named = [(title, histograms[name]) for name, title in titles.items() if histograms.get(name)]
    if not named:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE_INCH, dpi=150, layout="constrained")
        grid = figure.subplots(1, len(named), squeeze=False, sharey=True)[0]
        for axes, (name, rows) in zip(grid, named, strict=True):
            upper = np.array([max(float(edge), 1.0) for edge, _ in rows])
            counts = np.array([int(count) for _, count in rows])
            bins = np.geomspace(0.9, max(2.0 * period_us, 1.1 * float(upper.max())), 41)
            axes.hist(upper * 0.999, bins=bins, weights=counts, color=LOADING)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.axvline(period_us, color=LIMIT, linewidth=1.1)
            axes.set_xlabel(f"{name}  [µs]; red: one period of {period_us:g} µs")
            axes.grid(color=GRID, linewidth=0.6)
        grid[0].set_ylabel("scans")
    return figure
