"""What the analysis found, as the part of a result that it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from analysis.evaluation.pipeline import Result as Found
from analysis.validity.judge import CheckResult
from recipes import Recipe, Selection, left_out
from station.documents.reading import of_plain
from station.documents.result import CheckValue, Judged

NOT_DECIDABLE = "NOT DECIDABLE"
PLACE = Path("evaluation")
"""What stands for the file in the error of an analysis whose data are no result: a failure of the program."""


def judged_in(found: Found) -> Judged:
    """Return verdict, reasons, metrics, checks and stages of an evaluation."""
    return of_plain(Judged, found.to_dict(), PLACE)


def check_values(checks: Sequence[CheckResult]) -> tuple[CheckValue, ...]:
    """Return validity checks as they stand in a result."""
    return tuple(of_plain(CheckValue, check.to_dict(), PLACE) for check in checks)


def judged_by_selection(judged: Judged, recipe: Recipe, selection: Selection) -> Judged:
    """Return a result; by a choice of metrics that leaves out what the recipe has a limit for, nothing passes."""
    if not selection.made or judged.verdict != "PASS":
        return judged
    left = left_out(recipe, selection)
    if not left:
        return judged
    verb = "leaves" if len(selection.parts) == 1 else "leave"
    said = f"{selection.text} {verb} out metrics that have limits in the recipe: {', '.join(left)}"
    return replace(judged, verdict=NOT_DECIDABLE, reasons=(said, *judged.reasons))
