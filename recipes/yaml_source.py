"""YAML text into plain data with the line and column of every name and value.

YAML is read as a stream of events, so that every duplicated name is found and nothing is built from a hostile file:
anchors and aliases (a short file can expand to gigabytes), tags and several documents are refused, size and depth are
bounded. Scalars follow YAML 1.2: `yes` and `on` are texts, `true` is not.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.reader import ReaderError

from recipes.problems import Problem, RecipeError, excerpt

LARGEST_FILE = 128 * 1024
"""Bytes; the longest shipped document has 6 kB."""
DEEPEST_NESTING = 16
LONGEST_NUMBER = 40
"""Characters of a number; longer ones stay text."""

SECOND = "(second)"
"""Stands in option paths for the contents of a duplicated name."""

OptionPath = tuple[str | int, ...]

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


def read_source(path: str | Path) -> Source:
    """Read a document from a file. Raises RecipeError when it cannot be opened or is no YAML."""
    return parse_source(read_bytes(path), str(path))


def read_bytes(path: str | Path) -> bytes:
    """Read a document's bytes, no more than one past the largest allowed. Raises RecipeError when it cannot be read."""
    shown = str(path)
    try:
        with Path(path).open("rb") as file:
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
    """Parse the bytes of a document; `path` is the name that messages use.

    Raises RecipeError when the bytes are no UTF-8 text, no YAML, or empty. What can be reported together with the
    problems of the content (duplicated names) is in `Source.problems` instead.
    """
    if len(raw) > LARGEST_FILE:
        found = f"more than {LARGEST_FILE // 1024} kB"
        raise _whole_file(path, found, f"at most {LARGEST_FILE // 1024} kB", "Is this the right file?")
    text = _decoded(raw, path)
    builder = _Builder(path)
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


@dataclass
class _Frame:
    """An open section or list while the events run through."""

    option: OptionPath
    content: dict[str, Any] | list[Any]
    name: str | None = None
    name_mark: tuple[int, int] = (1, 1)
    repeated: bool = False
    names_seen: dict[str, int] = field(default_factory=dict)


class _Builder:
    """Builds plain data from YAML events, with marks, and collects what is wrong with the form."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.root: Any = None
        self.marks: dict[OptionPath, Mark] = {}
        self.problems: list[Problem] = []
        self.complete = True
        self._stack: list[_Frame] = []
        self._documents = 0

    def build(self, events: Iterator[Event], yaml: YAML) -> None:
        """Consume the events of one document; stops at the first thing that makes the rest meaningless."""
        for event in events:
            match event:
                case DocumentStartEvent():
                    self._documents += 1
                    if self._documents > 1:
                        self._refuse(event, "a second document ('---')", "one document per file", "Split the file.")
                        return
                case MappingStartEvent() | SequenceStartEvent():
                    self._check_decoration(event)
                    if len(self._stack) >= DEEPEST_NESTING:
                        allowed = f"at most {DEEPEST_NESTING} levels of sections"
                        self._refuse(event, "sections nested too deep", allowed, "Is this the right file?")
                        return
                    self._open(event)
                case MappingEndEvent() | SequenceEndEvent():
                    self._stack.pop()
                case AliasEvent():
                    self._refuse(event, "an alias ('*')", "plain values", "Write the value out.")
                    self._value(None, event)
                case ScalarEvent():
                    self._check_decoration(event)
                    self._scalar(event, yaml)

    def _scalar(self, event: ScalarEvent, yaml: YAML) -> None:
        frame = self._stack[-1] if self._stack else None
        if frame is not None and isinstance(frame.content, dict) and frame.name is None:
            self._name(frame, event)
        else:
            self._value(_plain_value(event, yaml), event)

    def _name(self, frame: _Frame, event: ScalarEvent) -> None:
        name = str(event.value)
        line, column = _start(event)
        if name in frame.names_seen:
            first = frame.names_seen[name]
            found = f"'{name}' a second time (first in line {first})"
            self._add(
                (line, column), (*frame.option, name), found, "every name once in a section", "Delete one of the two."
            )
        frame.repeated = name in frame.names_seen
        frame.names_seen.setdefault(name, line)
        frame.name, frame.name_mark = name, (line, column)

    def _open(self, event: MappingStartEvent | SequenceStartEvent) -> None:
        content: dict[str, Any] | list[Any] = {} if isinstance(event, MappingStartEvent) else []
        frame = self._stack[-1] if self._stack else None
        if frame is not None and isinstance(frame.content, dict) and frame.name is None:
            self._refuse(event, "a list or section as a name", "a word as a name", "Write 'name: value'.")
            frame.name, frame.name_mark = excerpt(None), _start(event)
            self._stack.append(_Frame((*frame.option, "?"), content))
            return
        option = self._value(content, event)
        self._stack.append(_Frame(option, content))

    def _value(self, value: Any, event: Event) -> OptionPath:
        """Store a value in the open section or list; return its option path."""
        line, column = _start(event)
        if not self._stack:
            self.root = value
            self.marks[()] = Mark(line, column, line, column)
            return ()
        frame = self._stack[-1]
        if isinstance(frame.content, list):
            option: OptionPath = (*frame.option, len(frame.content))
            frame.content.append(value)
            self.marks[option] = Mark(line, column, line, column)
            return option
        name, frame.name = frame.name or "", None
        if frame.repeated:  # the first one counts; what is inside a later one must not move its places
            return (*frame.option, name, SECOND)
        option = (*frame.option, name)
        empty = value is None and not getattr(event, "value", "")
        self.marks[option] = Mark(*(frame.name_mark if empty else (line, column)), *frame.name_mark)
        frame.content[name] = value
        return option

    def _check_decoration(self, event: ScalarEvent | MappingStartEvent | SequenceStartEvent) -> None:
        if event.anchor is not None:
            self._refuse(
                event, f"an anchor ('&{event.anchor}')", "plain values", "Write the value out where it is used."
            )
        if getattr(event, "tag", None) is not None:
            self._refuse(event, f"a tag ({excerpt(str(event.tag))})", "plain values", "Delete the tag.")

    def _refuse(self, event: Event, found: str, allowed: str, hint: str) -> None:
        self.complete = False
        option = self._stack[-1].option if self._stack else ()
        self._add(_start(event), option, found, allowed, hint)

    def _add(self, place: tuple[int, int], option: OptionPath, found: str, allowed: str, hint: str) -> None:
        self.problems.append(Problem(self.path, *place, dotted(option), found, allowed, hint))


def _start(event: Event) -> tuple[int, int]:
    mark = event.start_mark
    return (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)


def _plain_value(event: ScalarEvent, yaml: YAML) -> Any:
    """Return a scalar as None, bool, int, float or text by the core rules of YAML 1.2."""
    text = str(event.value).encode("utf-8", errors="replace").decode()  # lone surrogates from escapes
    if event.style is not None or len(text) > LONGEST_NUMBER:
        return text
    tag = str(yaml.resolver.resolve(ScalarNode, text, (True, False))).rpartition(":")[2]
    match tag:
        case "null":
            return None
        case "bool":
            return text.lower() == "true"
        case "int":
            digits = text.replace("_", "").lower()
            plain = re.fullmatch(r"[+-]?\d+", digits)
            return int(digits, 10) if plain else int(digits, 0)
        case "float":
            digits = text.replace("_", "").lower().replace(".inf", "inf").replace(".nan", "nan")
            return float(digits)
        case _:
            return text
