"""Options of a recipe changed in its text: all else stays as it was written, comments, order and line ends too."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from definitions.metrics import METRICS
from recipes.schema.sequence_schema import STAGES
from recipes.text.problems import OptionPath, RecipeError, Source, dotted, excerpt
from recipes.text.splice import spliced
from recipes.text.yaml_source import parse_source

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
LIMITS = ("min", "max")
LOAD_STAGES = range(STAGES["calibrate"], STAGES["unload"] + 1)


class Field(NamedTuple):
    """An option that a form shows: where it stands, what it is called, the text of its value; '' where it has none."""

    option: OptionPath
    name: str
    value: str


class Group(NamedTuple):
    """Options that belong together: of a metric, or of a step."""

    title: str
    fields: tuple[Field, ...]


def limits_of(source: Source) -> list[Group]:
    """Return the limits of each metric that a recipe asks for itself, whether it has them or not."""
    entries = source.data.get("metrics") if isinstance(source.data, dict) else None
    groups = []
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        if not isinstance(entry, dict) or str(entry.get("id")) not in METRICS:
            continue
        row = METRICS[str(entry["id"])]
        choices = [f"{name} {value}" for name, value in entry.items() if name not in ("id", *LIMITS)]
        title = ", ".join([row.title, *choices])
        fields = (Field(("metrics", index, name), name, _written(entry.get(name))) for name in LIMITS)
        groups.append(Group(title, tuple(fields)))
    return groups


def load_of(source: Source) -> list[Group]:
    """Return the options of each step that loads the unit, as far as they are written."""
    entries = source.data.get("sequence") if isinstance(source.data, dict) else None
    groups = []
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        kind, options = next(iter(entry.items())) if isinstance(entry, dict) and entry else ("", None)
        if not isinstance(options, dict) or STAGES.get(kind) not in LOAD_STAGES:
            continue
        fields = (
            Field(("sequence", index, kind, name), name, _written(value))
            for name, value in options.items()
            if isinstance(value, str | int | float)
        )
        groups.append(Group(f"{index + 1}. {kind}", tuple(fields)))
    return groups


def changed(content: bytes, option: OptionPath, value: str) -> bytes:
    """Return the text of a recipe with another value of an option; '' takes the option out. Raises as `all_changed`."""
    return all_changed(content, [(option, value)])


def all_changed(content: bytes, changes: Sequence[tuple[OptionPath, str]]) -> bytes:
    """Return the text of a recipe with other values of options, one after the other; '' takes an option out.

    Raises:
        RecipeError: the text is no YAML or has a name twice, has no section of an option, a value is none, or the text
            is so written that the option cannot be changed alone.

    """
    mark = BYTE_ORDER_MARK if content.startswith(BYTE_ORDER_MARK) else b""
    for option, value in changes:
        content = _changed(content, option, value.strip())
    return mark + content.removeprefix(mark)


def _changed(content: bytes, option: OptionPath, value: str) -> bytes:
    source = parse_source(content, "recipe")
    if source.problems:  # of a name that is there twice, nobody can say which one is meant
        raise RecipeError(source.problems)
    wanted = _copy(source.data)
    section, name = wanted, option[-1]
    for part in option[:-1]:
        section = section[part] if _has(section, part) else None
    if not isinstance(section, dict):
        raise RecipeError([source.problem(option, f"no {dotted(option[:-1])}", "a section with this option")])
    if value and value == _written(section.get(name)):
        return content
    if value:
        section[name] = _read(source, option, value)
    else:
        section.pop(name, None)
    for writing in _writings(section.get(name), value):
        text = spliced(content.decode("utf-8-sig"), option, writing)
        if text is not None and _says(text.encode(), wanted):
            return text.encode()
    found = "a text in which this option cannot be changed without its surroundings"
    raise RecipeError([source.problem(option, found, "a change of the text by hand", "Change it in the text.")])


def _writings(value: Any, text: str) -> Iterator[str]:
    """Yield how a value can be written, the plainest first; `text` is what somebody has typed."""
    if not isinstance(value, str):
        yield text.partition(" #")[0].strip()
        return
    yield value
    yield json.dumps(value, ensure_ascii=False)


def _says(content: bytes, wanted: Any) -> bool:
    try:
        source = parse_source(content, "recipe")
    except RecipeError:
        return False
    return not source.problems and repr(source.data) == repr(wanted)  # 1 is not 1.0 here, and order counts


def _copy(data: Any) -> Any:
    if isinstance(data, dict):
        return {name: _copy(value) for name, value in data.items()}
    return [_copy(value) for value in data] if isinstance(data, list) else data


def _has(section: Any, part: str | int) -> bool:
    if isinstance(part, int):
        return isinstance(section, list) and part < len(section)
    return isinstance(section, dict) and part in section


def _read(source: Source, option: OptionPath, text: str) -> Any:
    """Return a value as it stands in YAML: a number as a number, anything else as text."""
    try:
        value = parse_source(text.encode(), "value").data
    except RecipeError:
        value = None
    if not isinstance(value, str | int | float) or "\n" in text:
        hint = "Write it as in '1 arcmin' or '110 %'."
        raise RecipeError([source.problem(option, excerpt(text), "one value", hint)])
    return value


def _written(value: object) -> str:
    return "" if value is None else str(value)
