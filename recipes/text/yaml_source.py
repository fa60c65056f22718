"""YAML text, from a file or from bytes, into a document; what is no text or no YAML is told by its place.

Of YAML 1.2 only plain data is taken, and nothing is built from a hostile file: anchors and aliases (a short file can
expand to gigabytes), tags, directives and several documents are refused, depth is bounded, every repeated name is
found. `yes` and `on` are texts, `true` is not.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    StreamEndEvent,
)
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.reader import ReaderError

from recipes.text.misleading import Misleading, misleading_sign
from recipes.text.problems import Mark, OptionPath, Problem, RecipeError, Source, dotted, excerpt
from recipes.text.regular_file import open_regular

LARGEST_FILE = 128 * 1024
"""Bytes; the longest shipped document has 6 kB."""

DEEPEST_NESTING = 16
LONGEST_NUMBER = 40
"""Characters of a number; longer ones stay text."""

CONVERTED = frozenset(f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float"))
"""Scalars that are not text; a date is read by the model that wants one."""

SECOND = "(second)"
"""Stands in option paths for the contents of a repeated name: the first one counts, and keeps its places."""

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


def refuse_misleading(raw: bytes, path: str) -> None:
    """Raise RecipeError for a text that somebody writes and that looks other than it is read; its place is named."""
    text = _decoded(raw, path)
    _refuse(misleading_sign(text), text, path)


def _refuse(sign: Misleading | None, text: str, path: str) -> None:
    if sign is not None:
        line, column = _line_and_column(text[: sign.at])
        raise RecipeError([Problem(path, line, column, "", sign.found, sign.allowed, sign.hint)])


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
    _refuse(misleading_sign(text, in_record=True), text, path)
    reader = _Reader(text, path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            data = reader.document()
    except MarkedYAMLError as error:
        raise RecipeError([*reader.problems, _syntax_problem(error, path)]) from None
    except ReaderError as error:
        line, column = _line_and_column(text[: error.position])
        found = f"the control character U+{int(error.character):04X}"
        problem = Problem(path, line, column, "", found, "printable text", "Delete this character.")
        raise RecipeError([problem]) from None
    except (YAMLError, ValueError, TypeError, LookupError, AttributeError, AssertionError, ArithmeticError):
        # The parser fails in many ways on bytes that are no YAML at all; none of them helps the reader.
        raise _whole_file(path, "text that is not YAML", "a YAML document", "Is this the right file?") from None
    if data is None and not reader.problems:
        raise _whole_file(path, "an empty file", "a YAML document", "Copy a shipped file and edit it.")
    return Source(path, data, reader.marks, tuple(reader.problems), reader.complete)


class _Reader:
    """Reads the parser's events as plain data with marks, and collects what is wrong with the form."""

    def __init__(self, text: str, path: str) -> None:
        self._yaml = YAML(typ="safe", pure=True)
        self._events = self._yaml.parse(text)
        self._path = path
        self.marks: dict[OptionPath, Mark] = {}
        self.problems: list[Problem] = []
        self.complete = True

    def document(self) -> Any:
        """Return the data of the only document, None when there is none."""
        next(self._events)  # the stream begins
        start = next(self._events)
        if isinstance(start, StreamEndEvent):
            return None
        if start.version or start.tags:  # in YAML 1.1 `no` is false and 1:30 is ninety
            self._stop(start, (), "a directive ('%')", "YAML 1.2 without directives", "Delete the lines with '%'.")
        data = self._value(next(self._events), ())
        next(self._events)  # the document ends
        after = next(self._events)
        if not isinstance(after, StreamEndEvent):
            self._stop(after, (), "a second document ('---')", "one document per file", "Split the file.")
        return data

    def _value(self, event: Event, option: OptionPath, name_mark: tuple[int, int] | None = None) -> Any:
        place = _start(event)
        if name_mark and isinstance(event, ScalarEvent) and not event.value and event.style is None:
            place = name_mark  # nothing is written
        self.marks[option] = Mark(*place, *(name_mark or place))
        if isinstance(event, AliasEvent):
            self._refuse(event, option, "an alias ('*')", "Write the value out.")
            return None
        self._check_plain(event, option)
        if isinstance(event, ScalarEvent):
            return self._scalar(event)
        if len(option) >= DEEPEST_NESTING:
            allowed = f"at most {DEEPEST_NESTING} levels of sections"
            self._stop(event, option, "sections nested too deep", allowed, "Is this the right file?")
        return self._section(option) if isinstance(event, MappingStartEvent) else self._list(option)

    def _list(self, option: OptionPath) -> list[Any]:
        entries: list[Any] = []
        while not isinstance(event := next(self._events), SequenceEndEvent):
            entries.append(self._value(event, (*option, len(entries))))
        return entries

    def _section(self, option: OptionPath) -> dict[str, Any]:
        section: dict[str, Any] = {}
        while not isinstance(event := next(self._events), MappingEndEvent):
            if not isinstance(event, ScalarEvent):
                what = "an alias" if isinstance(event, AliasEvent) else "a list or section"
                self._stop(event, option, f"{what} as a name", "a word as a name", "Write 'name: value'.")
            name, place = _text(event), _start(event)
            inside = (*option, name)
            self._check_plain(event, inside)
            if name not in section:
                section[name] = self._value(next(self._events), inside, place)
                continue
            found = f"'{name}' a second time (first in line {self.marks[inside].name_line})"
            self._add(place, inside, found, "every name once in a section", "Delete one of the two.")
            self._value(next(self._events), (*inside, SECOND))
        return section

    def _scalar(self, event: ScalarEvent) -> Any:
        """Return None, bool, int, float or text by the core rules of YAML 1.2."""
        text = _text(event)
        tag = self._yaml.resolver.resolve(ScalarNode, text, (True, False))
        if event.style is not None or len(text) > LONGEST_NUMBER or str(tag) not in CONVERTED:
            return text
        try:
            return self._yaml.constructor.construct_object(ScalarNode(tag, text))
        except ValueError:  # a text such as `-_` has the form of a number
            return text

    def _check_plain(self, event: Any, option: OptionPath) -> None:
        if event.anchor is not None:
            self._refuse(event, option, f"an anchor ('&{event.anchor}')", "Write the value out where it is used.")
        if event.ctag is not None:
            self._refuse(event, option, f"a tag ({excerpt(str(event.ctag))})", "Delete the tag.")

    def _refuse(self, event: Event, option: OptionPath, found: str, hint: str) -> None:
        self.complete = False
        self._add(_start(event), option, found, "plain values", hint)

    def _stop(self, event: Event, option: OptionPath, found: str, allowed: str, hint: str) -> NoReturn:
        """Refuse what makes the rest of the document meaningless."""
        self._add(_start(event), option, found, allowed, hint)
        raise RecipeError(self.problems)

    def _add(self, place: tuple[int, int], option: OptionPath, found: str, allowed: str, hint: str) -> None:
        self.problems.append(Problem(self._path, *place, dotted(option), found, allowed, hint))


def _start(event: Event) -> tuple[int, int]:
    return event.start_mark.line + 1, event.start_mark.column + 1


def _text(event: ScalarEvent) -> str:
    """Return what is written, without the lone surrogates that escapes make and no terminal prints."""
    return str(event.value).encode("utf-8", errors="replace").decode()


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
            found = f"the byte 0x{byte:02X}, which is not UTF-8 (it is '{meant}' in Windows-1252)"
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
