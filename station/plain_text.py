"""Output on terminals and pipes that do not know all our signs: near equivalents instead of a crash."""

from __future__ import annotations

import codecs
import sys
from typing import TextIO

HANDLER = "lostmotion.plain"

PLAIN_SIGNS: dict[str, str] = {
    "·": ".",
    "′": "'",
    "−": "-",
    "–": "-",
    "±": "+/-",
    "×": "x",
    "≤": "<=",
    "≥": ">=",
    "µ": "u",
    "°": " deg",
    "…": "...",
    "→": "->",
    "▲": "!",
    "◀": "<-",
    "┤": "|",
    "└": "+",
    "─": "-",
    "━": "-",
    "│": "|",
    "┬": "+",
}
"""What stands for a sign that an encoding lacks; every other one becomes a question mark."""


def _replace(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN_SIGNS.get(sign, "?") for sign in error.object[error.start : error.end]), error.end


codecs.register_error(HANDLER, _replace)


def with_known_signs(text: str, encoding: str) -> str:
    """Return a text as an encoding can say it: what is laid out in columns is as wide then as what is written."""
    return text.encode(encoding, HANDLER).decode(encoding)


def never_crash() -> None:
    """Let standard output and standard error replace what their encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors=HANDLER)


def knows_braille(stream: TextIO) -> bool:
    """Whether plots may be drawn with braille characters."""
    try:
        "⣿".encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
