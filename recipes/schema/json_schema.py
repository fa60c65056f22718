"""JSON Schema of the files that people write, for editors that complete and check YAML.

The schema knows options, their types and their choices, made from the same classes that load the files. It knows no
units, ranges of quantities or what options mean together: that is for `lostmotion check`.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

from pydantic import TypeAdapter

from definitions.profiles.can import CanProfile
from definitions.profiles.drive import DriveProfile
from definitions.profiles.modbus import ModbusProfile
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.text.section import strict

DIALECT = "https://json-schema.org/draft/2020-12/schema"

KINDS_OF_FILE: MappingProxyType[str, Any] = MappingProxyType(
    {"recipe": Recipe, "bench": Bench, "profile": strict(DriveProfile) | strict(ModbusProfile) | strict(CanProfile)}
)
"""Kinds of files that people write, and the class that loads each."""


def json_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of file, one of `KINDS_OF_FILE`; KeyError for another."""
    whole = TypeAdapter(KINDS_OF_FILE[kind]).json_schema()
    return {"$schema": DIALECT, **_as_written(whole), "title": f"lostmotion {kind}"}


def _as_written(schema: Any) -> Any:
    """Return a schema of what stands in a file, where it is written otherwise than it is loaded."""
    if isinstance(schema, list):
        return [_as_written(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "discriminator" in schema and schema["discriminator"]["propertyName"] == "kind":
        return {"oneOf": [_one_name(*entry) for entry in schema["discriminator"]["mapping"].items()]}
    written = {key: _as_written(value) for key, value in schema.items()}
    if isinstance(written.get("default"), int | float) and _takes_text(written):
        del written["default"]  # a number in the unit of the program, which an editor would insert as it stands
    properties = written.get("properties", {})
    if "const" in (kind := properties.get("kind", {})) and "default" in kind:  # of a step: its name stands before it
        written["properties"] = {name: one for name, one in properties.items() if name != "kind"}
    return written


def _one_name(name: str, reference: str) -> dict[str, Any]:
    """Return the schema of a step, `{lock: {...}}`."""
    entry = {"properties": {name: {"$ref": reference}}, "required": [name]}
    return {"type": "object", "additionalProperties": False} | entry


def _takes_text(schema: dict[str, Any]) -> bool:
    return schema.get("type") == "string" or any(_takes_text(one) for one in schema.get("anyOf", []))
