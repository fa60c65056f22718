"""A YAML file as plain data with the place of every key and value, or the problems that keep it from being read.

Stricter than YAML: UTF-8 only, no duplicated keys, no anchors and aliases, one document, bounded in size and depth.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, DocumentStartEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from recipes.problems import Problem, RecipeError

MOST_BYTES = 1_000_000
MOST_DEPTH = 20
Path_ = tuple[str | int, ...]

_INTEGER = re.compile(r"^[+-]?\d+$")
_HEXADECIMAL = re.compile(r"^0x[0-9A-Fa-f]+$")
_FLOAT = re.compile(r"^[+-]?(\d+\.\d*|\.\d+|\d+)([eE][+-]?\d+)?$")
_DATE = re.compile(r"^\d{4}-\d{2}-\d{2}$")
_PLAIN: tuple[tuple[re.Pattern[str], Callable[[str], Any]], ...] = (
    (_INTEGER, int),
    (_HEXADECIMAL, lambda text: int(text, 16)),
    (_FLOAT, float),
    (_DATE, dt.date.fromisoformat),
)
LONGEST_NUMBER = 40
_WORDS: dict[str, Any] = {"true": True, "false": False, "null": None, "~": None, "": None}


@dataclass
class Source:
    """`data` as plain Python; `places` and `key_places` map a path to (line, column), counted from 1."""

    path: str
    text: str
    data: Any = None
    places: dict[Path_, tuple[int, int]] = field(default_factory=dict)
    key_places: dict[Path_, tuple[int, int]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)


def read_source(path: str | Path) -> Source:
    """Read and parse a file; raises `RecipeError` when there is nothing that could be checked further."""
    shown = str(path)
    text = _read_text(Path(path), shown)
    source = Source(shown, text)
    try:
        _refuse_tricks(source)
        node = YAML(typ="rt").compose(text)
    except MarkedYAMLError as error:
        raise RecipeError([_syntax_problem(shown, error)]) from None
    except (YAMLError, RecursionError, ValueError) as error:
        raise RecipeError([Problem(shown, 0, 0, "", f"not readable as YAML: {error}", "one YAML mapping")]) from None
    if node is None:
        found, hint = "the file is empty", "Start from one of the shipped files."
        raise RecipeError([Problem(shown, 0, 0, "", found, "one YAML mapping", hint)])
    source.data = _plain(source, node, (), 0)
    return source


def _read_text(path: Path, shown: str) -> str:
    try:
        with path.open("rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
    except IsADirectoryError:
        raise RecipeError([Problem(shown, 0, 0, "", "this is a folder", "a YAML file")]) from None
    except FileNotFoundError:
        raise RecipeError([Problem(shown, 0, 0, "", "there is no such file", "a YAML file")]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RecipeError([Problem(shown, 0, 0, "", f"cannot be read: {reason}", "a readable YAML file")]) from None
    if len(raw) > MOST_BYTES:
        raise RecipeError([Problem(shown, 0, 0, "", "the file is too large", f"up to {MOST_BYTES} bytes")])
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - (before.rfind(b"\n") + 1) + 1
        found = f"byte 0x{raw[error.start]:02X} is not UTF-8"
        hint = "Save the file with the encoding UTF-8."
        raise RecipeError([Problem(shown, line, column, "", found, "text in UTF-8", hint)]) from None


def _refuse_tricks(source: Source) -> None:
    """Aliases can make a small file huge, and a second document would silently be ignored."""
    documents = depth = 0
    for event in YAML(typ="rt").parse(source.text):
        mark = event.start_mark
        depth += {"SequenceStartEvent": 1, "MappingStartEvent": 1, "SequenceEndEvent": -1, "MappingEndEvent": -1}.get(
            type(event).__name__,
            0,
        )
        found = ""
        if isinstance(event, DocumentStartEvent):
            documents += 1
            found = "a second YAML document" if documents > 1 else ""
        elif isinstance(event, AliasEvent) or getattr(event, "anchor", None) is not None:
            found = "an anchor or alias"
        elif depth > MOST_DEPTH:
            found = f"nested deeper than {MOST_DEPTH} levels"
        if found:
            place = (mark.line + 1, mark.column + 1)
            raise RecipeError([Problem(source.path, *place, "", found, "one plain YAML mapping")])


def _syntax_problem(shown: str, error: MarkedYAMLError) -> Problem:
    mark = error.problem_mark or error.context_mark
    line, column = (mark.line + 1, mark.column + 1) if mark is not None else (0, 0)
    said = (error.problem or "not understood").strip()
    context = f" {error.context.strip()}" if error.context else ""
    hint = "Check indentation, quotes and colons around this place; indent with blanks, not tabs."
    return Problem(shown, line, column, "", f"YAML syntax: {said}{context}", "valid YAML", hint)


def _plain(source: Source, node: Node, path: Path_, depth: int) -> Any:
    source.places[path] = (node.start_mark.line + 1, node.start_mark.column + 1)
    if isinstance(node, MappingNode):
        return _mapping(source, node, path, depth)
    if isinstance(node, SequenceNode):
        return [_plain(source, item, (*path, index), depth + 1) for index, item in enumerate(node.value)]
    assert isinstance(node, ScalarNode)  # noqa: S101 - a composed node has no fourth kind
    return _scalar(node)


def _mapping(source: Source, node: MappingNode, path: Path_, depth: int) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key_node, value_node in node.value:
        line, column = key_node.start_mark.line + 1, key_node.start_mark.column + 1
        option = show_path(path)
        if not isinstance(key_node, ScalarNode):
            source.problems.append(Problem(source.path, line, column, option, "a key that is not a word", "a word"))
            continue
        key = str(key_node.value)
        place = (*path, key)
        if key in result:
            first = source.key_places[place][0]
            found = f"the key '{key}' stands twice (first in line {first})"
            hint = "Remove one of them."
            source.problems.append(Problem(source.path, line, column, show_path(place), found, "each key once", hint))
            continue
        source.key_places[place] = (line, column)
        result[key] = _plain(source, value_node, place, depth + 1)
    return result


def _scalar(node: ScalarNode) -> Any:
    text = str(node.value)
    if node.style in ("'", '"', "|", ">"):
        return text
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    for pattern, convert in _PLAIN:
        if len(text) <= LONGEST_NUMBER and pattern.match(text):
            try:
                return convert(text)
            except ValueError:
                return text  # 2026-02-31 has the form of a date only
    return text


def show_path(path: Path_) -> str:
    """`sequence[2].calibrate.torque_rate` from its parts."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text
