"""The pictures and tables of the quality page, made of figures alone: yield over time, causes, charts, groups."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from html import escape
from math import ceil, floor, log10
from typing import Any

from analysis.line.proportions import Cause, Proportion
from analysis.line.run_rules import RULES
from definitions.checks import CHECKS
from definitions.metrics import METRICS
from station.documents.manifest import MASTER
from station.documents.result import Limits
from station.quality.bench_ability import Due, PartFigure
from station.quality.figures import (
    CapabilityFigure,
    CapabilityRow,
    ChartFigure,
    TrendFigure,
    YieldFigure,
    said_beside,
)
from station.reports.result_text import limits_text, minus, unit_text
from station.store.quality.values import Characteristic
from station.web.languages import Words

INK, QUIET, GRID_INK, BAD, LINE = "#23282b", "#5b646a", "#c2c7ca", "#b3201f", "#2f4a5e"
CAPABLE = 1.33
MOST_BARS = 8

Options = dict[str, Any]
"""Options of a picture as ECharts takes them in the browser: its own tree, which nothing here reads back."""

LABELS: Options = {"fontSize": 14, "lineHeight": 18, "color": INK}
INSIDE = LABELS | {"showMinLabel": False, "showMaxLabel": False}
"""Labels of an axis without those of its ends, which are no round figures, and lie over what stands there."""


LIMITS: Options = {"silent": True, "symbol": "none", "precision": 12}
"""Lines of a picture at their values: ECharts would draw them at hundredths of the unit."""


def plain_axis(**more: Any) -> Options:
    """Return an axis in the ink of the pages."""
    return {
        "axisLabel": LABELS, "nameTextStyle": {"fontSize": 14, "color": INK},
        "splitLine": {"lineStyle": {"color": GRID_INK}},
    } | more  # fmt: skip


def title_of(metric: str, choices: str = "") -> str:
    """Return how people call a metric, short, with its choices."""
    row = METRICS.get(metric)
    name = metric if row is None else row.title.partition(" (")[0]
    return " ".join(part for part in (name, choices) if part)


def side_title(what: Characteristic, side: str, say: Words) -> str:
    """Return how people call a metric on one of its sides."""
    title = title_of(what.metric, what.choices)
    return say.whole(f"{title}, {say('side {side}', side=minus(side))}") if side in ("+", "-") else title


def cause_title(name: str, say: Words) -> str:
    """Return a cause as people call it: titles in place of ids, and its side as in the other tables."""
    what, _, side = name.partition(" side ")
    metric, *more = what.split()
    row = METRICS.get(metric)
    if row is not None and set(more) == set(row.branches):
        what = metric  # its only branch says nothing
    words = [title_of(one) if one in METRICS else CHECKS[one].title if one in CHECKS else one for one in what.split()]
    title = say(" ".join(words))
    return say.whole(f"{title}, {say('side {side}', side=side)}") if side else title


def percent(share: float | None) -> str:
    """Return a share in per cent."""
    return "–" if share is None else f"{100 * share:.1f} %"


def share_html(head: str, one: Proportion, say: Words) -> str:
    """Return a share of units as a large figure with its interval."""
    interval = say("95 %: {low} to {high} %", low=f"{100 * one.low:.1f}", high=f"{100 * one.high:.1f}")
    units = say("{number} of {count} units", number=one.number, count=one.of)
    return (
        f'<div class="lm-figure"><span>{escape(head)}</span><b>{percent(one.share)}</b>'
        f"<span>{escape(units)}<br>{escape(interval)}</span></div>"
    )


def yield_options(found: YieldFigure, say: Words) -> Options:
    """Return first-pass yield over time, with its interval, and the final yield."""
    names = [row.group for row in found.groups]
    of_first, of_final, interval = say("first pass"), say("final"), say("95 % interval")
    low = [round(100 * row.first_pass.low, 3) for row in found.groups]
    width = [round(100 * (row.first_pass.high - row.first_pass.low), 3) for row in found.groups]
    first, final = (
        [None if one.share is None else round(100 * one.share, 3) for one in shares]
        for shares in ([row.first_pass for row in found.groups], [row.final for row in found.groups])
    )
    band = {"type": "line", "stack": "band", "symbol": "none", "silent": True, "lineStyle": {"opacity": 0}}
    series = [
        band | {"name": say("low"), "data": low},
        band | {"name": interval, "data": width, "color": LINE, "areaStyle": {"opacity": 0.18}},
        {"type": "line", "name": of_first, "data": first, "symbolSize": 8, "color": LINE,
         "lineStyle": {"width": 3, "color": LINE}},
        {"type": "line", "name": of_final, "data": final, "symbol": "none", "color": QUIET,
         "lineStyle": {"width": 2, "type": "dashed", "color": QUIET}},
    ]  # fmt: skip
    bottom = min([100.0, *low])
    return _framed({
        "xAxis": plain_axis(type="category", data=names),
        "yAxis": plain_axis(type="value", name="%", min=max(0.0, 5.0 * (bottom // 5.0)), max=100),
        "legend": {"data": [of_first, interval, of_final], "top": 0},
        "tooltip": {"trigger": "axis"}, "series": series,
    })  # fmt: skip


def causes_html(head: str, causes: Sequence[Cause], say: Words) -> str:
    """Return the commonest causes with numbers and cumulative share; a bar behind each is as long as its share."""
    rows = [(cause_title(one.name, say), one.number, one.share, percent(one.cumulative)) for one in causes[:MOST_BARS]]
    rest = causes[MOST_BARS:]
    if rest:
        others = say.counted(len(rest), "{count} other", "{count} others")
        rows.append((others, sum(one.number for one in rest), sum(one.share for one in rest), ""))
    body = "".join(
        f'<tr style="background: linear-gradient(to right, #b9c4cc {100 * share:.1f}%, transparent 0)">'
        f'<td>{escape(name)}</td><td class="n">{number}</td><td class="n">{cumulative}</td></tr>'
        for name, number, share, cumulative in rows
    )
    none = "" if rows else f'<tr><td colspan="3">{say("none")}</td></tr>'
    heads = f'<tr><th>{escape(head)}</th><th class="n">{say("runs")}</th><th class="n">{say("sum")}</th></tr>'
    return f'<table class="lm">{heads}{body}{none}</table>'


def chart_options(found: ChartFigure, say: Words) -> Options:
    """Return the control chart: means above, spreads below; what is signalled is marked by shape and colour."""
    chart, unit = found.chart, unit_text(found.metric.unit)
    marked = {one.point for one in chart.signals}
    shift = len(chart.means) - len(chart.spreads)
    means = _points(chart.means, marked)
    spreads = [None] * shift + _points(chart.spreads, {place - shift for place in chart.spread_signals})
    names = [moment[:16].replace("T", " ") for moment in found.started]
    what = say("single values") if chart.subgroup == 1 else say("mean of {count}", count=chart.subgroup)
    series = []
    for place, (points, limits) in enumerate(((means, chart.mean_limits), (spreads, chart.spread_limits))):
        levels = (limits.centre, limits.low, limits.high)
        series.append({
            "type": "line", "data": points, "xAxisIndex": place, "yAxisIndex": place, "color": LINE, "symbolSize": 5,
            "showAllSymbol": len(means) <= 200, "lineStyle": {"width": 1.5, "color": LINE}, "showSymbol": True,
            "markLine": LIMITS | {"data": _lines(levels, levels), "label": {"fontSize": 13, "color": INK}},
        })  # fmt: skip
    grids = [
        {"left": 76, "right": 84, "top": 34, "height": "46%"},
        {"left": 76, "right": 84, "top": "70%", "bottom": 30},
    ]
    axes = [
        plain_axis(type="value", name=f"{name}, {unit}", gridIndex=place, splitNumber=(5, 3)[place], axisLabel=INSIDE)
        | _ends(points, limits.low, limits.high)
        for place, (name, points, limits) in enumerate(
            ((what, chart.means, chart.mean_limits), (say(chart.kind), chart.spreads, chart.spread_limits))
        )
    ]
    return {
        "animation": False, "grid": grids, "tooltip": {"trigger": "axis"}, "yAxis": axes, "series": series,
        "xAxis": [plain_axis(type="category", data=names, gridIndex=place, show=bool(place)) for place in (0, 1)],
    }  # fmt: skip


def _decimals(values: Sequence[float]) -> int:
    """Return the decimals that tell values apart, by their width: they may differ in their sixth digit alone."""
    width = max(values) - min(values) or 1e-4 * abs(values[0]) or 1.0
    return ceil(-log10(width)) + 2


def _ends(values: Sequence[float], *lines: float) -> Options:
    """Return the ends of an axis that holds values and lines, for a chart's own choice leaves the lines out."""
    held = [*values, *lines]
    low, high, decimals = min(held), max(held), _decimals(held)
    room, step = 0.06 * (high - low) or abs(high) or 1.0, 10.0**-decimals
    return {
        "min": round(floor((low - room) / step) * step, decimals),
        "max": round(ceil((high + room) / step) * step, decimals),
    }


def _points(values: Sequence[float], marked: Collection[int]) -> list[Options]:
    """Return the points of a line; marked: their numbers, from 1, that are signalled."""
    decimals = _decimals(values) + 2
    mark: Options = {"symbol": "diamond", "symbolSize": 15, "itemStyle": {"color": BAD}}
    return [
        {"value": round(value, decimals)} | (mark if number in marked else {})
        for number, value in enumerate(values, start=1)
    ]


def _figure(value: float, among: Sequence[float]) -> str:
    """Return a value with the decimals that tell it from those that it is among."""
    return f"{round(value, _decimals(among)):.12g}"


def _lines(levels: Sequence[float], among: Sequence[float]) -> list[Options]:
    """Return a centre and its limits as lines, each with a figure that tells it from the values that it is among."""
    return [
        {"yAxis": value, "label": {"formatter": _figure(value, among)},
         "lineStyle": {"type": "dashed" if place else "solid", "color": QUIET, "width": 1.5}}
        for place, value in enumerate(levels)
    ]  # fmt: skip


OUT_OF_CONTROL = ("{count} signal: out of control.", "{count} signals: out of control.")
"""What is said of one signal and of several."""

RUN_LENGTH = (
    "On average means and spread together raise a false alarm every {points} points (every {hours} h at {rate} units "
    "an hour). They find a shift of the mean by 1 σ after {shifted} points."
)


def chart_words(found: ChartFigure, say: Words, units_per_hour: float = 60.0) -> str:
    """Return what the chart says, and what its rules cost."""
    chart, ends = found.chart, found.run_length
    error = f" ± {ends.standard_error:.1g}" if ends.standard_error else ""
    signals = len(chart.signals) + len(chart.spread_signals)
    said = say("In control.") if chart.in_control else say.counted(signals, *OUT_OF_CONTROL)
    told = say(
        RUN_LENGTH,
        points=f"{ends.points:.4g}{error}",
        hours=f"{1.0 / found.false_alarms_per_hour(units_per_hour):.3g}",
        rate=f"{units_per_hour:g}",
        shifted=f"{found.shifted.points:.3g}",
    )
    return say.whole(f"{said} {told}")


def signals_html(found: ChartFigure, say: Words, most: int = 6) -> str:
    """Return the newest signals, with a link to the run that completed each."""
    chart = found.chart
    told = [(one.point, say(RULES[one.rule].text)) for one in chart.signals]
    beyond = say("{spread} beyond its limits", spread=say(chart.kind))
    told += [(place, beyond) for place in chart.spread_signals]
    rows = [
        f'<li>{escape(text)}: <a href="/runs/{escape(found.runs[place - 1])}">{escape(found.runs[place - 1])}</a></li>'
        for place, text in sorted(told, reverse=True)[:most]
    ]
    return f"<ul>{''.join(rows)}</ul>" if rows else ""


def capability_html(found: CapabilityFigure, say: Words) -> str:
    """Return the capability of every metric as a table, the worst first."""
    heads = "".join(f"<th class='{kind}'>{escape(say(head))}</th>" for head, kind in HEADS)
    ranked = sorted(found.rows, key=lambda row: -1.0 if row.found is None else row.found.overall.nearest)
    table = f'<table class="lm"><tr>{heads}</tr>{"".join(_capability_row(row, say) for row in ranked)}</table>'
    said = "".join(f'<li class="lm-other-limits">{escape(one)}</li>' for row in found.rows for one in _others(row, say))
    return f'{table}<p class="lm-words">{escape(say(JUDGED_BY))}</p>{f"<ul>{said}</ul>" if said else ""}'


HEADS = (
    ("Metric, side that judges", ""), ("Limit", "n"), ("n", "n"), ("Mean", "n"), ("Cp", "n"), ("Cpk (95 %)", "n"),
    ("Pp", "n"), ("Ppk (95 %)", "n"),
)  # fmt: skip
"""Heads of the table of capability, each with its style."""

STANDINGS = {"FAIL": "■ not capable", "OPEN": "▲ below 1.33"}
"""What is said of a capability that is too small, by the style of its row."""

OTHER_SIDE_UNKNOWN = "▲ other side not known"
"""Said of a metric of which one side has no indices: it may be the worse one."""

JUDGED_BY = "All values are judged by the limits of the newest run, whichever limits they were tested by."


def _others(row: CapabilityRow, say: Words) -> list[str]:
    return [say(one) for one in said_beside(row, side_title(row.metric, row.side, say))]


def _capability_row(row: CapabilityRow, say: Words) -> str:
    what, one = row.metric, row.found
    limit = f"{_unbroken(limits_text(Limits(min=what.limit_min, max=what.limit_max)))} {unit_text(what.unit)}"
    name = side_title(what, row.side, say)
    if one is None:
        return f'<tr class="OPEN"><td>{escape(name)}</td><td class="n">{escape(limit)}</td><td colspan="6">{escape(say(row.why))}</td></tr>'  # noqa: E501
    style = "FAIL" if one.overall.nearest < 1.0 else "OPEN" if one.overall.nearest < CAPABLE else ""
    word = f" {escape(say(STANDINGS[style]))}" if style else ""
    if row.without:
        style, word = style or "OPEN", f"{word} {escape(say(OTHER_SIDE_UNKNOWN))}"
    mean = _figure(one.mean, (one.mean - one.sd_overall, one.mean + one.sd_overall))
    cells = [
        limit, str(one.values), mean,
        _index(one.within.both), _nearest(one.within.nearest, one.cpk_low, one.cpk_high),
        _index(one.overall.both), _nearest(one.overall.nearest, one.ppk_low, one.ppk_high),
    ]  # fmt: skip
    body = "".join(f'<td class="n">{escape(minus(cell))}</td>' for cell in cells)
    return f'<tr class="{style}"><td>{escape(name)}<b>{word}</b></td>{body}</tr>'


def _nearest(value: float, low: float, high: float) -> str:
    return f"{_index(value)} {_unbroken(f'({low:.2f} … {high:.2f})')}"


def _unbroken(text: str) -> str:
    """Return a text that stays in one line: where a column is narrow, it is broken before and behind it."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _index(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def group_title(found: TrendFigure, name: str, say: Words) -> str:
    """Return how people call a group: a shift and a sector have words, any other group is called as it is."""
    return say(name) if found.by in ("shift", "lock-angle") else name


def trend_options(found: TrendFigure, say: Words) -> Options:
    """Return the means of the groups with their intervals, about the mean of all."""
    one, unit = found.compared, unit_text(found.metric.unit)
    apart = {number for number, g in enumerate(one.groups, start=1) if not g.low <= one.mean <= g.high}
    points = _points([group.mean for group in one.groups], apart)
    names = [f"{group_title(found, group.name, say)}\n(n = {group.number})" for group in one.groups]
    ends = [end for group in one.groups for end in (group.low, group.high)]
    decimals = _decimals(ends) + 2
    bars = [[place, round(g.low, decimals), round(g.high, decimals)] for place, g in enumerate(one.groups)]
    return _framed({
        "xAxis": plain_axis(type="category", data=names),
        "yAxis": plain_axis(type="value", name=unit) | _ends(ends),
        "tooltip": {"trigger": "item"},
        "series": [
            {"type": "custom", ":renderItem": WHISKER, "data": bars, "silent": True, "z": 1,
             "encode": {"x": 0, "y": [1, 2]}},
            {"type": "scatter", "data": points, "symbolSize": 11, "color": LINE, "z": 2, "markLine": LIMITS | {
                "data": _lines([one.mean], ends)}},
        ],
    })  # fmt: skip


WHISKER = """(params, api) => {
  const low = api.coord([api.value(0), api.value(1)]), high = api.coord([api.value(0), api.value(2)]);
  const style = {stroke: '#5b646a', lineWidth: 2};
  const line = (x1, y1, x2, y2) => ({type: 'line', shape: {x1, y1, x2, y2}, style});
  return {type: 'group', children: [line(low[0], low[1], high[0], high[1]),
    line(low[0] - 8, low[1], low[0] + 8, low[1]), line(high[0] - 8, high[1], high[0] + 8, high[1])]};
}"""
"""How the browser draws an interval; ECharts has no error bars of its own."""


def trend_words(found: TrendFigure, say: Words) -> str:
    """Return what the groups say."""
    one = found.compared
    apart = [group_title(found, group.name, say) for group in one.groups if not group.low <= one.mean <= group.high]
    said = say("No group is apart from the others.")
    said = say("Apart from the others: {groups}.", groups=", ".join(apart)) if apart else said
    between = say(BETWEEN, share=percent(one.share_between), probability=f"{one.p_same:.2g}")
    return say.whole(f"{said} {between}")


BETWEEN = "{share} of the variance lies between them (by chance alone: probability {probability})."


def part_options(found: PartFigure) -> Options:
    """Return the values of a master part over time with its control limits."""
    series, trend = found.series, found.trend
    marked = set() if trend is None else {one.measurement for one in trend.signals if one.rule != "trend"}
    levels = () if trend is None else (trend.centre, trend.low_limit, trend.high_limit)
    lines = _lines(levels, levels) if levels else []
    points = _points(series.values, marked)
    return _framed({
        "xAxis": plain_axis(type="category", data=[moment[:16].replace("T", " ") for moment in series.started]),
        "yAxis": plain_axis(type="value", name=unit_text(series.metric.unit))
            | _ends(series.values, *levels),
        "tooltip": {"trigger": "axis"},
        "series": [{"type": "line", "data": points, "color": LINE, "symbolSize": 7, "showSymbol": True,
                    "markLine": LIMITS | {"data": lines,
                                 "label": {"fontSize": 13, "color": INK}}}],
    })  # fmt: skip


def _due_said(one: Due, say: Words) -> str:
    """Return how something stands, with the master part that it is said of."""
    if not one.text.startswith(MASTER):
        return say(one.text)
    serial, _, how = one.text.removeprefix(MASTER).partition(" ")
    return f"{say('master part {serial}', serial=serial)} {say(how)}"


def due_html(rows: Sequence[Due], say: Words) -> str:
    """Return what is due on the benches, what is overdue first."""
    body = "".join(
        f'<tr class="{"FAIL" if not one.in_order else ""}"><td>{escape(one.bench)}</td><td>{escape(say(one.what))}</td>'
        f"<td>{'' if one.in_order else '<b>■ </b>'}{escape(_due_said(one, say))}</td></tr>"
        for one in sorted(rows, key=lambda one: one.in_order)
    )
    heads = "".join(f"<th>{escape(head)}</th>" for head in (say("Bench"), say("What"), say("State")))
    return f'<table class="lm"><tr>{heads}</tr>{body}</table>'


def _framed(more: Options) -> Options:
    return {"animation": False, "grid": {"left": 60, "right": 76, "top": 34, "bottom": 46}} | more
