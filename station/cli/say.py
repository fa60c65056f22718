"""What a statistic says: one JSON object for a program, plain tables for a person."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from station.documents.entries import plain
from station.plain_text import with_known_signs
from station.reports.result_view import result_console

GAP = 2

NARROWEST = 24
"""Characters that a column of text keeps where it is folded: in fewer, a sentence cannot be read."""


@dataclass(frozen=True)
class Grid:
    """A table for a person: heads and rows of text; columns whose number is in `right` are numbers, at the right.

    Nothing is ever cut, and no number is folded, for a part of a number is another number.
    """

    heads: Sequence[str]
    rows: Iterable[Sequence[str]]
    right: Sequence[int] = ()


def say(document: object, blocks: Sequence[str | Grid], *, as_json: bool) -> int:
    """Print the document, a class or plain data, as one line of JSON, or the blocks; return 0.

    Infinite numbers are null in JSON.
    """
    if as_json:
        sys.stdout.write(json.dumps(finite(plain(document)), ensure_ascii=False, allow_nan=False) + "\n")
        return 0
    console = result_console()
    for block in blocks:
        if isinstance(block, str):
            console.print(block, highlight=False, markup=False)
        else:
            print_grid(console, block)
    return 0


def print_grid(console: Console, grid: Grid) -> None:
    """Print a table: on a terminal within its width, into a file or a pipe as wide as it needs.

    What is too wide is folded between words: on a terminal columns of text and the heads of numbers, into a file the
    last column if it is text, so that a row stays one line. On a terminal that is too narrow for that, a row is a
    paragraph.
    """
    heads, *rows = ([with_known_signs(cell, console.encoding) for cell in row] for row in (grid.heads, *grid.rows))
    columns = list(zip(heads, *rows, strict=True))
    widest = [max(_line_width(cell) for cell in cells) for cells in columns]
    least = [
        _least_width(cells, is_number=number in grid.right)
        if console.is_terminal or (number == len(columns) - 1 and number not in grid.right)
        else widest[number]
        for number, cells in enumerate(columns)
    ]
    widths = _folded(widest, least, console.width - GAP * (len(columns) - 1))
    needed = sum(widths) + GAP * (len(columns) - 1)
    if console.is_terminal and needed > console.width:
        for row in rows:
            _print_paragraph(console, heads, row)
        return
    table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False, header_style="dim")
    for number, (head, width) in enumerate(zip(heads, widths, strict=True)):
        table.add_column(Text(head), justify="right" if number in grid.right else "left", width=width, overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    of_console = console.width
    console.width = max(of_console, needed)
    console.print(table)
    console.width = of_console


def _line_width(cell: str) -> int:
    return max(map(cell_len, cell.splitlines()), default=0)


def _word_width(cell: str) -> int:
    return max(map(cell_len, cell.split()), default=0)


def _least_width(cells: Sequence[str], *, is_number: bool) -> int:
    """Return the width to which a column, its head first, may be folded: no word is ever broken."""
    if is_number:
        return max([_word_width(cells[0]), *map(_line_width, cells[1:])])
    return max(*map(_word_width, cells), min(NARROWEST, max(map(_line_width, cells))))


def _folded(widest: Sequence[int], least: Sequence[int], room: int) -> list[int]:
    """Return the widths of columns that fit into the room, as far as they may be folded: always the widest first."""
    widths = list(widest)
    while sum(widths) > room:
        foldable = [number for number, width in enumerate(widths) if width > least[number]]
        if not foldable:
            break
        widths[max(foldable, key=widths.__getitem__)] -= 1
    return widths


def _print_paragraph(console: Console, heads: Sequence[str], row: Sequence[str]) -> None:
    """Print a row as its first cell and, below it, as many others side by side as fit, each behind its head."""
    cells = [(f"{head}: " if head else "", cell) for head, cell in zip(heads, row, strict=True) if cell]
    said = [Text.assemble((head, "dim"), cell) for head, cell in cells] or [Text()]
    console.print(said[0], soft_wrap=True)
    room = console.width - GAP
    lines: list[Text] = []
    for one in said[1:]:
        if lines and lines[-1].cell_len + one.cell_len + 2 <= room:
            lines[-1].append("; ").append(one)
        else:
            lines += one.wrap(console, max(room, _word_width(one.plain)))
    for line in lines:
        console.print(Text(" " * GAP).append(line), soft_wrap=True)


def finite(value: Any) -> Any:
    """Return plain data with infinities and NaN as None: JSON has no other way to say that there is no number."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
