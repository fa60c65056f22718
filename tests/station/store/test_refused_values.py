"""Values that a database cannot hold: the run that has one is named, and everything else works on both databases."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from station.cli.line.stored_metric import Ask
from station.cli.line.stored_values import stored_values
from station.records.chain.chain_file import Chain
from station.records.chain.entries import CREATED, REMOVED
from station.records.chain.writing import writing_to
from station.records.data_folder import Store
from station.store.outbox import rebuild
from station.store.table_counts import all_rows
from station.store.view import look_at, opened

ASK = Ask("lost_motion", recipe="inverse")


@pytest.fixture
def data(tmp_path: Path, store_url: str | None) -> Path:
    del store_url
    for number in range(3):
        store_run(tmp_path / "runs", f"S{number}", [metric(0.4 + number)])
    return tmp_path / "runs"


def rebuilt(data: Path) -> dict[str, list[tuple[Any, ...]]]:
    with look_at(data) as view:
        before = all_rows(view.database, view.chain)
    database = opened(data)
    rebuild(database, Chain(data))
    found = all_rows(database, Chain(data))
    database.close()
    assert found == before
    return found


ENTRIES = {"operator": "a\0b", "recipe": {"name": "a\0b"}, "notes": ["a\0b"], "unit": {"model": "\0"}}


@pytest.mark.parametrize("name", ENTRIES)
def test_a_character_that_no_text_has_damages_its_run_alone(data: Path, name: str) -> None:
    run = Store(data).runs()[1]
    said = run.read_json("run.json")
    value = ENTRIES[name]
    said[name] = said[name] | value if isinstance(value, dict) else value
    (run.folder / "run.json").write_text(json.dumps(said))
    with look_at(data) as view:
        (found,) = [problem for problem in view.problems if problem.kind == "altered"]
    assert found.run == run.id
    assert f"run.json: is damaged: {name}" in found.text
    assert "allowed is a text without the character U+0000" in found.text
    assert len(stored_values(data, ASK).values) == 2
    rebuilt(data)
    assert here("store", "rebuild", "--data", str(data)).exit_code == 0


def test_a_run_whose_values_are_refused_is_named_alone(data: Path) -> None:
    """One that its record allows and the tables do not: a validity check twice."""
    gates = [{"id": "drift", "passed": True}] * 2
    twice = store_run(data, "TWICE", [metric(0.5)], gates=gates)
    store_run(data, "AFTER", [metric(0.6)])
    with look_at(data) as view:
        assert [problem.run for problem in view.problems if "the store cannot hold" in problem.text] == [twice.id]
    assert len(stored_values(data, ASK).values) == 4
    assert len(rebuilt(data)["runs"]) == 5


@pytest.mark.parametrize("letter", ["\0", "\ud800"])
def test_a_line_of_the_chain_with_such_a_name_stops_nothing(data: Path, letter: str) -> None:
    before = rebuilt(data)
    lines = Chain(data).content.splitlines()
    forged = [
        json.dumps(json.loads(lines[1]) | {"run": f"20300101T000000.000Z-{letter}", "serial": letter}).encode(),
        json.dumps(json.loads(lines[1]) | {"serial": letter, "counter": 99}).encode(),
    ]
    with (data / "chain.jsonl").open("ab") as file:
        file.writelines(line + b"\n" for line in forged)
    after = rebuilt(data)
    assert after["runs"] == before["runs"]
    assert len(stored_values(data, ASK).values) == 3


def test_signed_lines_with_such_texts_stop_nothing(data: Path) -> None:
    before = rebuilt(data)
    with writing_to(data) as chain:
        for run, serial in (("20300101T000000.000Z-\0", "N"), ("20300101T000000.000Z-N", "\0")):
            chain.append(CREATED, run=run, serial=serial, attempt=1, recipe="0", bench="0")
        chain.append(REMOVED, run="20300101T000000.000Z-\0", serial="N", sha256="0", rule="\0", person="p", trace="t")
    after = rebuilt(data)
    assert after["runs"] == before["runs"]
    assert len(stored_values(data, ASK).values) == 3
