"""What a statistic says: one JSON object for a program, plain tables for a person."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from station.documents.entries import plain
from station.reports.result_view import result_console


@dataclass(frozen=True)
class Grid:
    """A table for a person: heads and rows of text; columns whose number is in `right` stand to the right.

    Where it is too wide, the last column wraps and others are cut; `folded`: none is cut.
    """

    heads: Sequence[str]
    rows: Iterable[Sequence[str]]
    right: Sequence[int] = ()
    folded: bool = False


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
            _print_grid(console, block)
    return 0


def _print_grid(console: Console, grid: Grid) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for number, head in enumerate(grid.heads):
        last = number == len(grid.heads) - 1
        justify: Literal["left", "right"] = "right" if number in grid.right else "left"
        table.add_column(Text(head), justify=justify, no_wrap=not (last or grid.folded), overflow="fold")
    for row in grid.rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)


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
