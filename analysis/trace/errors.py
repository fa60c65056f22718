"""The exception of this package, and its kind for files, which carries the place of what is wrong.

AnalysisError
    What cannot be read, is missing, or cannot be evaluated. Its text says what, where, what was found, what is needed
    and what to do next.
TableError
    The same of a file that holds a table, with file, line, row, column, what was found, what is allowed and a hint as
    fields: for programs, which should not take a text apart.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class AnalysisError(Exception):
    """A trace, a method or a wanted metric that cannot be worked with, in words for the person who asked."""


class TableProblem(NamedTuple):
    """What is wrong in the file of a table; None for what does not apply.

    row: counted from 1 after the header, without comments and the row of units. line: of the file, as an editor shows
    it. column: its name.
    """

    path: str
    found: str
    allowed: str
    hint: str
    row: int | None = None
    line: int | None = None
    column: str | None = None
    option: str = ""

    def __str__(self) -> str:
        beyond = None if self.row is None or self.line is None or self.line == self.row + 1 else self.line
        row = None if self.row is None else f"row {self.row}" + (f" (line {beyond})" if beyond else "")
        line = f"line {self.line}" if self.row is None and self.line is not None else None
        column = None if self.column is None else f"column {self.column}"
        place = ", ".join(part for part in (row, line, column) if part)
        where = f"{self.path}: {place}" if place else self.path
        return f"{where}: found {self.found}; expected {self.allowed}; {self.hint}"


class TableError(AnalysisError):
    """A file that holds no table that can be read, or a value in it; `problems` has the place of it."""

    def __init__(
        self,
        path: Path | str,
        found: str,
        allowed: str,
        hint: str,
        *,
        row: int | None = None,
        line: int | None = None,
        column: str | None = None,
    ) -> None:
        problem = TableProblem(str(path), found, allowed, hint, row, line, column)
        self.problems: tuple[TableProblem, ...] = (problem,)
        super().__init__(str(problem))
