"""Which lines of a text file are rows of units, and that they say one thing.

Below the header words where numbers are expected can be nothing else. Above it, and in comments, stands what a recorder
says of itself, so that a line there is a row of units only where its own cells show it: `Shift;A` or `Min;Max;Mean` are
none, though A and min are units.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import combinations, zip_longest
from pathlib import Path
from typing import NamedTuple

from analysis.trace.errors import TableError
from analysis.trace.unit_words import QUANTITIES, Kind, contradicts, kind_of, same_unit

NO_WORD = re.compile(r"\d|nan|inf|[#_]|^[+-]?[.,]$")
"""What a cell has, in small letters, that is no word below a header: it may be a number that is spoilt."""

CONVERT = "convert the column to that unit"


class UnitRow(NamedTuple):
    """A row of units: its line in the file, 0 where a file states them otherwise, and its cells."""

    line: int
    cells: tuple[str, ...]


def is_row_of_units(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Whether the cells of a line show that it is a row of units.

    They do where one is surely of the quantity of its column, or may be and stands with another one in brackets, and
    units stand over more than half of the columns that have one, or over half of them with a wrong one among these, or
    in all cells over such columns that are filled. Without such a cell all cells of the line must be units, each of
    the quantity of its column: a letter, or a word with another meaning, may be anything.
    """
    if len(cells) == 1 < len(names):  # text that nothing parts
        return False
    kinds = [(name in QUANTITIES, kind_of(cell, name)) for name, cell in zip_longest(names, cells, fillvalue="")]
    over = [kind for ours, kind in kinds if ours]
    filled = [kind for kind in over if kind not in (Kind.EMPTY, Kind.LABEL)]
    units = [kind for kind in filled if kind is not Kind.WORD]
    if Kind.SURE in filled or {Kind.FITS, Kind.BRACKETS} <= set(filled):
        pairs = zip(names, cells, strict=False)
        wrong = any(kind_of(cell, name) is Kind.SURE and contradicts(cell, name) for name, cell in pairs)
        return len(units) == len(filled) or 2 * len(units) + wrong > len(over)
    elsewhere = [kind for ours, kind in kinds if not ours]
    return set(over) <= {Kind.EMPTY, Kind.FITS} and Kind.FITS in over and not {Kind.WORD, Kind.LABEL} & set(elsewhere)


def is_below_header(first: Sequence[str], second: Sequence[str], names: Sequence[str]) -> bool:
    """Whether the first row behind the header is one of units: words alone, or units where the second row has none.

    Rows in which every number has its unit are data, and refused as such.
    """
    ours = [cell for name, cell in zip(names, first, strict=False) if name in QUANTITIES and cell]
    words = bool(ours) and not any(NO_WORD.search(cell.lower()) for cell in ours)
    silent = (Kind.WORD, Kind.EMPTY)
    data = all(kind_of(cell, name) in silent for name, cell in zip(names, second, strict=False) if name in QUANTITIES)
    return words or (data and is_row_of_units(first, names))


def check_agree(file: Path, names: Sequence[str], rows: Sequence[UnitRow]) -> None:
    """Refuse rows of units that say different units for a column: which of them is meant, nobody can tell.

    Raises TableError with line and column.
    """
    for one, other in combinations(rows, 2):
        for name, first, second in zip(names, one.cells, other.cells, strict=False):
            if name in QUANTITIES and not same_unit(first, second, name):
                found = f"the unit '{second}', where line {one.line} has '{first}'"
                hint = f"delete the one of lines {one.line} and {other.line} that is wrong or is no row of units"
                raise TableError(file, found, "the same unit in all rows of units", hint, line=other.line, column=name)


def check_units(file: Path, names: Sequence[str], rows: Sequence[UnitRow]) -> None:
    """Refuse a unit, in a row of units or stated by the file otherwise, that is not the one in the column's name.

    Raises TableError with line and column.
    """
    for line, cells in rows:
        hint = CONVERT if not line else f"{CONVERT}, or delete this line if it is no row of units"
        wrong = [(name, cell) for name, cell in zip(names, cells, strict=False) if contradicts(cell, name)]
        if wrong:
            # what is surely a unit comes before a word that may be none
            name, cell = min(wrong, key=lambda one: kind_of(one[1], one[0]) is Kind.WORD)
            allowed = QUANTITIES[name].shown
            raise TableError(file, f"the unit '{cell}'", allowed, hint, line=line or None, column=name)
