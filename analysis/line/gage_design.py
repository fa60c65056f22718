"""A gage study as a table: every operator measures every part the same number of times."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.line.samples import checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

COLUMNS = ("operator", "trial", "part", "value")


@dataclass(frozen=True)
class GageDesign:
    """Measurements as an array (part, operator, trial), with the names of parts and operators."""

    values: FloatArray
    parts: tuple[str, ...]
    operators: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check shape and numbers; AnalysisError for fewer than 2 parts, operators or trials."""
        values = np.asarray(self.values, dtype=np.float64)
        if values.ndim != 3 or min(values.shape) < 2:
            raise AnalysisError(
                f"gage study: found {' × '.join(str(n) for n in values.shape)} (parts × operators × trials); "
                "expected 2 or more of each"
            )
        if (len(self.parts), len(self.operators)) != values.shape[:2]:
            raise AnalysisError(
                f"gage study: {len(self.parts)} names of parts and {len(self.operators)} of operators for an array of "
                f"{values.shape[0]} × {values.shape[1]}; name each one"
            )
        checked_row(values.ravel(), "gage study", 8)
        object.__setattr__(self, "values", values)


def gage_design(operator: Sequence[str], part: Sequence[str], value: Sequence[float]) -> GageDesign:
    """Arrange measurements in any order to a balanced design.

    Raises AnalysisError when rows differ in number, or naming the part and operator that were measured more or less
    often than the others.
    """
    if not len(operator) == len(part) == len(value):
        raise AnalysisError(
            f"gage study: {len(operator)} operators, {len(part)} parts, {len(value)} values; "
            "expected one of each per row"
        )
    cells: dict[tuple[str, str], list[float]] = {}
    for who, which, measured in zip(operator, part, value, strict=True):
        cells.setdefault((which, who), []).append(measured)
    parts, operators = tuple(dict.fromkeys(part)), tuple(dict.fromkeys(operator))
    trials = max((len(cell) for cell in cells.values()), default=0)
    for which in parts:
        for who in operators:
            found = len(cells.get((which, who), []))
            if found != trials:
                raise AnalysisError(
                    f"gage study: part {which} was measured {found} times by operator {who}, others {trials} times; "
                    "complete the study"
                )
    table = np.array([[cells[which, who] for who in operators] for which in parts], dtype=np.float64)
    return GageDesign(table, parts, operators)


def read_gage_study(path: Path | str) -> GageDesign:
    """Read a CSV with the columns operator, part and value (others are left alone).

    Raises AnalysisError naming the file, and row and column of what is missing or no number.
    """
    file = Path(path)
    try:
        with file.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream, restkey="", restval=""))
    except (OSError, UnicodeError, csv.Error) as error:
        raise AnalysisError(f"{file}: cannot be read: {error}; expected a CSV with {', '.join(COLUMNS)}") from error
    missing = [name for name in ("operator", "part", "value") if not rows or name not in rows[0]]
    if missing:
        raise AnalysisError(f"{file}: no rows with column {', '.join(missing)}; expected {', '.join(COLUMNS)}")
    values = []
    for number, row in enumerate(rows, start=1):
        try:
            values.append(float(row["value"]))
        except ValueError as error:
            raise AnalysisError(
                f"{file}: row {number}, column value: found '{row['value']}'; expected a number"
            ) from error
    try:
        return gage_design([row["operator"] for row in rows], [row["part"] for row in rows], values)
    except AnalysisError as error:
        raise AnalysisError(f"{file}: {error}") from error
