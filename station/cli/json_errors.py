"""Bad input as one JSON object, for programs: the same problems that standard error tells in words."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass

PLACE = re.compile(r"^(?P<option>--[a-z-]+): found (?P<found>.*?); allowed (?:are |is )?(?P<allowed>.*)$", re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class InputProblem:
    """One problem with the input; None for what the error does not say by itself.

    row: of a table, from 1 below its header. column: of a table its name, of another text its position.
    """

    file: str | None = None
    line: int | None = None
    row: int | None = None
    column: int | str | None = None
    option: str | None = None
    found: str
    allowed: str | None = None
    hint: str | None = None


def errors_of(error: BaseException) -> list[InputProblem]:
    """Return the problems of an error."""
    problems = getattr(error, "problems", None)
    if problems:
        return [
            InputProblem(
                file=problem.path or None,
                line=problem.line or None,
                row=getattr(problem, "row", None),
                column=problem.column or None,
                option=problem.option or None,
                found=problem.found,
                allowed=problem.allowed or None,
                hint=problem.hint or None,
            )
            for problem in problems
        ]
    message = getattr(error, "format_message", error.__str__)()
    named = PLACE.match(str(message))
    if named is None:
        return [InputProblem(found=str(message))]
    return [InputProblem(option=named["option"], found=named["found"], allowed=named["allowed"])]


def errors_json(error: BaseException) -> str:
    """Return the JSON object, one line with its end."""
    return json.dumps({"errors": [asdict(one) for one in errors_of(error)]}, ensure_ascii=False) + "\n"
