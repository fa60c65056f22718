"""Options of a recipe changed in its text: everything else stays as it was written, comments and order too."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from definitions.metrics import METRICS
from recipes.schema.sequence_schema import STAGES
from recipes.text.problems import OptionPath, RecipeError, Source, dotted, excerpt
from recipes.text.yaml_source import parse_source

NO_WRAPPING = 1 << 20
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
    """Return the text of a recipe with other values of options, read and written once; '' takes an option out.

    Raises:
        RecipeError: the text is no YAML, has no section of an option, or a value is none.

    """
    source = parse_source(content, "recipe")
    if not source.complete:
        raise RecipeError(source.problems)
    yaml, whole = _round_trip(content)
    for option, value in changes:
        _change(whole, source, option, value.strip())
    out = io.StringIO()
    yaml.dump(whole, out)
    return out.getvalue().encode()


def _change(whole: Any, source: Source, option: OptionPath, value: str) -> None:
    section = whole
    for part in option[:-1]:
        section = section[part] if _has(section, part) else None
    if not isinstance(section, dict):
        raise RecipeError([source.problem(option, f"no {dotted(option[:-1])}", "a section with this option")])
    name = option[-1]
    if value:
        section[name] = _read(source, option, value)
    else:
        section.pop(name, None)


def _has(section: Any, part: str | int) -> bool:
    if isinstance(part, int):
        return isinstance(section, list) and part < len(section)
    return isinstance(section, dict) and part in section


def _round_trip(content: bytes) -> tuple[YAML, Any]:
    """Return a reader that writes as it has read, and what it has read."""
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = NO_WRAPPING
    text = content.decode("utf-8-sig")
    indented = any(line.startswith((" ", "\t")) and line.lstrip().startswith("- ") for line in text.splitlines())
    yaml.indent(mapping=2, sequence=4 if indented else 2, offset=2 if indented else 0)
    return yaml, yaml.load(text)


def _read(source: Source, option: OptionPath, text: str) -> Any:
    """Return a value as it stands in YAML: a number as a number, anything else as text."""
    try:
        value = YAML().load(text)
    except YAMLError:
        value = None
    if not isinstance(value, str | int | float) or "\n" in text:
        hint = "Write it as in '1 arcmin' or '110 %'."
        raise RecipeError([source.problem(option, excerpt(text), "one value", hint)])
    return value


def _written(value: object) -> str:
    return "" if value is None else str(value)
