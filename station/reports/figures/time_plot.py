"""The picture of a run that did not come to its end: torque and locked shaft over time, states, and the alarm."""

from __future__ import annotations

import textwrap
from itertools import pairwise

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from definitions.image import State
from station.records.samples.event_log import state_name
from station.records.samples.history import History
from station.reports.figures.loop_plot import GRID, LIMIT, LOADING, STYLE, UNLOADING, in_lines

SIZE_INCH = (8.4, 4.6)
MOST_POINTS = 4000
LINE_ROOM = 0.09
"""Room for a line of words below or above the torque, share of its range."""

LETTERS = 46
"""Letters of the alarm's text that the width of the whole run holds."""

AROUND_S = 1.0
"""Seconds shown before and behind the alarm in the window beside the whole run."""

UNKNOWN_BAND = "#ffffff"
"""Background of a state that this version does not know."""

BANDS: dict[int, str] = {
    State.IDLE: "#ffffff",
    State.HOME: "#eef2f6",
    State.LOCK: "#e3e9f0",
    State.CALIBRATE: "#e2edf8",
    State.RAMP_POS: "#e4f3e6",
    State.REVERSE: "#f0f7f1",
    State.RAMP_NEG: "#d9eede",
    State.UNLOAD: "#fdf3d8",
    State.RELEASE: "#f8ead0",
    State.JOG: "#e0ecf4",
    State.COMPLETE: "#ffffff",
    State.STOPPED: "#fdf3d8",
    State.FAULT: "#fbe0dd",
}


def time_figure(history: History, title: str) -> Figure:
    """Return torque and locked-shaft angle over time: the whole run, and the moments around its alarm."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE_INCH, dpi=150, layout="constrained")
        columns = 1 if history.alarm_s is None else 2
        rows = 1 if history.locked_arcmin is None else 2
        grid = figure.subplots(rows, columns, sharex="col", squeeze=False, height_ratios=(2, 1)[:rows])
        for column in range(columns):
            _column(list(grid[:, column]), history, zoomed=column == 1)
            _room(grid[0, column], len(_alarm_lines(history)))
        grid[0, 0].set_ylabel("torque at the output  [N·m]")
        if rows == 2:
            grid[1, 0].set_ylabel("locked shaft  [arcmin]")
        grid[0, 0].set_title("whole run", loc="left", fontsize=9)
        if columns == 2:
            grid[0, 1].set_title(f"±{AROUND_S:g} s around the alarm", loc="left", fontsize=9)
        figure.suptitle(in_lines(title), x=0.01, ha="left", fontsize=11, fontweight="bold", parse_math=False)
    return figure


def _column(column: list[Axes], history: History, *, zoomed: bool) -> None:
    start, end = float(history.t_s[0]), float(history.t_s[-1])
    if zoomed and history.alarm_s is not None:
        start, end = max(start, history.alarm_s - AROUND_S), min(end, history.alarm_s + AROUND_S)
    shown = np.flatnonzero((history.t_s >= start) & (history.t_s <= end))
    shown = shown[:: max(1, shown.size // MOST_POINTS)]
    end = max(end, start + 1e-3)
    time_s = history.t_s[shown]
    column[0].plot(time_s, history.torque_nm[shown], color=LOADING, linewidth=1.2)
    if history.locked_arcmin is not None:
        column[1].plot(time_s, history.locked_arcmin[shown], color=UNLOADING, linewidth=1.2)
    for axes in column:
        axes.set_xlim(start, end)
        axes.grid(color=GRID, linewidth=0.6)
        _bands(axes, history, named=axes is column[0])
        if history.alarm_s is not None:
            axes.axvline(history.alarm_s, color=LIMIT, linewidth=1.2)
    column[-1].set_xlabel("time  [s]")
    if history.alarm_s is not None and not zoomed:
        left = _alarm_share(history) > 0.5
        said = column[0].annotate(
            "\n".join(_alarm_lines(history)),
            (history.alarm_s, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(-5 if left else 5, 4),
            textcoords="offset points",
            ha="right" if left else "left",
            color=LIMIT,
            fontsize=8,
            fontweight="bold",
            parse_math=False,
        )
        said.set_in_layout(False)


def _alarm_share(history: History) -> float:
    """Return where in the whole run the alarm came, 0 to 1."""
    start, end = float(history.t_s[0]), float(history.t_s[-1])
    return 0.0 if history.alarm_s is None or end <= start else (history.alarm_s - start) / (end - start)


def _alarm_lines(history: History) -> list[str]:
    """Break the text of the alarm into lines that fit the wider side of it; none without an alarm."""
    share = _alarm_share(history)
    return textwrap.wrap(history.alarm_text, max(int(LETTERS * max(share, 1.0 - share)), 1))


def _room(axes: Axes, lines: int) -> None:
    """Keep the curve out of the words: lines of the alarm below it, names of states above it."""
    low, high = axes.get_ylim()
    words = LINE_ROOM * (high - low)
    axes.set_ylim(low - (lines + 0.5) * words, high + words)


def _bands(axes: Axes, history: History, *, named: bool) -> None:
    """Shade each stretch of one state; name those that are wide enough for their name."""
    changes = np.flatnonzero(np.diff(history.state)) + 1
    edges = [0, *changes.tolist(), history.t_s.size - 1]
    low, high = axes.get_xlim()
    for first, last in pairwise(edges):
        state = int(history.state[first])
        start, end = max(float(history.t_s[first]), low), min(float(history.t_s[last]), high)
        if end <= start:
            continue
        axes.axvspan(start, end, color=BANDS.get(state, UNKNOWN_BAND), zorder=0, linewidth=0)
        name = state_name(state).replace("_", " ")
        if named and (end - start) / (high - low) > 0.022 * len(name):
            place = ("data", "axes fraction")
            axes.annotate(name, ((start + end) / 2, 0.98), xycoords=place, ha="center", va="top", fontsize=7.5)
