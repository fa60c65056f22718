"""Bad input as one JSON object, for programs: the same problems that standard error tells in words."""

from __future__ import annotations

import json
import re
from typing import Any

PLACE = re.compile(r"^(?P<option>--[a-z-]+): found (?P<found>.*?); allowed (?:are |is )?(?P<allowed>.*)$", re.DOTALL)
FIELDS = ("file", "line", "column", "option", "found", "allowed", "hint")


def errors_of(error: BaseException) -> list[dict[str, Any]]:
    """Return the problems of an error as rows with the keys `FIELDS`; unknown ones are None."""
    problems = getattr(error, "problems", None)
    if problems:
        return [
            {
                "file": problem.path or None,
                "line": problem.line or None,
                "column": problem.column or None,
                "option": problem.option or None,
                "found": problem.found,
                "allowed": problem.allowed or None,
                "hint": problem.hint or None,
            }
            for problem in problems
        ]
    message = getattr(error, "format_message", error.__str__)()
    row: dict[str, Any] = dict.fromkeys(FIELDS)
    row["found"] = str(message)
    named = PLACE.match(str(message))
    return [row | (named.groupdict() if named else {})]


def errors_json(error: BaseException) -> str:
    """Return the JSON object, one line with its end."""
    return json.dumps({"errors": errors_of(error)}, ensure_ascii=False) + "\n"
