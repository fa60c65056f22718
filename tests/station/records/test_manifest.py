"""The manifest of a run: every entry of the table, missing or of another kind, is named with its place."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from station_samples import MANIFEST

from station.errors import RecordError
from station.records.data_folder import Store
from station.records.manifest import ENTRIES, Entry, sound_manifest

PLACE = Path("runs") / "run.json"
FITS_NOTHING = {"neither": ["a list", "of a block"]}
LEFT = {"fault": 3, "torque_in_tare_nm": 0.0, "torque_out_tare_nm": 1.5}


@pytest.fixture
def whole(tmp_path: Path) -> dict[str, Any]:
    """A manifest with every entry that any run has."""
    found = Store(tmp_path).create("S", MANIFEST, {}).manifest()
    more = {"records": 0, "files": {"recipe.yaml": {"sha256": "0", "bytes": 1}}, "trouble": "", "recovery_of": "r"}
    more |= {"samples": {"file": "samples.parquet", "sha256": "0", "bytes": 1}}
    found["unit"] = found["unit"] | {"noise_seed": 1}
    return copy.deepcopy(found | more | {"left": LEFT, "operator": "A", "scenario": "s.yaml"})


def read(manifest: Any) -> dict[str, Any]:
    return sound_manifest(json.dumps(manifest).encode(), PLACE)


def holder_of(manifest: dict[str, Any], entry: Entry) -> tuple[dict[str, Any], str]:
    block, _, name = entry.place.rpartition(".")
    return (manifest[block] if block else manifest), name


def test_a_whole_manifest_is_read_with_what_the_table_does_not_know(whole: dict[str, Any]) -> None:
    assert read(whole | {"of a later version": 1}) == whole | {"of a later version": 1}
    for entry in ENTRIES:
        holder, name = holder_of(whole, entry)
        assert name in holder, entry.place


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.place)
def test_an_entry_of_another_kind_is_named(whole: dict[str, Any], entry: Entry) -> None:
    holder, name = holder_of(whole, entry)
    holder[name] = [[FITS_NOTHING]]
    with pytest.raises(RecordError, match=f"^runs/run.json: is damaged: {entry.place}: found .*; allowed is "):
        read(whole)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.place)
def test_a_missing_entry_is_named_where_every_run_has_it(whole: dict[str, Any], entry: Entry) -> None:
    without = copy.deepcopy(whole)
    holder, name = holder_of(without, entry)
    del holder[name]
    if entry.always:
        with pytest.raises(RecordError, match=f"{entry.place}: is missing; allowed is "):
            read(without)
    else:
        assert read(without) == without


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("ring", 5),
        ("period_ns", 0),
        ("notes", None),
        ("notes", [1]),
        ("attempt", True),
        ("attempt", 0),
        ("state", "not concluded"),
        ("verdict", "pass"),
        ("started", "2026-01-05"),
        ("started", "yesterday"),
        ("desk.pid", -1),
        ("desk.pid", 10**30),
        ("ring", "a\0b"),
        ("files", {"a\0b": {"sha256": "", "bytes": 1}}),
        ("files", {"a": {"sha256": "", "bytes": "1"}}),
        ("bench", None),
    ],
)
def test_values_that_ended_every_command_once(whole: dict[str, Any], place: str, value: Any) -> None:
    block, _, name = place.rpartition(".")
    (whole[block] if block else whole)[name] = value
    with pytest.raises(RecordError, match=f"is damaged: {place}: found .*Restore the file from a backup"):
        read(whole)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b'"text"', b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_manifest_is_told(content: bytes) -> None:
    with pytest.raises(RecordError, match=r"^runs/run.json: is damaged: "):
        sound_manifest(content, PLACE)
