"""YAML text, from a file or from bytes, into a document; what is no text or no YAML is told by its place."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.reader import ReaderError

from recipes.text.document import Source
from recipes.text.problems import Problem, RecipeError, excerpt
from recipes.text.regular_file import open_regular
from recipes.text.yaml_events import Builder

LARGEST_FILE = 128 * 1024
"""Bytes; the longest shipped document has 6 kB."""

KEPT_DOCUMENTS = 64
"""Parsed documents that are kept: all that are shipped, and those of a few runs."""

YAML_HINTS = (
    ("'\\t' that cannot start", "Indent with spaces, not with tabs."),
    ("mapping values are not allowed", "Check the indentation, and put a text that holds ': ' in quotes."),
    ("could not find expected ':'", "Every line of a section is 'name: value'; check the line above as well."),
    ("expected <block end>", "Lines of one section begin in the same column; check the indentation."),
    ("expected ',' or", "Close the bracket or put a comma between the entries; check the line above as well."),
    ("end of stream", "The file ends too early: close the quote or bracket."),
    ("unexpected end", "The file ends too early: close the quote or bracket."),
    ("that cannot start any token", "Put a text that begins with this character in quotes."),
)
"""Part of the parser's message, and what to do about it."""


def read_source(path: str | Path) -> Source:
    """Read a document from a file. Raises RecipeError when it cannot be opened or is no YAML."""
    return parse_source(read_bytes(path), str(path))


def read_bytes(path: str | Path) -> bytes:
    """Read a document's bytes, no more than one past the largest allowed. Raises RecipeError when it cannot be read."""
    shown = str(path)
    try:
        with open_regular(path) as file:
            return file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise _whole_file(shown, "no such file", "the path of an existing file", "Check the path.") from None
    except IsADirectoryError:
        raise _whole_file(shown, "a folder", "the path of a file", "Name a file in this folder.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        message = f"a file that cannot be read ({reason})"
        raise _whole_file(excerpt(shown)[1:-1], message, "a readable file", "Check its path and rights.") from None


def parse_source(raw: bytes, path: str) -> Source:
    """Parse the bytes of a document; `path` is the name that messages use. What comes back is read and never changed.

    The same sound bytes are parsed once: to choose a bench every shipped one is looked at, and each run has copies.

    Raises RecipeError when the bytes are no UTF-8 text, no YAML, or empty. What can be reported together with the
    problems of the content (duplicated names) is in `Source.problems` instead.
    """
    sound = _sound_source(raw)
    return _parsed(raw, path) if sound is None else replace(sound, path=path)


@lru_cache(maxsize=KEPT_DOCUMENTS)
def _sound_source(raw: bytes) -> Source | None:
    """Return a document about which there is nothing to say, None for any other."""
    try:
        source = _parsed(raw, "")
    except RecipeError:
        return None
    return None if source.problems else source


def _parsed(raw: bytes, path: str) -> Source:
    if len(raw) > LARGEST_FILE:
        found = f"more than {LARGEST_FILE // 1024} kB"
        raise _whole_file(path, found, f"at most {LARGEST_FILE // 1024} kB", "Is this the right file?")
    text = _decoded(raw, path)
    builder = Builder(path)
    yaml = YAML(typ="safe", pure=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            builder.build(yaml.parse(text), yaml)
    except MarkedYAMLError as error:
        raise RecipeError([*builder.problems, _syntax_problem(error, path)]) from None
    except ReaderError as error:
        line, column = _line_and_column(text[: error.position])
        found = f"the control character U+{int(error.character):04X}"
        problem = Problem(path, line, column, "", found, "printable text", "Delete this character.")
        raise RecipeError([problem]) from None
    except (YAMLError, ValueError, TypeError, LookupError, AttributeError, AssertionError, ArithmeticError):
        # The parser fails in many ways on bytes that are no YAML at all; none of them helps the reader.
        raise _whole_file(path, "text that is no YAML", "a YAML document", "Is this the right file?") from None
    if builder.root is None and not builder.problems:
        raise _whole_file(path, "an empty file", "a YAML document", "Copy a shipped file and edit it.")
    return Source(path, builder.root, builder.marks, tuple(builder.problems), builder.complete)


def _whole_file(path: str, found: str, allowed: str, hint: str) -> RecipeError:
    return RecipeError([Problem(path, 1, 1, "", found, allowed, hint)])


def _decoded(raw: bytes, path: str) -> str:
    """Return the text of UTF-8 bytes, without a byte order mark."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = _line_and_column(raw[: error.start].decode("utf-8", errors="replace"))
        byte = raw[error.start]
        if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            found = "a file in UTF-16"
        else:
            meant = bytes([byte]).decode("cp1252", errors="replace")
            found = f"the byte 0x{byte:02X}, which is no UTF-8 (it is '{meant}' in Windows-1252)"
        problem = Problem(path, line, column, "", found, "text in UTF-8", "Save the file with the encoding UTF-8.")
        raise RecipeError([problem]) from None


def _line_and_column(before: str) -> tuple[int, int]:
    """Return the place behind a text, counted from 1."""
    lines = before.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return len(lines), len(lines[-1]) + 1


def _syntax_problem(error: MarkedYAMLError, path: str) -> Problem:
    mark = error.problem_mark or error.context_mark
    message = " ".join(str(error.problem or error.context or "a syntax error").split())
    hints = (hint for part, hint in YAML_HINTS if part in message)
    hint = next(hints, "Check this line and the one above it.")
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    return Problem(path, line, column, "", f"broken YAML: {message.removeprefix('found ')}", "YAML", hint)
