"""The JSON Schemas for editors take every shipped file, and refuse what an editor should underline."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema_rs
import pytest
from ruamel.yaml import YAML

from recipes import shipped_benches, shipped_recipes
from recipes.schema.json_schema import KINDS_OF_FILE, json_schema
from recipes.schema.sequence_schema import STAGES

FILES = {
    "recipe": shipped_recipes().values(),
    "bench": shipped_benches().values(),
    "profile": sorted((Path(__file__).parents[2] / "drivers/profiles").glob("*.yaml")),
}
SCHEMAS = {kind: json_schema(kind) for kind in KINDS_OF_FILE}
QUICK = shipped_recipes()["rv-40e-121-quick"].read_text(encoding="utf-8")


def objections(kind: str, text: str) -> list[list[object]]:
    """Where an editor would underline a file; dates are text to it."""
    data = json.loads(json.dumps(YAML(typ="safe").load(text), default=str))
    return [list(one.instance_path) for one in jsonschema_rs.Draft202012Validator(SCHEMAS[kind]).iter_errors(data)]


@pytest.mark.parametrize(("kind", "path"), [(kind, path) for kind, paths in FILES.items() for path in paths], ids=str)
def test_every_shipped_file_is_as_its_schema_says(kind: str, path: Path):
    assert objections(kind, path.read_text(encoding="utf-8")) == []


def test_every_kind_of_file_has_shipped_ones():
    assert set(FILES) == set(KINDS_OF_FILE)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("peak_torque", "peak_torqe", "sequence"),
        ("- lock:", "- clamp:", "sequence"),
        ("loading: input", "loading: sideways", "loading"),
        ("rated_torque: 412 N·m", "rated_torque: 412", "unit_under_test"),
        ("id: spring_constant", "identity: spring_constant", "metrics"),
    ],
)
def test_what_is_wrong_is_underlined_where_it_stands(old: str, new: str, place: str):
    assert old in QUICK
    assert {where[0] for where in objections("recipe", QUICK.replace(old, new, 1))} == {place}


def test_a_step_is_written_by_its_name_and_all_steps_are_known():
    steps = SCHEMAS["recipe"]["properties"]["sequence"]["items"]["oneOf"]
    assert sorted(step["required"] for step in steps) == sorted([kind] for kind in STAGES)
    assert objections("recipe", QUICK.replace("- lock: {", "- lock: {kind: lock, ", 1)) != []


def test_no_number_of_the_program_is_offered_for_a_quantity():
    lock = SCHEMAS["recipe"]["$defs"]["Lock"]["properties"]
    assert lock["proof_time"]["type"] == "string"
    assert "default" not in lock["proof_time"]
