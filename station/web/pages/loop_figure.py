"""The loop of a run as an interactive picture: others drawn over it, and the torques of a bad metric marked.

Plotly draws a line whose torque comes back; it goes with the pages, and is asked for nothing outside of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from station.reports.loop_curves import FALLING, RISING, Line, LoopCurves
from station.reports.metric_torques import Span
from station.web.languages import ENGLISH, Words, words_of

IN_ENGLISH = words_of(ENGLISH)
INK, GRID = "#23282b", "#c2c7ca"
OWN = "#0b4f6c"
OTHERS: tuple[tuple[str, str], ...] = (
    ("#c2571a", "dash"), ("#7b1fa2", "dot"), ("#1b7f3b", "dashdot"), ("#5d4037", "longdash"),
    ("#b0006a", "longdashdot"),
)  # fmt: skip
"""Colour and dashes of each run that is drawn over this one: the dashes tell them apart without colour."""

MARKS = {"FAIL": ("rgba(179, 32, 31, 0.20)", "#b3201f"), "NOT DECIDABLE": ("rgba(179, 107, 0, 0.20)", "#7a4900")}
"""Colour of a marked band and of its name, by the verdict of the metric that is read there."""

LEAST_SHARE = 0.006
"""Half the width that a band is drawn with at least, of the reference torque: many metrics are read at one torque."""

AROUND = 2.5
"""How much more than the marked band is shown when it is looked at closely."""

TEXT = {"size": 15, "color": INK}

Figure = dict[str, Any]
"""A part of a picture as Plotly takes it in the browser: its own tree of options, which nothing here reads back."""


@dataclass(frozen=True)
class Drawn:
    """A run in the picture: what it is called, and its curves."""

    name: str
    curves: LoopCurves


@dataclass(frozen=True)
class Marked:
    """A metric whose torques are marked: name, verdict, between which torques [N·m], whether it is a stiffness.

    allowed_arcmin: how wide the loop may be there; None where the metric is no width of the loop.
    """

    name: str
    verdict: str
    spans_nm: tuple[Span, ...]
    stiffness: bool = False
    allowed_arcmin: float | None = None


def loop_figure(
    own: Drawn, others: Sequence[Drawn], marked: Sequence[Marked], say: Words = IN_ENGLISH, *, close: bool = False
) -> Figure:
    """Return the picture of the loop; close: no more of it than is marked, and a little around."""
    traces = [_trace(line, own.name, OWN, "solid", first=not place) for place, line in enumerate(own.curves.loop)]
    for one, (colour, dash) in zip(others, OTHERS, strict=False):
        traces += [_trace(line, one.name, colour, dash, first=not place) for place, line in enumerate(one.curves.loop)]
    if own.curves.alarm is not None:
        torque, windup = own.curves.alarm
        mark = {"symbol": "x", "size": 14, "color": MARKS["FAIL"][1]}
        traces.append(
            {"type": "scatter", "mode": "markers", "name": say("alarm"), "x": [torque], "y": [windup], "marker": mark}
        )
    if any(line.name.startswith(RISING) for line in own.curves.loop):  # of a run that was evaluated
        widths = [one for one in marked if one.allowed_arcmin is not None]
        traces += [_allowed(own.curves, one, say, first=not place) for place, one in enumerate(widths)]
    layout = _layout(say("torque at the output in N·m"), say("wind-up at the output in arcmin"))
    shapes, names = _bands(marked, own.curves.reference_nm)
    layout |= {"shapes": shapes, "annotations": names}
    if close and (ends := close_range(own.curves.reference_nm, marked)):
        layout["xaxis"] |= {"range": list(ends)}
        heights = _heights([own, *others], ends)
        if heights:
            room = 0.08 * (max(heights) - min(heights) or 1.0)
            layout["yaxis"] |= {"range": [min(heights) - room, max(heights) + room]}
    return {"data": traces, "layout": layout, "config": CONFIG}


def _allowed(curves: LoopCurves, marked: Marked, say: Words, *, first: bool) -> Figure:
    """Return how wide the loop may be, as a bar about its middle at each torque where its width is read."""
    rising, falling = (next(line for line in curves.loop if line.name.startswith(name)) for name in (RISING, FALLING))
    torques = [low for low, _ in marked.spans_nm]
    middles = [(rising.at(torque) + falling.at(torque)) / 2 for torque in torques]
    half = (marked.allowed_arcmin or 0.0) / 2
    bar = {"type": "constant", "value": half, "color": INK, "thickness": 3, "width": 12}
    allowed = say("allowed width")
    hover = plain_text(f"{allowed}: {marked.allowed_arcmin:g} arcmin, {marked.name}")
    return {
        "type": "scatter", "mode": "markers", "name": allowed, "legendgroup": "allowed", "showlegend": first,
        "x": torques, "y": middles, "error_y": bar, "hovertemplate": f"{hover}<extra></extra>",
        "marker": {"symbol": "line-ns-open", "size": 14, "color": INK, "line": {"width": 3, "color": INK}},
    }  # fmt: skip


def stiffness_figure(own: Drawn, others: Sequence[Drawn], marked: Sequence[Marked], say: Words = IN_ENGLISH) -> Figure:
    """Return the picture of the local stiffness of the loading branches over torque; marked: stiffnesses alone."""
    traces = [_trace(line, own.name, OWN, "solid", first=not place) for place, line in enumerate(own.curves.stiffness)]
    for one, (colour, dash) in zip(others, OTHERS, strict=False):
        lines = one.curves.stiffness
        traces += [_trace(line, one.name, colour, dash, first=not place) for place, line in enumerate(lines)]
    layout = _layout(say("torque at the output in N·m"), say("stiffness in N·m/arcmin"))
    shapes, names = _bands([one for one in marked if one.stiffness], own.curves.reference_nm)
    layout["yaxis"] |= {"rangemode": "tozero"}
    return {"data": traces, "layout": layout | {"shapes": shapes, "annotations": names}, "config": CONFIG}


CONFIG = {
    "displaylogo": False,
    "responsive": True,
    "modeBarButtonsToRemove": ["select2d", "lasso2d", "sendDataToCloud"],
}


def close_range(reference_nm: float, marked: Sequence[Marked]) -> Span | None:
    """Return the torques [N·m] that are shown when what is marked is looked at closely; None where nothing is."""
    spans = [span for one in marked for span in one.spans_nm]
    if not spans:
        return None
    low, high = min(low for low, _ in spans), max(high for _, high in spans)
    middle, half = (low + high) / 2, max((high - low) / 2, LEAST_SHARE * reference_nm)
    return middle - AROUND * half, middle + AROUND * half


def _bands(marked: Sequence[Marked], reference_nm: float) -> tuple[list[Figure], list[Figure]]:
    """Return the bands and their names; metrics that are read at the same torques share a band."""
    together: dict[tuple[str, Span], list[str]] = {}
    for one in marked:
        for span in one.spans_nm:
            together.setdefault((one.verdict, span), []).append(one.name)
    shapes, names = [], []
    for place, ((verdict, (low, high)), about) in enumerate(together.items()):
        fill, ink = MARKS[verdict]
        widen = max(LEAST_SHARE * reference_nm - (high - low) / 2, 0.0)
        shapes.append({
            "type": "rect", "layer": "below", "xref": "x", "yref": "paper", "x0": low - widen, "x1": high + widen,
            "y0": 0, "y1": 1, "fillcolor": fill, "line": {"width": 1, "color": ink},
        })  # fmt: skip
        names.append({
            "xref": "x", "yref": "paper", "x": (low + high) / 2, "y": 1.0 - 0.07 * place, "yanchor": "top",
            "xanchor": "left", "showarrow": False, "font": {"size": 14, "color": ink},
            "bgcolor": "rgba(255,255,255,0.8)", "text": plain_text(", ".join(dict.fromkeys(about))),
        })  # fmt: skip
    return shapes, names


def _heights(drawn: Sequence[Drawn], ends: Span) -> list[float]:
    lines = [line for one in drawn for line in one.curves.loop]
    return [
        value
        for line in lines
        for torque, value in zip(line.torque_nm, line.values, strict=True)
        if value is not None and ends[0] <= torque <= ends[1]
    ]


def _trace(line: Line, name: str, colour: str, dash: str, *, first: bool) -> Figure:
    name = plain_text(name)
    return {
        "type": "scatter", "mode": "lines", "name": name, "legendgroup": name, "showlegend": first,
        "x": list(line.torque_nm), "y": list(line.values), "line": {"color": colour, "width": 2, "dash": dash},
        "hovertemplate": f"%{{x:.2f}} N·m, %{{y:.4f}}<extra>{name}, {plain_text(line.name)}</extra>",
    }  # fmt: skip


def plain_text(text: str) -> str:
    """Return a text that Plotly shows as it is: it takes some tags, and what stands in braces, for more than text."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("{", "&#123;")


def _layout(x_title: str, y_title: str) -> Figure:
    axis = {"gridcolor": GRID, "zerolinecolor": INK, "zerolinewidth": 1, "tickfont": TEXT, "automargin": True}
    return {
        "margin": {"l": 70, "r": 12, "t": 12, "b": 56}, "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "white",
        "hovermode": "closest", "font": TEXT, "autosize": True, "uirevision": "kept", "separators": ".",
        "legend": {"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom", "font": TEXT},
        "xaxis": {**axis, "title": {"text": x_title, "font": TEXT}},
        "yaxis": {**axis, "title": {"text": y_title, "font": TEXT}},
    }  # fmt: skip
