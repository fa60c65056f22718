"""What the quality commands print: the figures of `station.quality` as tables or as one JSON object."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.line.proportions import Cause, Proportion
from analysis.line.run_rules import RULES, RunLength, rules_of
from analysis.line.type_one import CAPABLE, USUAL
from station.cli.line.line_statistics import figure
from station.cli.say import Grid, say
from station.counted import counted
from station.documents.entries import plain
from station.documents.result import Limits
from station.quality.bench_ability import Part, TypeOneFigure, type_one_of
from station.quality.figures import (
    CapabilityRow,
    YieldRow,
    capability_of,
    causes_of,
    chart_of,
    left_out_of,
    said_beside,
    trend_of,
    yield_of,
)
from station.reports.result_text import limits_text, unit_text
from station.store.quality.lot import Lot, Production, production

NOT_SO = 1
"""Exit code of what is out of control, or of a gage that is not capable."""

MOST_SIGNALS = 10
SEVERAL = 8


@dataclass(frozen=True)
class ChartAsked:
    """What is asked of a chart: the metric by its name, rules or sets of them, subgroups, side and branch."""

    metric: str
    rules: tuple[str, ...]
    subgroup: int
    baseline: int | None
    side: str | None
    branch: str | None
    units_per_hour: float


def percent(share: float | None) -> str:
    """Return a share in per cent."""
    return "–" if share is None else f"{100 * share:.2f} %"


def _share(one: Proportion) -> str:
    return f"{one.number} of {one.of}"


def _interval(one: Proportion) -> str:
    return f"{100 * one.low:.2f} … {100 * one.high:.2f} %"


def lot_note(look: Production, lot: Lot) -> list[str]:
    """Return what a reader must know of the runs behind the figures."""
    notes = ["VIRTUAL: units of the virtual bench"] if lot.virtual else []
    return notes + left_out_of(look, lot)


def _say(found: object, blocks: Sequence[str | Grid], notes: Sequence[str], *, as_json: bool) -> int:
    """Print a figure, and behind it what a reader must know; a program gets that on standard error."""
    if as_json:
        sys.stderr.writelines(f"{note}\n" for note in notes)
    return say(found, [*blocks, *notes], as_json=as_json)


def print_yield(data: Path, lot: Lot, by: str | None, level: float, *, as_json: bool) -> int:
    """Print first-pass and final yield; return 0. StationError for a lot without runs."""
    with production(data) as look:
        found = yield_of(look, lot, by, level)
        notes = lot_note(look, lot)
    rows = [_yield_row(one) for one in (*found.groups, found.whole)]
    heads = (by or "", "first", "yield", "interval", "final", "yield", "interval",
             "FAIL", "no verdict", "stopped")  # fmt: skip
    explained = (
        "first: passed at the first attempt; final: by the newest run; no verdict: NOT DECIDABLE; "
        f"stopped: or ended by a fault; interval: confidence {level:.0%}"
    )
    return _say(found, [Grid(heads, rows, right=tuple(range(1, 10))), explained], notes, as_json=as_json)


def _yield_row(one: YieldRow) -> tuple[str, ...]:
    first = one.verdicts.first
    of_both = [part for share in (one.first_pass, one.final)
               for part in (_share(share), percent(share.share), _interval(share))]  # fmt: skip
    return (one.group, *of_both, *(str(number) for number in (first.failed, first.undecided, first.ended_otherwise)))


def print_causes(data: Path, lot: Lot, *, as_json: bool) -> int:
    """Print what hindered a lot; return 0. StationError for a lot without runs."""
    with production(data) as look:
        found = causes_of(look, lot)
        notes = lot_note(look, lot)
    blocks: list[str | Grid] = [f"{found.first_attempts} first attempts"]
    for head, causes in (
        ("metric that failed", found.failed), ("alarm, in runs of any attempt", found.alarms),
        ("why there is no verdict", found.undecided),
    ):  # fmt: skip
        heads = (head, "runs", "share", "cumulative")
        blocks.append(Grid(heads, _cause_rows(causes) or [("none", "", "", "")], right=(1, 2, 3)))
    return _say(found, blocks, notes, as_json=as_json)


def _cause_rows(causes: Sequence[Cause]) -> list[tuple[str, ...]]:
    return [(one.name, str(one.number), percent(one.share), percent(one.cumulative)) for one in causes]


def print_capability(
    data: Path, lot: Lot, metrics: Sequence[str], subgroup: int, level: float, *, as_json: bool
) -> int:
    """Print the capability of metrics; return 0. Raises as `capability_of`."""
    with production(data) as look:
        found = capability_of(look, lot, metrics, subgroup=subgroup, level=level)
        notes = lot_note(look, lot)
    each = f"{level:.0%}"
    heads = ("metric", "side", "limit", "n", "mean", "Cp", "Cpk", each, "Pp", "Ppk", each, "other side")
    rows = [_capability_cells(one) for one in found.rows]
    notes += [f"{one.metric.name}: {one.why}" for one in found.rows if one.why]
    notes += _meanings((one.metric.name, one.other_meanings) for one in found.rows)
    many = max((one.found.values for one in found.rows if one.found is not None), default=0)
    notes += [f"of the newest {many} first attempts; more with --newest N"] if many == lot.newest else []
    notes += [text for one in found.rows for text in said_beside(one, one.metric.name)]
    notes.append("other side: Ppk of the other side; the side with the smaller Ppk counts")
    return _say(found, [Grid(heads, rows, right=tuple(range(3, 12)))], notes, as_json=as_json)


def _capability_cells(row: CapabilityRow) -> tuple[str, ...]:
    what, one = row.metric, row.found
    limit = f"{limits_text(Limits(min=what.limit_min, max=what.limit_max))} {unit_text(what.unit)}".strip()
    if one is None:
        return (what.name, row.side, limit, *("–" for _ in range(9)))
    others = ", ".join(figure(ppk, "", 3) for _, ppk in row.others) or "–"
    return (
        what.name, row.side, limit, str(one.values), figure(one.mean, what.unit, 4),
        figure(one.within.both, "", 3), figure(one.within.nearest, "", 3), _ends(one.cpk_low, one.cpk_high),
        figure(one.overall.both, "", 3), figure(one.overall.nearest, "", 3), _ends(one.ppk_low, one.ppk_high), others,
    )  # fmt: skip


def _ends(low: float, high: float) -> str:
    return f"{figure(low, '', 3)} … {figure(high, '', 3)}"


def _meanings(counts: object) -> list[str]:
    return [
        f"{name}: left out, because it is another definition, fit, band or torque there: {counted(number, 'run')}"
        for name, number in counts  # type: ignore[attr-defined]
        if number
    ]


def print_chart(data: Path, lot: Lot, asked: ChartAsked, *, as_json: bool) -> int:
    """Print a control chart; return 0, or 1 when it is out of control. Raises as `chart_of`."""
    rules = rules_of(asked.rules)
    with production(data) as look:
        found = chart_of(look, lot, asked.metric, rules, side=asked.side, branch=asked.branch,
                         subgroup=asked.subgroup, baseline=asked.baseline)  # fmt: skip
        notes = lot_note(look, lot)
    chart, unit = found.chart, found.metric.unit
    plotted = "single values" if chart.subgroup == 1 else f"means of {chart.subgroup}"
    rows = [
        (name, figure(one.centre, unit), figure(one.low, unit), figure(one.high, unit))
        for name, one in ((plotted, chart.mean_limits), (chart.kind, chart.spread_limits))
    ]
    hourly = found.false_alarms_per_hour(asked.units_per_hour)
    blocks: list[str | Grid] = [
        f"{found.metric.name} side {found.side}: {len(chart.means)} subgroups, limits from the first {chart.baseline}",
        Grid(("", "centre", "lower limit", "upper limit"), rows, right=(1, 2, 3)),
        f"rules: {'; '.join(RULES[name].text for name in rules)}",
        f"average run length without a change: {run_length_text(found.run_length)} points ({plotted} and {chart.kind})",
        _false_alarms(hourly, asked.units_per_hour),
        f"a shift of one standard deviation of what is plotted is found after {run_length_text(found.shifted)} points",
    ]
    signals = [
        f"{RULES[one.rule].text}, at {chart_place(found.started, found.runs, one.point)}" for one in chart.signals
    ]
    signals += [
        f"{chart.kind} beyond its limits, at {chart_place(found.started, found.runs, place)}"
        for place in chart.spread_signals
    ]
    blocks += [f"SIGNAL: {text}" for text in signals[:MOST_SIGNALS]]
    blocks += [f"and {len(signals) - MOST_SIGNALS} more signals"] if len(signals) > MOST_SIGNALS else []
    blocks.append("in control" if chart.in_control else "OUT OF CONTROL")
    notes += _meanings([(found.metric.name, found.other_meanings)])
    say({**plain(found), "false_alarms_per_hour": hourly}, [*blocks, *notes], as_json=as_json)
    return 0 if chart.in_control else NOT_SO


def _false_alarms(hourly: float, units_per_hour: float) -> str:
    """Return what the rules cost: a line has several metrics, and the false alarms of their charts add up."""
    return (
        f"one chart: a false alarm every {1.0 / hourly:.3g} h at {units_per_hour:g} units an hour; {SEVERAL} charts: a "
        f"false alarm every {1.0 / (SEVERAL * hourly):.2g} h"
    )


def run_length_text(one: RunLength) -> str:
    """Return a run length with its standard error, where it has one."""
    return f"{one.points:.4g}" if not one.standard_error else f"{one.points:.3g} ± {one.standard_error:.1g}"


def chart_place(started: Sequence[str], runs: Sequence[str], point: int) -> str:
    """Return which subgroup a point is: its number, and when and by which run it was completed."""
    return f"subgroup {point} (run {runs[point - 1]}, {started[point - 1][:16].replace('T', ' ')} UTC)"


def print_trend(  # noqa: PLR0917 - what is asked for
    data: Path, lot: Lot, metric: str, by: str, part: tuple[str | None, str | None], level: float, *, as_json: bool
) -> int:
    """Print a metric by groups; return 0. Raises as `trend_of`."""
    with production(data) as look:
        found = trend_of(look, lot, metric, by, side=part[0], branch=part[1], level=level)
        notes = lot_note(look, lot)
    one, unit = found.compared, found.metric.unit
    rows = [
        (group.name, str(group.number), figure(group.mean, unit), f"{_ends(group.low, group.high)}",
         figure(group.sd, unit, 3), "" if group.low <= one.mean <= group.high else "differs")
        for group in one.groups
    ]  # fmt: skip
    blocks: list[str | Grid] = [
        f"{found.metric.name} side {found.side} by {by}: mean of all {figure(one.mean, unit)}",
        Grid((by, "n", "mean", f"{level:.0%} interval", "standard deviation", ""), rows, right=(1, 2, 3, 4)),
    ]
    blocks.append(
        f"standard deviation within one {by}: {figure(one.sd_within, unit, 3)}; between groups: "
        f"{figure(one.sd_between, unit, 3)} ({percent(one.share_between)} of the variance). Probability that the "
        f"groups differ by chance alone: {one.p_same:.2g}"
    )
    notes += _meanings([(found.metric.name, found.other_meanings)])
    return _say(found, blocks, notes, as_json=as_json)


def print_type_one(  # noqa: PLR0917 - what is asked for
    data: Path, part: Part, reference: float, tolerance: float | None, share: float, level: float, *, as_json: bool
) -> int:
    """Print a type 1 study; return 0, or 1 for a gage that is not capable. Raises as `type_one_of`."""
    with production(data) as look:
        found = type_one_of(look, part, reference, tolerance, share / 100.0, level)
        notes = left_out_of(look, Lot(bench=part.bench, virtual=part.virtual), part.serial)
    _say(found, type_one_blocks(found, share, level), notes, as_json=as_json)
    return 0 if found.study.capable else NOT_SO


def type_one_blocks(found: TypeOneFigure, share: float, level: float) -> list[str | Grid]:
    """Return a type 1 study for a person; share of the tolerance in %."""
    part, one, unit = found.part, found.study, found.series.metric.unit
    rows = [
        ("tolerance", figure(one.tolerance, unit), found.tolerance_from),
        ("reference", figure(one.reference, unit), ""),
        ("mean", figure(one.mean, unit), f"{one.measurements} measurements"),
        ("bias", figure(one.bias, unit, 3), f"p of none {one.p_no_bias:.2g}"),
        ("standard deviation", figure(one.sd, unit, 3), ""),
        ("Cg", figure(one.cg, "", 3), f"{_ends(one.cg_low, one.cg_high)} with {level:.0%} confidence"),
        ("Cgk", figure(one.cgk, "", 3), f"{_ends(one.cgk_low, one.cgk_high)} with {level:.0%} confidence"),
        ("resolution", figure(one.resolution, unit, 3), f"{percent(one.resolution_share)} of the tolerance"),
    ]
    blocks: list[str | Grid] = [
        f"{part.serial}: {found.series.metric.name} side {found.series.side}, {share:g} % of the tolerance over 6 σ",
        Grid(("", "", ""), rows, right=(1,)),
        f"{'CAPABLE' if one.capable else 'NOT CAPABLE'}: Cg and Cgk of {CAPABLE} or more are needed",
        f"smallest tolerance that this bench can measure so: {figure(one.least_tolerance, unit, 3)}",
    ]
    blocks += [f"The worse side. Side {side} has Cgk {figure(cgk, '', 3)}" for side, cgk in found.others]
    few = f"usually {USUAL} measurements are made; these are {one.measurements}"
    blocks += [few] if one.measurements < USUAL else []
    blocks += ["readings are resolved too coarsely: more than 5 % of the tolerance"] if not one.fine_enough else []
    return blocks + (["VIRTUAL: units of the virtual bench"] if part.virtual else [])
