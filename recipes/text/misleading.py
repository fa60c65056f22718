"""Signs that make a text look other than it is read, comments included: nobody can check such a file by reading it.

Quantities, choices and names of options refuse them by themselves; in a comment or a free text nothing else does.
Those that turn the direction of writing were never accepted; the others are refused in what somebody writes, and not in
the copies of records, which open as ever.
"""

from __future__ import annotations

import re
from typing import NamedTuple

WITHOUT = "text without such characters"
LINE_ENDS = "lines that end with U+000A, or with U+000D U+000A"
RETYPE = "Delete it; where a line shall end, press Enter."

KINDS = (
    ("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]", "which turns the direction of writing", WITHOUT, "Delete it."),
    # For YAML they end a line, and with it a comment; most editors show them inside the line, or not at all.
    ("[\x85\u2028\u2029]|\r(?!\n)", "which ends a line for some programs and not for others", LINE_ENDS, RETYPE),
    # Behind one of them '#' begins no comment, and two names that look the same are two.
    ("[\u00ad\u180e\u200b-\u200d\u2060-\u2064\ufeff]", "which no editor shows", WITHOUT, "Delete it."),
)
"""The signs as a pattern; what they do; what is allowed; what to do.

Other line ends of Python's `splitlines` are control characters, which the parser refuses. Blanks such as U+00A0 can be
seen, and the signs that choose the form of an emoji stand behind something that can.
"""


class Misleading(NamedTuple):
    """A sign that misleads: where it stands in the text, counted from 0, and what a message says of it."""

    at: int
    found: str
    allowed: str
    hint: str


PATTERN = re.compile("|".join(f"({signs})" for signs, *_ in KINDS))
IN_RECORDS_TOO = re.compile(f"({KINDS[0][0]})")
"""Of the signs those that no record has."""


def misleading_sign(text: str, *, in_record: bool = False) -> Misleading | None:
    """Return the first sign of a text that makes it look other than it is read; None where there is none.

    in_record: the text may be a copy in a record, in which only `IN_RECORDS_TOO` are refused.
    """
    match = (IN_RECORDS_TOO if in_record else PATTERN).search(text)
    if match is None or match.lastindex is None:
        return None
    _signs, does, allowed, hint = KINDS[match.lastindex - 1]
    return Misleading(match.start(), f"the character U+{ord(match[0]):04X}, {does}", allowed, hint)
