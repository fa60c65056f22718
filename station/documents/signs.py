r"""What a terminal would obey, written in signs: a text that somebody put into a file moves nobody's cursor.

A serial number that holds ESC or CR could write over the line above it, and FAIL would read PASS. Control characters
are shown as `\x1b`, those that turn the direction of a line as `\u202e`. Line feed and tab stay: messages have them.
"""

from __future__ import annotations

import re
from typing import Any

_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
_PERHAPS = re.compile(rb"\\[bfru]|\x7f|\xc2[\x80-\x9f]|\xe2\x80[\xa8-\xae]|\xe2\x81[\xa6-\xa9]")


def in_signs(text: str) -> str:
    """Return a text with what a terminal would obey written in signs."""
    return _OBEYED.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def may_hold_obeyed(content: bytes) -> bool:
    """Whether texts of this JSON may hold what a terminal would obey; nearly always no, and quickly said."""
    return _PERHAPS.search(content) is not None


def all_in_signs(found: Any) -> Any:
    """Return plain data with each of its texts, and each name of an entry, in signs."""
    if isinstance(found, str):
        return in_signs(found)
    if isinstance(found, list):
        return [all_in_signs(one) for one in found]
    if isinstance(found, dict):
        return {in_signs(name): all_in_signs(one) for name, one in found.items()}
    return found
