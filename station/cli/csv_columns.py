"""CSV files of the statistics: named columns, checked so that an error names row and column."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from recipes import open_regular
from station.errors import StationError

LARGEST = 1e12
"""Larger magnitudes are refused: squares of it still are finite, and nothing on a bench reaches it."""

MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class CsvColumns:
    """A table of text by column name; rows count from 1 after the header, as in all messages."""

    file: Path
    columns: dict[str, list[str]]

    def texts(self, name: str) -> list[str]:
        """Return a column as text; StationError when it is not there or a cell is empty."""
        if name not in self.columns:
            raise StationError(
                f"{self.file}: column {name} is missing; found are {', '.join(self.columns)}. Add it, or name another"
            )
        cells = self.columns[name]
        for row, cell in enumerate(cells, start=1):
            if not cell:
                raise StationError(f"{self.file}: row {row}, column {name}: is empty; fill it, or remove the row")
        return cells

    def numbers(self, name: str) -> list[float]:
        """Return a column as finite numbers; StationError naming row and column of the first that is none."""
        return [self._number(cell, row, name) for row, cell in enumerate(self.texts(name), start=1)]

    def numeric(self) -> list[str]:
        """Return the names of the columns whose first cell is a number."""
        return [name for name, cells in self.columns.items() if _is_number(cells[0])]

    def _number(self, cell: str, row: int, name: str) -> float:
        if not _is_number(cell) or not abs(float(cell)) <= LARGEST:
            raise StationError(
                f"{self.file}: row {row}, column {name}: found '{cell:.40}'; expected a finite number with a point, "
                f"within ±{LARGEST:g}; repair it, or remove the row"
            )
        return float(cell)


def _is_number(cell: str) -> bool:
    try:
        return "_" not in cell and not math.isnan(float(cell))
    except ValueError:
        return False


def read_csv_columns(file: Path) -> CsvColumns:
    """Read a CSV file with a header row and commas.

    Raises StationError when it cannot be read, has no rows, names a column twice or not at all, or a row has more or
    fewer cells than the header.
    """
    try:
        with io.TextIOWrapper(open_regular(file), encoding="utf-8-sig", newline="") as stream:
            rows = [[cell.strip() for cell in row] for row in csv.reader(stream, strict=True) if row]
    except (OSError, UnicodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise StationError(f"{file}: cannot be read: {reason}; expected a CSV file with a header row") from error
    header, cells = (rows[0], rows[1:]) if rows else ([], [])
    if not cells or len(cells) > MOST_ROWS:
        raise StationError(f"{file}: has {len(cells)} rows below its header; expected 1 to {MOST_ROWS}")
    twice = [name for name in header if not name or header.count(name) > 1]
    if twice:
        raise StationError(f"{file}: the header has '{twice[0]}' more than once, or without a name; name each column")
    for number, row in enumerate(cells, start=1):
        if len(row) != len(header):
            raise StationError(
                f"{file}: row {number}: has {len(row)} cells, the header has {len(header)}; commas separate columns, "
                "points stand in numbers"
            )
    return CsvColumns(file, {name: [row[place] for row in cells] for place, name in enumerate(header)})
