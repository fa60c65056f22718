"""A concluded record that somebody edits afterwards: every file, the index, and what the commands then say."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from run_copies import alone, begun_here
from run_samples import as_recorded, flip
from station_samples import SETUP

from station.atomic_file import as_json
from station.documents.entries import plain
from station.documents.result import MetricValue
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.entries import FIELDS, SEALED
from station.records.chain.walk import walk
from station.records.chain.writing import writing_to
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import alterations, fingerprint, seal, sealed_names
from station.reports.stored_result import stored_result
from station.run.run_list import row


@pytest.fixture
def original(quick_run: Any) -> Path:
    """A data folder with one run that passed."""
    return quick_run.data


@pytest.fixture
def sealed(original: Path, tmp_path: Path) -> RunRecord:
    shutil.copytree(original, tmp_path / "data")
    return Store(tmp_path / "data").find("last")


def test_a_copied_folder_says_where_it_is_and_not_where_it_was(original: Path, sealed: RunRecord) -> None:
    assert stored_result(sealed).record == str(sealed.folder)
    assert str(original) not in json.dumps(plain(stored_result(sealed)))


def edit(name: str, old: str, new: str) -> Callable[[RunRecord], None]:
    def change(run: RunRecord) -> None:
        text = (run.folder / name).read_text(encoding="utf-8")
        assert old in text
        (run.folder / name).write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


def flip_sample(run: RunRecord) -> None:
    flip(run, 5000)


def another_verdict_everywhere(run: RunRecord) -> None:
    """What somebody does who knows about the checksums, and not about the chain."""
    edit("result.json", '"verdict": "PASS"', '"verdict": "FAIL"')(run)
    manifest = run.read_json("run.json")
    del manifest["files"]
    run.write_json("run.json", manifest)
    seal_without_line(run)


def seal_without_line(run: RunRecord) -> None:
    files = {name: plain(fingerprint(run.folder / name)) for name in sealed_names(run)}
    run.write_json("run.json", run.read_json("run.json") | {"verdict": "FAIL", "files": files})


def another_line(run: RunRecord) -> None:
    """What the bench itself once did where a run was sealed again."""
    (sealed,) = (entry for entry in Chain(run.folder.parent).entries_of(run.id) if entry.kind == SEALED)
    fields = {name: sealed.fields[name] for name in FIELDS[SEALED]} | {"sha256": "0" * 64}
    with writing_to(run.folder.parent) as chain:
        chain.append(SEALED, **fields)


ALTERATIONS: dict[str, tuple[Callable[[RunRecord], None], str]] = {
    "a limit in the result": (edit("result.json", '"max": 1.0', '"max": 9.0'), "result.json"),
    "verdict of the result": (edit("result.json", '"verdict": "PASS"', '"verdict": "FAIL"'), "result.json"),
    "the result is no result": (lambda run: run.write_json("result.json", [1]), "result.json"),
    "rows that are no rows": (lambda run: run.write_json("result.json", {"metrics": [1, {}]}), "result.json"),
    "a limit in the recipe": (edit("recipe.yaml", "max: 1 arcmin", "max: 2 arcmin"), "recipe.yaml"),
    "the bench": (edit("bench.yaml", "revision: 1", "revision: 2"), "bench.yaml"),
    "a segment": (edit("program.json", '"segments"', '"segment"'), "program.json"),
    "the calibration": (edit("calibration.json", '"slope"', '"Slope"'), "calibration.json"),
    "the timing": (edit("timing.json", '"missed": 0', '"missed": 1'), "timing.json"),
    "an event": (edit("events.jsonl", "home", "lock"), "events.jsonl"),
    "an event deleted": (lambda run: (run.folder / "events.jsonl").unlink(), "events.jsonl"),
    "a profile": (lambda run: next(run.folder.glob("profiles/*")).write_text("x"), "profiles/"),
    "a scenario that was not there": (lambda run: run.write_bytes("scenario.yaml", b"x"), "scenario.yaml"),
    "a sample": (flip_sample, "samples.parquet"),
    "the serial number": (lambda run: run.update(serial="S2"), "run.json"),
    "verdict of the manifest": (lambda run: run.update(verdict="FAIL"), "run.json"),
    "no checksums": (lambda run: run.update(files=None), "run.json"),
    "all of it with new checksums": (another_verdict_everywhere, "run.json"),
    "no line in the chain": (lambda run: (run.folder.parent / CHAIN).write_bytes(b""), CHAIN),
    "a second line in the chain": (another_line, CHAIN),
}


def row_verdicts(metrics: Sequence[MetricValue]) -> set[str | None]:
    return {row.verdict for one in metrics for row in (one, *one.sides.values())}


def test_a_concluded_run_names_what_its_verdict_rests_on(sealed: RunRecord) -> None:
    assert alterations(sealed) == ()
    files = sealed.manifest().files
    assert set(files) >= {"samples.parquet", "recipe.yaml", "bench.yaml", "program.json", "events.jsonl", "timing.json"}
    assert set(files) >= {"calibration.json", "result.json"}
    assert {f"profiles/{path.name}" for path in sealed.folder.glob("profiles/*")} <= set(files)
    created, entry = Chain(sealed.folder.parent).entries_of(sealed.id)
    assert (created.kind, entry.kind) == ("created", "sealed")
    assert created.signed
    assert entry.signed
    assert entry.fields["created"] == created.counter == sealed.manifest().chain.counter
    assert stored_result(sealed).verdict == "PASS"


@pytest.mark.parametrize("name", ALTERATIONS)
def test_an_altered_record_decides_nothing_and_names_the_file(sealed: RunRecord, name: str) -> None:
    alter, file = ALTERATIONS[name]
    alter(sealed)
    shown = stored_result(sealed)
    assert shown.verdict == "NOT DECIDABLE"
    assert shown.reasons[0].startswith("record altered: ")
    assert any(one.startswith(file) for one in shown.altered)
    assert row_verdicts(shown.metrics) <= {None}
    listed = row(sealed)
    if name != "a sample":  # the list compares the size of the samples alone
        assert (listed.state, listed.verdict) == ("altered", None)


def test_show_and_list_say_it_to_a_person(sealed: RunRecord) -> None:
    data = str(sealed.folder.parent)
    edit("result.json", '"max": 1.0', '"max": 9.0')(sealed)
    shown = here("show", "last", "--data", data).out
    assert "RECORD ALTERED" in shown
    assert "record altered: result.json" in shown
    assert "PASS" not in shown
    listed = here("list", "--data", data).out
    assert "altered" in listed
    assert "PASS" not in listed


def test_a_damaged_record_leaves_no_row_its_verdict(sealed: RunRecord) -> None:
    """Samples that do not read back, in a record that has no checksums of its own to compare them with."""
    as_recorded(sealed)
    flip_sample(sealed)
    sealed = begun_here(alone(sealed))
    manifest = sealed.manifest()
    content = sealed.samples.read_bytes()
    seal(sealed)
    assert "samples.parquet" in manifest.files.keys() - sealed.manifest().files.keys()
    assert sealed.samples.read_bytes() == content
    shown = stored_result(sealed)
    assert shown.altered is None
    assert shown.verdict == "NOT DECIDABLE"
    assert "fail their CRC" in shown.reasons[0]
    assert row_verdicts(shown.metrics) == {None}


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("gates", 0), 130),
        (("gates", 0, "id"), {}),
        (("notes",), [{"a": None}]),
        (("metrics", 0, "value"), ""),
        (("metrics", 0, "unit"), 0),
        (("metrics", 0, "sides"), 5),
        (("metrics",), None),
        (("timing",), "x"),
        (("alarms",), [1]),
        (("verdict",), []),
    ],
    ids=str,
)
def test_an_altered_result_of_any_shape_is_shown_as_altered(
    sealed: RunRecord, place: tuple[str | int, ...], value: Any
) -> None:
    result = sealed.read_json("result.json")
    holder = result
    for key in place[:-1]:
        holder = holder[key]
    holder[place[-1]] = value
    sealed.write_json("result.json", result)
    data = ("--data", str(sealed.folder.parent))
    told, asked = here("show", "last", *data), here("show", "last", *data, "--json")
    assert (told.exit_code, asked.exit_code) == (3, 3)
    assert "RECORD ALTERED" in told.out
    assert asked.json["verdict"] == "NOT DECIDABLE"
    assert row_verdicts(asked.json["metrics"]) <= {None}


def test_a_run_that_was_not_concluded_has_no_verdict_to_believe(tmp_path: Path) -> None:
    run = Store(tmp_path).create("S", SETUP, {})
    run.update(desk={"pid": 1, "birth": "gone"})
    run.write_bytes("result.json", as_json({"verdict": "PASS", "reasons": [], "metrics": []}))
    assert alterations(run) == ()
    assert stored_result(run).verdict == "NOT DECIDABLE"
    assert row(run).state == "not concluded"


@pytest.mark.parametrize("changed", ["program.json", "profiles/drive.yaml"])
def test_what_was_changed_before_the_seal_is_not_what_the_run_was_begun_with(tmp_path: Path, changed: str) -> None:
    files = {"program.json": b"{}", "profiles/drive.yaml": b"drive: 1"}
    for as_begun in (True, False):
        run = Store(tmp_path).create("S", SETUP, files)
        if not as_begun:
            (run.folder / changed).write_bytes(b"{ }")
        seal(run, verdict="PASS", state="complete")
        told = [one for one in alterations(run) if one.startswith(f"{changed}: ")]
        assert len(told) == (0 if as_begun else 1)


def test_what_the_run_was_not_begun_with_is_no_part_of_its_profiles(tmp_path: Path) -> None:
    run = Store(tmp_path).create("S", SETUP, {"program.json": b"{}", "profiles/drive.yaml": b"drive: 1"})
    (run.folder / "profiles" / ".DS_Store").touch()
    (run.folder / "profiles" / "another.yaml").touch()
    (run.folder / "profiles" / "before").mkdir()
    seal(run, verdict="PASS", state="complete")
    (run.folder / "profiles" / ".DS_Store").write_bytes(b"changed")
    (run.folder / "profiles" / "later").mkdir()
    assert [one for one in alterations(run) if one.startswith("profiles")] == []


def test_a_record_copied_elsewhere_stands_alone_but_says_that_no_chain_vouches_for_it(
    sealed: RunRecord, tmp_path: Path
) -> None:
    copy = tmp_path / "archive" / "copy"
    shutil.copytree(sealed.folder, copy)
    shown = here("show", str(copy), "--data", str(tmp_path / "archive")).out
    assert "PASS" in shown
    assert f"file {CHAIN} is missing" in shown


def test_runs_that_end_at_once_do_not_tear_the_chain(tmp_path: Path) -> None:
    store = Store(tmp_path)
    runs = [store.create("S", SETUP, {}) for _ in range(24)]
    with ThreadPoolExecutor(12) as pool:
        list(pool.map(lambda run: seal(run, verdict="PASS", state="complete"), runs))
    found = walk(Chain(tmp_path))
    assert found.problems == []
    assert sorted(found.sealed) == [run.id for run in runs]
