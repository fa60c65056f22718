"""Rows that several runs share: what one altered run.json says is in none of them, whatever came first."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from station_samples import SETUP
from stored_runs import BENCH_TEXT, metric, recipe_text, store_run

from station.documents.manifest import Unit
from station.records.chain.chain_file import Chain
from station.records.data_folder import Store
from station.records.revisions.revision import hash_of
from station.records.run_record import RunRecord
from station.records.seal import seal
from station.store.outbox import rebuild
from station.store.table_counts import all_rows
from station.store.view import another_recipe, look_at, opened

SHARED = ("recipes", "benches", "units")


@pytest.fixture
def data(tmp_path: Path, store_url: str | None) -> Path:
    """Three runs by one recipe on one bench, the first two of one unit, and one by another recipe."""
    del store_url
    for serial in ("A", "A", "B"):
        store_run(tmp_path / "runs", serial, [metric(0.4)])
    store_run(tmp_path / "runs", "C", [metric(0.4)], recipe="other", virtual="P1")
    return tmp_path / "runs"


def looked(data: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Return all rows that a store has after a look, which a store that is made anew has too."""
    found = rows(data)
    database = opened(data)
    rebuild(database, Chain(data))
    assert all_rows(database, Chain(data)) == found
    database.close()
    return found


def rows(data: Path) -> dict[str, list[tuple[Any, ...]]]:
    with look_at(data) as view:
        return all_rows(view.database, view.chain)


def named(data: Path, table: str) -> list[tuple[Any, ...]]:
    """Return the shared rows of a table without the ids of chain and file."""
    return [row[1 if table == "units" else 2 :] for row in rows(data)[table]]


def forge(run: RunRecord) -> None:
    said = run.read_json("run.json")
    said["recipe"] |= {"name": "forged", "revision": 7}
    said["bench"] |= {"name": "forged"}
    said["unit"] |= {"model": "FORGED"}
    (run.folder / "run.json").write_text(json.dumps(said))


def forge_hashes(run: RunRecord) -> None:
    said = run.read_json("run.json")
    said["recipe"] |= {"sha256": hash_of(b"another")}
    said["bench"] |= {"sha256": hash_of(b"another")}
    (run.folder / "run.json").write_text(json.dumps(said))


DEEDS: dict[str, Callable[[RunRecord], object]] = {
    "forged": forge,
    "forged hashes": forge_hashes,
    "damaged": lambda run: (run.folder / "run.json").write_text("{"),
    "another recipe": lambda run: (run.folder / "recipe.yaml").write_bytes(recipe_text("forged", 7)),
    "no recipe": lambda run: (run.folder / "recipe.yaml").unlink(),
    "no bench": lambda run: (run.folder / "bench.yaml").unlink(),
}


@pytest.mark.parametrize("which", [0, 1, 3])
@pytest.mark.parametrize("deed", DEEDS)
def test_an_altered_run_leaves_nothing_in_the_rows_of_others(data: Path, tmp_path: Path, deed: str, which: int) -> None:
    """As found by a look, by a rebuild, and once everything is put back: always as a store that is made anew."""
    before = looked(data)
    run = Store(data).runs()[which]
    shutil.copytree(run.folder, tmp_path / "kept")
    DEEDS[deed](run)
    altered = looked(data)
    assert all("forged" not in str(altered[table]).lower() for table in SHARED)
    assert set(altered["recipes"]) <= set(before["recipes"])
    assert set(altered["units"]) == set(before["units"]) - ({before["units"][-1]} if which == 3 else set())
    shutil.rmtree(run.folder)
    (tmp_path / "kept").rename(run.folder)
    after = looked(data)
    assert {table: after[table] for table in SHARED} == {table: before[table] for table in SHARED}


def test_a_recipe_is_known_while_one_copy_of_it_is_left(data: Path) -> None:
    looked(data)
    first, second, third, _ = Store(data).runs()
    for run, left in ((first, 2), (second, 2), (third, 1)):
        (run.folder / "recipe.yaml").unlink()
        assert len(looked(data)["recipes"]) == left


def test_a_changed_recipe_is_noted_while_a_run_is_altered_and_when_it_is_put_right(data: Path) -> None:
    """Of one that kept its revision, also where the store was made anew while the altered run lay there."""
    for run in Store(data).runs():
        before = (run.folder / "run.json").read_bytes()
        for deed in (forge, forge_hashes, lambda run: (run.folder / "run.json").write_text("{")):
            deed(run)
            looked(data)
            assert another_recipe(data, "other", 1, hash_of(b"changed"), most_s=5.0) is not None
            assert another_recipe(data, "forged", 7, hash_of(b"changed"), most_s=5.0) is None
            (run.folder / "run.json").write_bytes(before)
            found = another_recipe(data, "inverse", 1, hash_of(b"changed"), most_s=5.0)
            assert found == (Store(data).runs()[2].id, hash_of(recipe_text("inverse", 1)))


@pytest.fixture
def recording(data: Path) -> RunRecord:
    """A run that is not concluded, by a recipe of its own; its unit gets its name when it is."""
    files = {"recipe.yaml": recipe_text("new", 3), "bench.yaml": BENCH_TEXT}
    recipe = replace(SETUP.recipe, name="new", revision=3, sha256=hash_of(files["recipe.yaml"]))
    bench = replace(SETUP.bench, sha256=hash_of(BENCH_TEXT))
    return Store(data).create("D", replace(SETUP, recipe=recipe, bench=bench), files)


def test_a_look_at_a_run_that_records_says_nothing_of_its_unit(data: Path, recording: RunRecord) -> None:
    assert not [row for row in looked(data)["units"] if row[1] == "D"]
    assert another_recipe(data, "new", 3, hash_of(b"changed"), most_s=5.0) is not None, "it was begun by this recipe"
    recording.update(unit=Unit(model="RV", virtual="P1"))
    recording.write_json("result.json", RunRecord(Store(data).runs()[0].folder).read_json("result.json") | {
        "run": recording.id, "serial": "D", "state": "complete", "verdict": "PASS",
    })  # fmt: skip
    seal(recording, state="complete", verdict="PASS", records=0)
    assert [row[1:] for row in looked(data)["units"] if row[1] == "D"] == [("D", "RV", "P1")]


def test_what_a_file_is_called_is_read_in_the_file(data: Path) -> None:
    assert sorted(named(data, "recipes")) == [("inverse", 1), ("other", 1)]
    assert named(data, "benches") == [("b", 1, True, None)]
    assert named(data, "units") == [("A", "RV", ""), ("B", "RV", ""), ("C", "RV", "P1")]


@pytest.mark.parametrize(
    "text", [b"", b"recipe: 1\n", b"recipe: {name: 1, revision: 1}\n", b"recipe: {name: r}\n", b"\0"]
)
def test_a_recipe_that_does_not_say_how_it_is_called_has_no_row(data: Path, text: bytes) -> None:
    before = named(data, "recipes")
    store_run(data, "E", [metric(0.4)], text=text)
    assert named(data, "recipes") == before
    looked(data)
