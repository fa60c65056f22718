"""The manifest of a run: every entry of the table, missing or of another kind, is named with its place."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import pytest
from station_samples import SETUP

from station.documents.entries import plain
from station.documents.manifest import CLOCK_NAMES, Manifest
from station.documents.reading import document_in
from station.errors import RecordError
from station.records.clocks import CLOCKS, clock_of
from station.records.data_folder import Store

PLACE = Path("runs") / "run.json"
FITS_NOTHING = {"neither": ["a list", "of a block"]}
LEFT = {"fault": 3, "torque_in_tare_nm": 0.0, "torque_out_tare_nm": 1.5, "zeroes_of": "r", "zeroes_unknown": True}


@pytest.fixture
def whole(tmp_path: Path) -> dict[str, Any]:
    """A manifest with every entry that any run has."""
    found = plain(Store(tmp_path).create("S", SETUP, {}).manifest())
    more = {"records": 0, "files": {"recipe.yaml": {"sha256": "0", "bytes": 1}}, "trouble": "", "recovery_of": "r"}
    more |= {"samples": {"file": "samples.parquet", "sha256": "0", "bytes": 1}, "verdict": "PASS"}
    software = {"commit": "c", "changed": False, "files_sha256": "f", "decisions": 2, "dependencies": {"numpy": "2"}}
    found["software"] |= software | {"python": "3", "platform": "p", "host": "h", "user": "u"}
    found["recipe"] |= {"file": "r.yaml"}
    found["bench"] |= {"file": "b.yaml", "public_key": "k", "fixture": "f"}
    found["unit"] = found["unit"] | {"noise_seed": 1, "master": "PASS"}
    earlier = {"attempt": 1, "run": "r", "state": "complete", "verdict": "FAIL", "failed": ["Backlash"]}
    more |= {"study": {"name": "grr-1", "plan": "0", "step": 1, "steps": 8}}
    more |= {"before": [earlier], "retest_reason": "seating of the unit"}
    return copy.deepcopy(found | more | {"left": LEFT, "operator": "A", "scenario": "s.yaml"})


class Entry(NamedTuple):
    """An entry of the manifest: its place, and whether it may be missing."""

    place: str
    optional: bool


def has_default(kind: type, name: str) -> bool:
    (one,) = (one for one in fields(kind) if one.name == name)
    return one.default is not MISSING or one.default_factory is not MISSING


def entries_of(kind: type, block: str = "") -> Iterator[Entry]:
    for name, hint in get_type_hints(kind).items():
        yield Entry(f"{block}{name}", has_default(kind, name))
        for part in (hint, *get_args(hint)):
            if is_dataclass(part):
                yield from entries_of(part, f"{name}.")


ENTRIES = tuple(entries_of(Manifest))


def read(manifest: Any) -> Manifest:
    return document_in(Manifest, json.dumps(manifest).encode(), PLACE)


def holder_of(manifest: dict[str, Any], entry: Entry) -> tuple[dict[str, Any], str]:
    block, _, name = entry.place.rpartition(".")
    return (manifest[block] if block else manifest), name


def test_a_whole_manifest_is_read_and_written_entry_by_entry(whole: dict[str, Any]) -> None:
    assert plain(read(whole)) == whole
    assert len(ENTRIES) > 40
    for entry in ENTRIES:
        holder, name = holder_of(whole, entry)
        assert name in holder, entry.place


def test_what_only_a_later_version_knows_stays_when_the_manifest_is_changed(tmp_path: Path) -> None:
    run = Store(tmp_path).create("S", SETUP, {})
    run.write_json("run.json", run.read_json("run.json") | {"of a later version": 1})
    before = run.read_json("run.json")
    run.update(notes=("said",))
    assert run.read_json("run.json") == before | {"notes": ["said"]}


def test_a_record_may_name_every_clock_that_there_is() -> None:
    assert {clock_of(name) for name in CLOCK_NAMES} == set(CLOCKS)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.place)
def test_an_entry_of_another_kind_is_named(whole: dict[str, Any], entry: Entry) -> None:
    holder, name = holder_of(whole, entry)
    holder[name] = [[FITS_NOTHING]]
    with pytest.raises(RecordError, match=rf"^runs/run.json: is damaged: {entry.place}(\[0\])?: found .*; allowed is "):
        read(whole)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.place)
def test_a_missing_entry_is_named_where_every_run_has_it(whole: dict[str, Any], entry: Entry) -> None:
    without = copy.deepcopy(whole)
    holder, name = holder_of(without, entry)
    del holder[name]
    if entry.optional:
        again = plain(read(without))
        holder_of(again, entry)[0].pop(name, None)
        assert again == without
    else:
        with pytest.raises(RecordError, match=f"{entry.place}: is missing; allowed is "):
            read(without)


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
        ("recipe.revision", 10**30),
        ("attempt", 1 << 31),
        ("unit.noise_seed", 1 << 63),
        ("ring", "a\0b"),
        ("bench", None),
    ],
)
def test_values_that_ended_every_command_once(whole: dict[str, Any], place: str, value: Any) -> None:
    block, _, name = place.rpartition(".")
    (whole[block] if block else whole)[name] = value
    with pytest.raises(RecordError, match=rf"is damaged: {place}(\[0\])?: found .*Restore the file from a backup"):
        read(whole)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"a\0b": {"sha256": "", "bytes": 1}}, r'files: found "a\\u0000b"; allowed is a path'),
        ({"a": {"sha256": "", "bytes": "1"}}, 'files.a.bytes: found "1"; allowed is a whole number'),
    ],
)
def test_a_wrong_checksum_is_named(whole: dict[str, Any], files: dict[str, Any], said: str) -> None:
    with pytest.raises(RecordError, match=f"is damaged: {said}"):
        read(whole | {"files": files})


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b'"text"', b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_manifest_is_told(content: bytes) -> None:
    with pytest.raises(RecordError, match=r"^runs/run.json: is damaged: "):
        document_in(Manifest, content, PLACE)
