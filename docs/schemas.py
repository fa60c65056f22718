"""JSON Schema of the files that say what a run was and came to, made from the classes that write and read them."""

from __future__ import annotations

import json
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from station.documents.manifest import Manifest
from station.documents.reading import adapter
from station.documents.result import Result
from station.documents.timing import Timing

DIALECT = "https://json-schema.org/draft/2020-12/schema"
FILES: dict[str, type] = {"result.json": Result, "run.json": Manifest, "timing.json": Timing}
"""File of a run's folder, and the class that it is."""

INTEGER, NUMBER = {"type": "integer"}, {"type": "number"}


class WithoutTitles(GenerateJsonSchema):
    """Schemas whose entries are called by their names alone."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """No entry has a title made of its name."""
        del schema
        return False


def schema_of(file: str) -> str:
    """Return the schema of a file as JSON; what is required in it stands in every file, of whichever version."""
    schema = adapter(FILES[file]).json_schema(schema_generator=WithoutTitles)
    whole = {"$schema": DIALECT} | _plain_numbers(schema) | {"title": file}
    return json.dumps(whole, ensure_ascii=False, indent=1) + "\n"


def _plain_numbers(schema: Any) -> Any:
    """Return a schema in which an integer or a number is a number, as JSON has it."""
    if isinstance(schema, list):
        return [_plain_numbers(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    found = {key: _plain_numbers(value) for key, value in schema.items()}
    members = found.get("anyOf", [])
    if INTEGER in members and NUMBER in members:
        members = [one for one in members if one != INTEGER]
        found = {key: value for key, value in found.items() if key != "anyOf"}
        found |= NUMBER if members == [NUMBER] else {"anyOf": members}
    return found
