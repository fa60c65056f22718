"""A small plot in the terminal, drawn with braille characters: two dots by four in each cell."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

BLANK = 0x2800
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bit of each dot by row and column inside a cell."""

NICE_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def nice_ceiling(value: float) -> float:
    """Return the next number not below `value` that reads well on an axis: 1, 2, 2.5 or 5 times a power of ten."""
    if value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in NICE_STEPS if step * power >= value * (1 - 1e-9))


class Canvas:
    """Dots on a grid of braille cells; x and y count dots from the top left."""

    def __init__(self, columns: int, rows: int) -> None:
        self.width, self.height = 2 * columns, 4 * rows
        self._cells = [[0] * columns for _ in range(rows)]

    def dot(self, x: int, y: int) -> None:
        """Set one dot; outside the canvas nothing happens."""
        if 0 <= x < self.width and 0 <= y < self.height:
            self._cells[y // 4][x // 2] |= DOTS[y % 4][x % 2]

    def line(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Draw a straight line between two points given in dots."""
        steps = max(1, math.ceil(max(abs(end[0] - start[0]), abs(end[1] - start[1]))))
        for step in range(steps + 1):
            share = step / steps
            self.dot(round(start[0] + share * (end[0] - start[0])), round(start[1] + share * (end[1] - start[1])))

    def rows(self) -> list[str]:
        """Return the canvas as lines of text."""
        return ["".join(chr(BLANK + cell) for cell in row) for row in self._cells]

    def plain_rows(self) -> list[str]:
        """Return the canvas as lines of ASCII: a cell shows where most of its dots stand."""
        return ["".join(_plain(cell) for cell in row) for row in self._cells]


def _plain(cell: int) -> str:
    upper = sum(bool(cell & bit) for pair in DOTS[:2] for bit in pair)
    lower = sum(bool(cell & bit) for pair in DOTS[2:] for bit in pair)
    if not upper and not lower:
        return " "
    if upper and lower:
        return ":"
    return "'" if upper else "."


def time_ticks(right: float, most: int = 6) -> list[float]:
    """Return round positions from 0 to at most `right`, a few of them."""
    step = nice_ceiling(right / most) if right > 0 else 1.0
    return [number * step for number in range(int(right / step + 1e-9) + 1)]


def plot(
    points: Sequence[tuple[float, float]],
    units: tuple[str, str],
    columns: int = 72,
    rows: int = 11,
    *,
    plain: bool = False,
) -> str:
    """Return a plot of connected points (x from 0 up, y around zero) with its axes labelled; y fits the data.

    Args:
        points: x and y of each corner, x not falling.
        units: of x and y.
        columns: width of the drawing area in characters.
        rows: height of it; odd, so that zero has a row of its own.
        plain: draw with ASCII instead of braille characters.

    """
    top = max((abs(y) for _, y in points), default=1.0) or 1.0
    right = max((x for x, _ in points), default=1.0) or 1.0
    canvas = Canvas(columns, rows)
    middle = (canvas.height - 1) / 2

    def place(point: tuple[float, float]) -> tuple[float, float]:
        return point[0] / right * (canvas.width - 1), middle * (1 - point[1] / top)

    for x in range(0, canvas.width, 4):
        canvas.dot(x, round(middle))
    for start, end in itertools.pairwise(points):
        canvas.line(place(start), place(end))
    labels = {0: f"+{top:.4g}", rows // 2: "0", rows - 1: f"−{top:.4g}"}
    width = max(len(label) for label in (*labels.values(), units[1]))
    drawn = canvas.plain_rows() if plain else canvas.rows()
    lines = [f"{labels.get(number, ''):>{width}} ┤{row}" for number, row in enumerate(drawn)]
    axis, below = ["─"] * columns, [" "] * (columns + 8)
    for tick in time_ticks(right):
        column = round(tick / right * (columns - 1))
        axis[column] = "┬"
        label = f"{tick:g}"
        below[column : column + len(label)] = label
    lines.append(f"{'':>{width}} └{''.join(axis)}")
    lines.append(f"{units[1]:>{width}}  {''.join(below).rstrip()} {units[0]}")
    return "\n".join(lines)
