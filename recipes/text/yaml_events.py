"""A stream of YAML events into plain data with marks: nothing is built from a hostile file.

Every duplicated name is found. Anchors and aliases (a short file can expand to gigabytes), tags and several documents
are refused, depth is bounded. Scalars follow YAML 1.2: `yes` and `on` are texts, `true` is not.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from ruamel.yaml import YAML
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

from recipes.text.document import Mark, OptionPath, dotted
from recipes.text.problems import Problem, excerpt

DEEPEST_NESTING = 16
LONGEST_NUMBER = 40
"""Characters of a number; longer ones stay text."""

SECOND = "(second)"
"""Stands in option paths for the contents of a duplicated name."""


@dataclass
class _Frame:
    """An open section or list while the events run through."""

    option: OptionPath
    content: dict[str, Any] | list[Any]
    name: str | None = None
    name_mark: tuple[int, int] = (1, 1)
    repeated: bool = False
    names_seen: dict[str, int] = field(default_factory=dict)


class Builder:
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
