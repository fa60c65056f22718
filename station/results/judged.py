"""What the analysis found, as the part of a result that it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.evaluation.pipeline import Result as Found
from analysis.validity.judge import CheckResult
from station.documents.reading import of_plain
from station.documents.result import CheckValue, Judged

PLACE = Path("evaluation")
"""What stands for the file in the error of an analysis whose data are no result: a failure of the program."""


def judged_in(found: Found) -> Judged:
    """Return verdict, reasons, metrics, checks and stages of an evaluation."""
    return of_plain(Judged, found.to_dict(), PLACE)


def check_values(checks: Sequence[CheckResult]) -> tuple[CheckValue, ...]:
    """Return validity checks as they stand in a result."""
    return tuple(of_plain(CheckValue, check.to_dict(), PLACE) for check in checks)
