"""One option of a YAML text put in, replaced or taken out; every other character stays as it is written.

A comment, a line end or a quote is nobody's data, so a text that is read and written again loses some of them. Here
the characters of one option change, at the place where the parser has found it. Whether the new text says what it
shall is for the caller to check: it reads it.
"""

from __future__ import annotations

import re

from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from recipes.text.problems import OptionPath

COMMA = re.compile(r"[ \t]*,[ \t]*")
BLOCK = ("|", ">")
"""Styles of a text whose lines have the indentation of the option around them."""


def spliced(text: str, option: OptionPath, written: str) -> str | None:
    """Return the text with an option written as `written`; '' takes it out, one that is not there is added at the end.

    text: sound YAML, as `parse_source` takes it. Returns None where the option has no characters of its own that can
    be exchanged: no section holds it, or a list, a section or a text of several lines with an indentation is its value.
    """
    section = _section(YAML(typ="safe", pure=True).compose(text), option[:-1])
    if section is None:
        return None
    names: list[str] = [key.value for key, _value in section.value]
    if option[-1] not in names:
        return _added(text, section, f"{option[-1]}: {written}") if written else text
    index = names.index(option[-1])
    value: Node = section.value[index][1]
    if not isinstance(value, ScalarNode) or value.style in BLOCK:
        return None
    if not written:
        return _taken_out(text, section, index)
    start, end = _start(value), _end(value)
    if start < end:
        return text[:start] + written + text[end:]
    # Nothing stands behind the colon: for the parser the value is where the next thing begins.
    behind = text.index(":", _end(section.value[index][0])) + 1
    return text[:behind] + " " + written + text[behind:]


def _section(node: Node | None, option: OptionPath) -> MappingNode | None:
    """Return the section that a path leads to, None where it leads to none."""
    for part in option:
        if isinstance(part, int) and isinstance(node, SequenceNode) and part < len(node.value):
            node = node.value[part]
        elif isinstance(node, MappingNode):
            node = next((value for key, value in node.value if key.value == part), None)
        else:
            return None
    return node if isinstance(node, MappingNode) else None


def _added(text: str, section: MappingNode, option: str) -> str | None:
    """Return the text with an option behind the last one of a section."""
    if section.flow_style:
        at = _end(section.value[-1][1]) if section.value else _start(section) + 1
        return text[:at] + (", " if section.value else "") + option + text[at:]
    last = section.value[-1][1]
    while isinstance(last, MappingNode | SequenceNode) and not last.flow_style:
        # A section in lines ends for the parser where the next thing begins, so it is left by its last value.
        last = last.value[-1][1] if isinstance(last, MappingNode) else last.value[-1]
    if isinstance(last, ScalarNode) and last.style in BLOCK:
        return None
    line_end = "\r\n" if "\r\n" in text else "\n"
    at = text.find(line_end, _end(last))
    at = len(text) if at < 0 else at
    indentation = " " * int(section.value[0][0].start_mark.column)
    return text[:at] + line_end + indentation + option + text[at:]


def _taken_out(text: str, section: MappingNode, index: int) -> str:
    """Return the text without an option, with the comment beside it; a line that has nothing else goes too."""
    start, end = _start(section.value[index][0]), _end(section.value[index][1])
    if section.flow_style:
        before = _end(section.value[index - 1][1]) if index else start
        if COMMA.fullmatch(text, before, start):
            start = before
        elif comma := COMMA.match(text, end):
            end = comma.end()
    line, rest = text.rfind("\n", 0, start) + 1, text.find("\n", end) + 1
    rest = rest or len(text)
    if not (text[line:start] + text[end:rest]).strip():
        start, end = line, rest
    return text[:start] + text[end:]


def _start(node: Node) -> int:
    return int(node.start_mark.index)


def _end(node: Node) -> int:
    return int(node.end_mark.index)
