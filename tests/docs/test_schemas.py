"""The published schemas are those of what runs write, of this version and of the first one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from json_schema import differences
from old_runs import CONCLUDED, run_of, unpack

from docs.schemas import DIALECT, FILES
from station.documents.entries import plain
from station.documents.manifest import Manifest
from station.documents.reading import of_plain
from station.documents.result import Result
from station.records.run_record import RunRecord
from station.results.judged import judged_in
from station.results.run_analysis import complete_run

ROOT = Path(__file__).parents[2]


def schema(file: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((ROOT / "docs" / "schema" / file).read_text(encoding="utf-8"))
    return found


def wrong(file: str, content: Any) -> list[str]:
    return list(differences(content, schema(file), schema(file)))


@pytest.fixture(scope="module")
def folders(quick_run: Any, golden_run: Any, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A run that passed, one that is NOT DECIDABLE, and those that the first version made."""
    old = unpack(tmp_path_factory.mktemp("old") / "runs")
    return [quick_run.record, golden_run.record, *(run_of(old, name).folder for name in CONCLUDED)]


def lost(before: Any, after: Any, place: str = "$") -> Iterator[str]:
    """Yield what stood in a file and does not stand in what was read of it; entries may come, with their defaults."""
    if isinstance(before, dict) and isinstance(after, dict):
        for name, value in before.items():
            yield from lost(value, after.get(name, "nothing"), f"{place}.{name}")
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for number, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from lost(one, other, f"{place}[{number}]")
    elif (before, type(before)) != (after, type(after)):
        yield f"{place}: {before!r:.40} became {after!r:.40}"


@pytest.mark.parametrize("file", FILES)
def test_what_runs_write_is_what_the_schema_says(folders: list[Path], file: str) -> None:
    assert schema(file)["$schema"] == DIALECT
    assert len(folders) > 5
    new = {folder.parent for folder in folders[:2]}
    for folder in folders:
        content = json.loads((folder / file).read_bytes())
        assert wrong(file, content) == [], folder
        read = of_plain(FILES[file], content, folder / file)
        assert list(lost(content, plain(read))) == [], folder
        assert plain(read) == content or folder.parent not in new, "a run of today is read as it was written"


@pytest.mark.parametrize("file", FILES)
def test_every_entry_of_a_new_run_is_described(quick_run: Any, file: str) -> None:
    """Entries that a schema does not name may be added, so a real file is compared with what the schema does name."""
    content = json.loads((quick_run.record / file).read_bytes())
    assert set(content) <= set(schema(file)["properties"])
    assert list(schema(file)["properties"]) == list(get_type_hints(FILES[file]))


@pytest.mark.parametrize(
    ("file", "place", "value"),
    [
        ("result.json", "verdict", "PERHAPS"),
        ("result.json", "verdict", None),
        ("result.json", "metrics", [{"id": "windup"}]),
        ("result.json", "gates", [{"id": "drift", "passed": "yes"}]),
        ("result.json", "timing", {"scans": True}),
        ("run.json", "attempt", 0),
        ("run.json", "period_ns", 2_000_000_000),
        ("run.json", "notes", [1]),
        ("run.json", "files", {"a": {"sha256": 1, "bytes": 1}}),
        ("timing.json", "lateness_us", {"p50": "1"}),
        ("timing.json", "histograms_us", {"work": [[1.0, 2, 3]]}),
        ("timing.json", "clock", "sundial"),
    ],
)
def test_what_no_run_writes_is_refused_by_the_schema_and_by_the_reader(
    quick_run: Any, file: str, place: str, value: Any
) -> None:
    content = json.loads((quick_run.record / file).read_bytes()) | {place: value}
    assert wrong(file, content) != []
    with pytest.raises(Exception, match=f"{place}.*found|{place}.*is missing"):
        of_plain(FILES[file], content, Path(file))


def test_nothing_of_an_evaluation_is_lost_on_its_way_into_the_result(quick_run: Any) -> None:
    found = complete_run(RunRecord(quick_run.record)).result
    assert plain(judged_in(found)) == json.loads(json.dumps(found.to_dict()))


def test_a_result_and_a_manifest_without_an_entry_that_all_have_are_no_documents() -> None:
    for kind, file in ((Result, "result.json"), (Manifest, "run.json")):
        assert set(schema(file)["required"]) >= {"serial", "recipe", "state", "verdict"}
        assert kind is FILES[file]
