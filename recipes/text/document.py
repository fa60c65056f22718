"""A document as it was read: plain data, and the line and column of every name and value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from recipes.text.problems import Problem

OptionPath = tuple[str | int, ...]
"""Names and indices from the top of a document to an option."""


class Mark(NamedTuple):
    """Place of a value and of its name, counted from 1; where one of the two is not written, both have the other's."""

    line: int
    column: int
    name_line: int
    name_column: int


@dataclass(frozen=True)
class Source:
    """A read document: plain data, where everything stands, and what is wrong with its form."""

    path: str
    data: Any
    marks: Mapping[OptionPath, Mark]
    problems: tuple[Problem, ...] = ()
    complete: bool = True
    """False when parts were refused, so that the data says nothing about what is missing."""

    def nearest_mark(self, option: OptionPath) -> Mark:
        """Return the place of an option, or of the closest section around it that is in the file."""
        for length in range(len(option), -1, -1):
            mark = self.marks.get(option[:length])
            if mark is not None:
                return mark
        return Mark(1, 1, 1, 1)

    def problem(
        self, option: OptionPath, found: str, allowed: str, hint: str = "", *, at_name: bool = False
    ) -> Problem:
        """Return a problem at the value of an option, or at its name."""
        mark = self.nearest_mark(option)
        line, column = (mark.name_line, mark.name_column) if at_name else (mark.line, mark.column)
        return Problem(self.path, line, column, dotted(option), found, allowed, hint)


def dotted(option: OptionPath) -> str:
    """Return an option's path as messages print it: `sequence[2].calibrate.torque_rate`."""
    text = ""
    for part in option:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text
