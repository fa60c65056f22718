"""What is wrong with a file: each problem with its place, what was found, what is allowed, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, order=True, slots=True)
class Problem:
    """One thing wrong in a file; `line` and `column` count from 1, 0 when the problem has no place inside the file."""

    path: str
    line: int
    column: int
    option: str
    found: str
    allowed: str
    hint: str = ""

    def __str__(self) -> str:
        place = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        subject = f"{self.option}: " if self.option else ""
        text = f"{place}: {subject}{self.found}"
        if self.allowed:
            text += f"; allowed: {self.allowed}"
        return f"{text}. {self.hint}" if self.hint else text


class RecipeError(Exception):
    """A recipe, bench or other document is refused; `problems` holds all that was found, in the order of the file."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(sorted(problems))
        super().__init__("\n".join(str(problem) for problem in self.problems))


def nearest(name: str, valid: Iterable[str]) -> str:
    """'Did you mean ...?' with the most similar valid name, or '' when none is near."""
    match = difflib.get_close_matches(name.lower(), list(valid), n=1, cutoff=0.6)
    return f"Did you mean '{match[0]}'?" if match else ""
