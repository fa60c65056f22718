"""A document as it was read, with the place of every name and value, and what is wrong with it.

A problem says what was found where, what is allowed there, and what to do. `RecipeError` is the only exception of this
package. It carries every problem of a document, so that a file is put right in one go.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, NamedTuple

LONGEST_EXCERPT = 60
"""Characters of a found text that are repeated in a message."""

OptionPath = tuple[str | int, ...]
"""Names and indices from the top of a document to an option."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong in a document; lines and columns count from 1, as editors show them, 0 is no file."""

    path: str
    line: int
    column: int
    option: str
    found: str
    allowed: str
    hint: str = ""

    def __str__(self) -> str:
        return self._said("allowed: ")

    def as_warning(self) -> str:
        """Say what may be meant as it stands, but is not usual."""
        return self._said("usual is ")

    def _said(self, before_allowed: str) -> str:
        option = f" {self.option}:" if self.option else ""
        hint = f". {self.hint}" if self.hint else ""
        where = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        return f"{where}:{option} found {self.found}; {before_allowed}{self.allowed}{hint}"


class RecipeError(Exception):
    """A recipe, bench or other document is refused; `problems` holds all that is wrong with it, sorted by place."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(sorted(set(problems), key=place))
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)

    def __reduce__(self) -> tuple[type[RecipeError], tuple[tuple[Problem, ...]]]:
        return RecipeError, (self.problems,)


def place(problem: Problem) -> tuple[str, int, int, str, str, str]:
    """Sort key of a problem: file, line, column, then option and finding so that the order never varies."""
    return problem.path, problem.line, problem.column, problem.option, problem.found, problem.allowed


def excerpt(value: object) -> str:
    """Return a found value as a message repeats it: text in quotes, long texts cut, structures by their name."""
    match value:
        case None:
            return "nothing"
        case bool():
            return "true" if value else "false"
        case dict():
            return "a section (lines of name: value)" if value else "an empty section"
        case list():
            return "a list" if value else "an empty list"
        case str():
            text = value if len(value) <= LONGEST_EXCERPT else value[: LONGEST_EXCERPT - 3] + "..."
            return "'" + "".join(c if c.isprintable() else "?" for c in text) + "'"
        case _:
            text = str(value)
            return text if len(text) <= LONGEST_EXCERPT else text[: LONGEST_EXCERPT - 3] + "..."


def one_of(names: Sequence[str]) -> str:
    """Return names as a choice: `a, b or c`."""
    names = list(names)
    if len(names) < 2:
        return "".join(names)
    return ", ".join(names[:-1]) + " or " + names[-1]


def nearest(name: str, names: Iterable[str]) -> str | None:
    """Return the valid name that a mistyped one most likely meant, or None; upper and lower case count as equal."""
    by_lower_case = {valid.lower(): valid for valid in names}
    close = get_close_matches(name[:LONGEST_EXCERPT].lower(), by_lower_case, n=1, cutoff=0.6)
    return by_lower_case[close[0]] if close else None


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return the question about the nearest valid name, or an empty text when none is near."""
    valid = nearest(name, names)
    return f"Did you mean '{valid}'?" if valid else ""


class Mark(NamedTuple):
    """Place of a value and of its name, counted from 1; where one of the two is not written, both have the other's."""

    line: int
    column: int
    name_line: int
    name_column: int


NO_VALUE = ("nothing", "a value", "Write it, or delete the option.")
"""What is found, allowed and to be done of an option that is written with nothing behind it."""


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

    def empty_options(self) -> Iterator[OptionPath]:
        """Yield the options that are written with nothing behind them."""
        return _empty(self.data, ())

    def refuse_empty_options(self, empty: Iterable[OptionPath] | None = None) -> None:
        """Raise RecipeError for options with nothing behind them; not for the copies of records, which open as ever.

        empty: those of them that say nothing where they stand; None for all.
        """
        problems = [self.problem(option, *NO_VALUE) for option in (self.empty_options() if empty is None else empty)]
        if problems:
            raise RecipeError(problems)

    def problem(
        self, option: OptionPath, found: str, allowed: str, hint: str = "", *, at_name: bool = False
    ) -> Problem:
        """Return a problem at the value of an option, or at its name."""
        mark = self.nearest_mark(option)
        line, column = (mark.name_line, mark.name_column) if at_name else (mark.line, mark.column)
        return Problem(self.path, line, column, dotted(option), found, allowed, hint)


def _empty(data: Any, place: OptionPath) -> Iterator[OptionPath]:
    inside = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for part, value in inside:
        if value is None:
            yield (*place, part)
        yield from _empty(value, (*place, part))


def dotted(option: OptionPath) -> str:
    """Return an option's path as messages print it: `sequence[2].calibrate.torque_rate`."""
    text = ""
    for part in option:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text
