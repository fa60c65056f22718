"""Reference pages of what programs and people call: every option of the command line, the REST interface, the files of a record."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from docs.markdown import NOTE, table
from docs.schemas import FILES, schema_of
from station.cli import COMMANDS, command_line

BODY = "application/json"
ANCHOR = {"session": "entry and session", "actions": "every change"}
"""What people call the parts of the REST interface whose own names say little."""
VALUES: dict[Any, str] = {int: "N", float: "X"}
"""What stands for the value of an option that names none."""


def command_options() -> str:
    """The page of every command with its arguments and options, read off the command line itself."""
    commands: Any = command_line()
    text = (
        "# Every option of the command line\n\n"
        + NOTE
        + "\nWhat the commands are for: [the command line](command-line.md).\n"
    )
    for heading, names in COMMANDS.items():
        text += f"\n## {heading}\n"
        for name in names:
            for words, command in _leaves(f"lostmotion {name}", commands.commands[name]):
                text += f"\n### {words}\n\n{_paragraph(command.help)}\n"
                rows = list(_parameters(command))
                text += "\n" + table(("argument or option", "meaning", "default"), rows) if rows else ""
    return text


def _leaves(words: str, command: Any) -> Iterator[tuple[str, Any]]:
    if hasattr(command, "commands"):
        for name, one in command.commands.items():
            yield from _leaves(f"{words} {name}", one)
    else:
        yield words, command


def _paragraph(text: str | None) -> str:
    return " ".join((text or "").replace("\b", "").split())


def _parameters(command: Any) -> Iterator[tuple[str, str, str]]:
    for one in command.params:
        if one.name == "help" or getattr(one, "hidden", False):
            continue
        if one.param_type_name == "argument":
            shown = (one.metavar or one.name.upper()) + ("..." if one.nargs == -1 else "")
            shown = shown if one.required or shown.startswith("[") else f"[{shown}]"
        else:
            value = (
                "" if one.is_flag else f" {one.metavar or VALUES.get(one.type_descriptor.annotation, one.name.upper())}"
            )
            shown = ", ".join([*one.opts, *one.secondary_opts]) + value
        yield f"`{shown}`", _paragraph(one.help), _default(one)


def _default(one: Any) -> str:
    if one.required:
        return "required"
    if one.default in {None, False, ""} or one.default == () or callable(one.default) or getattr(one, "is_flag", False):
        return ""
    return f"`{one.default}`" if isinstance(one.default, (str, int, float, Path)) else ""


def rest() -> str:
    """The page of the REST interface, made from the document that a station serves at /api/openapi.json."""
    document = _openapi()
    paths = [(method, path, row) for path, rows in document["paths"].items() for method, row in rows.items()]
    parts: dict[str, list[tuple[str, str, dict[str, Any]]]] = {}
    for method, path, row in paths:
        parts.setdefault(row["tags"][0], []).append((method, path, row))
    text = (
        "# The REST interface\n\n"
        + NOTE
        + "\nHow a request proves who it is from, and what a refusal looks like: [the station](station.md#rest)."
        " A running station serves the same as OpenAPI at `/api/openapi.json`. Entries in brackets may be left out.\n"
    )
    for part, rows in parts.items():
        text += f"\n## {ANCHOR.get(part, part).capitalize()}\n\n"
        may = any(_who_may(path) for _, path, _ in rows)
        text += table(
            ("request", "does", "asked with", *(("who may",) if may else ()), "answers"),
            (
                (
                    f"`{method.upper()} {path}`",
                    row["summary"],
                    _asked_with(row, document),
                    *((_who_may(path),) if may else ()),
                    ", ".join(sorted(row["responses"])),
                )
                for method, path, row in rows
            ),
        )
    return text


def _who_may(path: str) -> str:
    """Return the roles that may do an action; a reading says it by its answers."""
    from station.web.actions.table import ACTIONS  # noqa: PLC0415

    action = ACTIONS.get(path.removeprefix("/api/actions/"))
    return "" if action is None else ", ".join(sorted(action.roles))


def _openapi() -> dict[str, Any]:
    """Return the document of a station that has no runs."""
    from station.web.models import load_models  # noqa: PLC0415 - the pages of the other tables do without
    from station.web.people.database import StationDatabase  # noqa: PLC0415
    from station.web.rest.app import rest_of  # noqa: PLC0415
    from station.web.running import Running  # noqa: PLC0415
    from station.web.station import Station  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as kept:
        data = Path(kept)
        station = Station(data, StationDatabase(data), load_models(data, None), Running(data))
        with closing(station):
            found: dict[str, Any] = rest_of(station, secure=False).openapi()
    return found


def _asked_with(row: dict[str, Any], document: dict[str, Any]) -> str:
    """Return the entries of a request, those that may be left out in brackets."""
    asked = [
        (one["name"], one.get("required", False)) for one in row.get("parameters", ()) if one["in"] in {"query", "path"}
    ]
    body = row.get("requestBody", {}).get("content", {}).get(BODY, {}).get("schema", {})
    body = document["components"]["schemas"][body["$ref"].rsplit("/", 1)[1]] if "$ref" in body else body
    asked += [(name, name in body.get("required", ())) for name in body.get("properties", {})]
    return ", ".join(f"`{name}`" if needed else f"[`{name}`]" for name, needed in asked)


def record_files() -> str:
    """The page of the files of a record that programs read, made from their JSON Schemas."""
    text = (
        "# The files of a record, entry by entry\n\n"
        + NOTE
        + "\nWhat the files are: [Records](records.md). The schemas themselves, for a program:"
        " "
        + ", ".join(f"[{file}](schema/{file})" for file in FILES)
        + ". *Always* says that the entry stands in every file, of whichever"
        " version.\n"
    )
    for file in FILES:
        schema = json.loads(schema_of(file))
        text += f"\n## {file}\n\n{_paragraph(schema.get('description'))}\n\n{_entries(schema)}"
        for name, one in schema.get("$defs", {}).items():
            text += (
                f"\n### {name} in {file}\n\n{_paragraph(one.get('description'))}\n\n{_entries(one)}"
                if "properties" in one
                else ""
            )
    return text


def _entries(schema: dict[str, Any]) -> str:
    required = schema.get("required", ())
    return table(
        ("entry", "kind", "always", "what it is"),
        (
            (f"`{name}`", _kind(one), "yes" if name in required else "", _paragraph(one.get("description")))
            for name, one in schema["properties"].items()
        ),
    )


def _kind(one: dict[str, Any]) -> str:
    """Return the kind of an entry in words."""
    if "$ref" in one:
        return str(one["$ref"]).rsplit("/", 1)[1]
    if "anyOf" in one:
        return " or ".join(dict.fromkeys(_kind(member) for member in one["anyOf"]))
    if "enum" in one or "const" in one:
        return ", ".join(f"`{value}`" for value in one.get("enum", [one.get("const")]))
    kind = one.get("type", "anything")
    if kind == "array":
        return f"list of {_kind(one['items'])}" if isinstance(one.get("items"), dict) and one["items"] else "list"
    if kind == "object" and isinstance(one.get("additionalProperties"), dict):
        return f"{_kind(one['additionalProperties'])} by name"
    return {"integer": "whole number", "string": "text", "boolean": "true or false"}.get(kind, str(kind))
