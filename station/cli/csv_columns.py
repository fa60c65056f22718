"""CSV files of the statistics: named columns, checked so that an error names row and column.

Separators, decimal signs and encodings are read as those of traces are (`analysis.trace.csv_table`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.trace.csv_table import CsvTable, read_csv_table
from analysis.trace.errors import TableError
from analysis.trace.number_text import looks_like_number, read_numbers
from recipes import open_regular

LARGEST = 1e12
"""Larger magnitudes are refused: squares of it still are finite, and nothing on a bench reaches it."""

MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class CsvColumns:
    """A table of text by column name; rows count from 1 after the header, as in all messages."""

    file: Path
    table: CsvTable

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, in their order."""
        return self.table.names

    def texts(self, name: str) -> list[str]:
        """Return a column as text; TableError when it is not there or a cell is empty."""
        if name not in self.columns:
            found = f"columns {', '.join(self.columns)}"
            raise TableError(self.file, found, f"a column {name}", "add the column, or name another one", column=name)
        cells = [str(cell).strip() for cell in self.table.column(name).to_pylist()]
        for row, cell in enumerate(cells, start=1):
            if not cell:
                raise self._fault(row, name, "an empty cell", "a value", "fill the cell, or remove the row")
        return cells

    def numbers(self, name: str) -> list[float]:
        """Return a column as finite numbers; TableError naming row and column of the first that is none."""
        self.texts(name)
        read = read_numbers({name: self.table.column(name)}, self._fault, by_comma=self.table.separator == ",")
        values = read.columns[name]
        bad = ~(np.abs(values) <= LARGEST)
        if bad.any():
            row = int(np.argmax(bad)) + 1
            found = repr(str(self.table.column(name)[row - 1].as_py())[:40])
            raise self._fault(
                row, name, found, f"a finite number within ±{LARGEST:g}", "correct the value, or remove the row"
            )
        return [float(value) for value in values]

    def numeric(self) -> list[str]:
        """Return the names of the columns whose first cell is a number."""
        return [name for name in self.columns if looks_like_number(self.table.column(name)[0].as_py())]

    def _fault(self, row: int, column: str, found: str, allowed: str, hint: str) -> TableError:
        line = self.table.line_of(row)
        return TableError(self.file, found, allowed, hint, row=row, line=line, column=column)


def read_csv_columns(file: Path) -> CsvColumns:
    """Read a CSV file with a header row.

    Raises TableError when it cannot be read, has no rows, names a column twice or not at all, or a row has more or
    fewer cells than the header.
    """
    try:
        with open_regular(file) as stream:
            table = read_csv_table(file, content=stream.read())
    except (OSError, ValueError) as error:
        reason = f"a file that cannot be read ({getattr(error, 'strerror', None) or error})"
        raise TableError(file, reason, "a CSV file with a header row", "name another file") from error
    rows = table.cells.num_rows
    if not 0 < rows <= MOST_ROWS:
        raise TableError(file, f"{rows} rows below the header", f"1 to {MOST_ROWS}", "add rows, or name another file")
    twice = [name for name in table.names if not name or table.names.count(name) > 1]
    if twice:
        raise TableError(
            file,
            f"'{twice[0]}' more than once, or a column without name",
            "a different name for each column",
            "rename the columns",
        )
    return CsvColumns(file, table)
