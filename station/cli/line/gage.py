"""`lostmotion gage`: a gage study of a CSV file, of stored runs, or of runs that a CSV file lists."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from analysis.line.gage_study import (
    AverageRange,
    GageDesign,
    GageStudy,
    Interval,
    analyse_average_range,
    analyse_gage_study,
    gage_design,
)
from station.cli.csv_columns import read_csv_columns
from station.cli.line.line_statistics import Side, Values, figure, worse_side
from station.cli.line.stored_metric import Ask, StoredValue
from station.cli.line.stored_values import FromRuns, StoredValues, values_of_sides
from station.cli.say import Grid, say
from station.documents.entries import alongside
from station.errors import StationError

BY = ("day", "bench", "operator")
"""What can stand for the operator: an automatic bench has none, unless the runs name one."""

NO_SPREAD = "The gage cannot be judged: all repeats of a part are identical. Check for copied or rounded rows"

SPREADS = {
    "sd_repeatability": "repeatability (EV)",
    "sd_reproducibility": "reproducibility (AV)",
    "sd_gage": "gage (GRR)",
    "sd_part": "parts (PV)",
    "sd_total": "total (TV)",
}
"""Standard deviations of a study and their names in the hand method."""

GOOD_PCT, FAIR_PCT = 10.0, 30.0
LEAST_NDC = 5
"""AIAG: below 10 % good, up to 30 % for some uses, of total spread and tolerance; five categories or more."""


@dataclass(frozen=True, kw_only=True)
class PrintedGage:
    """What `gage --json` prints: where the values come from, the design, and both ways of evaluation."""

    file: str | None
    source: FromRuns | None = alongside()
    parts: tuple[str, ...]
    operators: tuple[str, ...]
    trials: int
    tolerance: float | None
    level: float
    anova: GageStudy
    average_range: AverageRange


def gage(
    file: Path | None, ask: Ask | None, data: Path, by: str, study: tuple[float | None, float], *, as_json: bool
) -> int:
    """Print the study by analysis of variance and by average and range; return 0.

    Args:
        file: CSV file of the study, or None.
        ask: metric of stored runs, or None.
        data: their folder.
        by: what stands for the operator, one of `BY`.
        study: tolerance (None: that of the recipe) and level of confidence.
        as_json: one JSON object instead of text.

    Raises:
        StationError, AnalysisError: bad input, or a study that is not complete.

    """
    given, level = study
    if by not in BY:
        raise StationError(f"--by: found {by!r}; allowed are {', '.join(BY)}")
    if file is None and ask is None:
        raise StationError("give a CSV FILE with the columns operator, part and value, or --metric ID for stored runs")
    if file is not None:
        found = _listed(file, ask, data)
    else:
        found = [(_of_runs(one, by), one) for one in _values_of_all_runs(data, ask or Ask(""))]
    sides = [_studied(design, stored, given, level) for design, stored in found]
    values, (design, tolerance, anova, ranges), of_sides = worse_side(sides)
    stored, unit = values.stored, values.unit
    document = PrintedGage(
        file=None if file is None else str(file),
        source=None if stored is None else stored.head(),
        parts=design.parts,
        operators=design.operators,
        trials=design.values.shape[2],
        tolerance=tolerance,
        level=level,
        anova=anova,
        average_range=ranges,
    )
    blocks = gage_blocks(design, anova, ranges, unit, level)
    return say(document, [*blocks, *of_sides, *values.notes()], as_json=as_json)


def judged_study(
    data: Path, ask: Ask, by: str, only: Collection[str], level: float = 0.95
) -> tuple[GageDesign, GageStudy]:
    """Return the study of stored runs on the side that judges, with the tolerance of their recipe; only: their ids.

    Raises:
        StationError, AnalysisError: `by` is none of `BY`, or the design is not complete.

    """
    if by not in BY:
        raise StationError(f"--by: found {by!r}; allowed are {', '.join(BY)}")
    sides = [_studied(_of_runs(one, by), one, None, level) for one in values_of_sides(data, ask, only)]
    _, (design, _, anova, _), _ = worse_side(sides)
    return design, anova


def _values_of_all_runs(data: Path, ask: Ask) -> tuple[StoredValues, ...]:
    """Return the values of all runs; those of guided studies are measured for nothing else."""
    return values_of_sides(data, dataclasses.replace(ask, studies=True))


Study = tuple[GageDesign, float | None, GageStudy, AverageRange]


def _studied(design: GageDesign, stored: StoredValues | None, given: float | None, level: float) -> Side[Study]:
    tolerance = _tolerance(given, stored)
    anova = analyse_gage_study(design, tolerance, level)
    ranges = analyse_average_range(design, tolerance, level)
    name, unit = ("", "") if stored is None else (stored.name, stored.unit)
    values = Values(name, unit, [], None, stored)
    return Side(values, (design, tolerance, anova, ranges), anova.worse_pct, anova.shares)


def _listed(file: Path, ask: Ask | None, data: Path) -> list[tuple[GageDesign, StoredValues | None]]:
    """Return the study of a CSV file; where it names runs instead of values, these are looked up, of each side."""
    table = read_csv_columns(file)
    operators, parts = table.texts("operator"), table.texts("part")
    if "value" in table.columns:
        return [(gage_design(operators, parts, table.numbers("value")), None)]
    if "run" not in table.columns or ask is None:
        raise StationError(
            f"{file}: found columns {', '.join(table.columns)}; expected operator, part and value, or operator, part "
            "and run with --metric ID"
        )
    names = table.texts("run")
    asked = values_of_sides(data, ask, names)
    return [_of_listed(file, operators, parts, names, one) for one in asked]


def _of_listed(
    file: Path, operators: list[str], parts: list[str], names: list[str], stored: StoredValues
) -> tuple[GageDesign, StoredValues]:
    by_run = {one.run_id: one for one in stored.values}
    rows = []
    for row, name in enumerate(names, start=1):
        if name not in by_run:
            raise StationError(
                f"{file}: row {row}, column run: found '{name:.60}'; no stored run with this id has a value of "
                f"{stored.name}. Correct the id"
            )
        rows.append(by_run[name])
    twice = next((name for name, count in Counter(one.run_id for one in rows).items() if count > 1), None)
    if twice:
        raise StationError(f"{file}: column run: run {twice} is listed more than once. Keep one row for each run")
    design = gage_design(operators, parts, [one.value for one in rows])
    return design, dataclasses.replace(stored, values=rows, left_out=Counter())


def _of_runs(stored: StoredValues, by: str) -> GageDesign:
    def operator(one: StoredValue) -> str:
        return {"day": one.started.date().isoformat(), "bench": one.bench, "operator": one.operator}[by]

    nobody = [one.run_id for one in stored.values if by == "operator" and not one.operator]
    if nobody:
        raise StationError(
            f"gage study: {len(nobody)} of {len(stored.values)} runs name no operator, for example run {nobody[0]}. "
            "Measure with 'lostmotion run --operator NAME', or list the runs in a CSV file with the columns operator, "
            "part, run"
        )
    names = [operator(one) for one in stored.values]
    if len(set(names)) < 2:
        raise StationError(
            f"gage study: all runs have the same {by} ({names[0]}); expected two or more operators, days or benches. "
            f"Measure with another {by}, or list the runs in a CSV file with the columns operator, part and run"
        )
    return gage_design(names, [one.serial for one in stored.values], [one.value for one in stored.values])


def _tolerance(given: float | None, stored: StoredValues | None) -> float | None:
    if given is not None or stored is None:
        return given
    low, high = stored.limits.min, stored.limits.max
    return None if low is None or high is None else high - low


def _interval(one: Interval, unit: str, digits: int = 4) -> tuple[str, str]:
    return figure(one.value, unit, digits), f"{figure(one.low, '', 3)} … {figure(one.high, '', 3)}"


def gage_blocks(
    design: GageDesign, anova: GageStudy, ranges: AverageRange, unit: str, level: float
) -> list[str | Grid]:
    """Return a gage study for a person, by variance and by average and range."""
    parts, operators, trials = design.values.shape
    rows: list[tuple[str, ...]] = []
    for key, name in SPREADS.items():
        rows.append((name, *_interval(getattr(anova, key), unit), *_interval(getattr(ranges, key), unit)))
    rows.append(("gage, % of total", *_interval(anova.grr_pct, "%"), *_interval(ranges.grr_pct, "%")))
    if anova.tolerance_pct is not None:
        rows.append(
            ("gage, % of tolerance", figure(anova.tolerance_pct, "%", 4), "", figure(ranges.tolerance_pct, "%", 4), "")
        )
    rows.append(("distinct categories (ndc)", str(anova.ndc), "", str(ranges.ndc), ""))
    sources = [
        (name, f"{row.sum_of_squares:.6g}", str(row.freedom), f"{row.mean_square:.4g}")
        for name, row in (("part", anova.part), ("operator", anova.operator), ("part × operator", anova.interaction),
                          ("repeatability", anova.repeatability))
    ]  # fmt: skip
    pooled = "pooled with the repeatability" if anova.pooled else "kept apart"
    share = anova.worse_pct
    words = "good" if share < GOOD_PCT else "fit for some uses" if share <= FAIR_PCT else "not fit"
    few = "" if anova.ndc >= LEAST_NDC else f", and tells {anova.ndc} groups of parts apart; {LEAST_NDC} are needed"
    interval = f"{level:.0%} interval"
    spread = bool((design.values.max(axis=2) > design.values.min(axis=2)).any())
    return [
        f"{parts} parts × {operators} operators × {trials} trials",
        Grid(("source", "sum of squares", "freedom", "mean square"), sources, right=(1, 2, 3)),
        f"interaction: p = {anova.p_interaction:.3g}, {pooled}",
        Grid(("", "by variance", interval, "by range", interval), rows, right=(1, 3)),
        f"The gage is {words} by AIAG: {anova.shares}{few}" if spread else NO_SPREAD,
    ]
