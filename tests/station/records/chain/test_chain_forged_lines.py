"""Lines that anybody can add to a chain: each is named, none has a say in what is written behind it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from chain_folders import a_key, another_computer, lines, write
from lostmotion_command import here
from station_samples import SETUP
from stored_runs import metric, store_run

from definitions.number_formats import LARGEST_COUNT
from station.atomic_file import as_json
from station.errors import RecordError
from station.own_place import PLACE
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.chain.entries import CREATED, FIELDS, LOST, SEALED, START, Entry, entry_of, signed_entry
from station.records.chain.head import Head, head_of, keep_head
from station.records.chain.keys import own_key, trust
from station.records.chain.writing import writing_to
from station.records.data_folder import Store
from station.records.run_record import MANIFEST, RunRecord
from station.records.seal import CONCLUDED, alterations, finish_seal, seal
from station.records.verify import verify_folder
from station.run.run_list import row
from station.store.view import look_at

RUN = "20260105T090000.000Z-Z"
HUGE = 1 << 70


def last(data: Path) -> Entry:
    entry = entry_of(lines(data)[-1][:-1])
    assert entry is not None
    return entry


def unsigned(data: Path, **changes: Any) -> bytes:
    """A line as the next one would be, but for these fields, below which nobody's signature stands."""
    end = last(data)
    fields = {"kind": CREATED, "counter": end.counter + 1, "run": RUN, "serial": "Z", "attempt": 1}
    fields |= {"recipe": "r", "bench": "b", "time": "then", "previous": end.sha256, "key": own_key().public}
    return json.dumps(fields | {"signature": "00"} | changes, separators=(",", ":")).encode() + b"\n"


def foreign(data: Path, kind: str = CREATED, **changes: Any) -> bytes:
    """The same, signed by a key that nobody has trusted."""
    end = last(data)
    fields = {"run": RUN, "serial": "Z", "attempt": 1, "recipe": "r", "bench": "b", "sha256": ""} | changes
    counter = fields.pop("counter", end.counter + 1)
    return signed_entry(kind, counter, end.sha256, "then", a_key(), **fields).line + b"\n"


def kinds(data: Path) -> set[str]:
    return {problem.kind for problem in verify_folder(data).problems}


NEAR = LARGEST_COUNT - 2
PASSED_OVER: dict[str, tuple[Callable[[Path], bytes], set[str]]] = {
    "the next counter": (unsigned, {"forged_entry"}),
    "a counter at the end of all": (lambda data: unsigned(data, counter=NEAR, previous="x"), {"forged_entry"}),
    "a key that is none": (lambda data: unsigned(data, counter=NEAR, key="x"), {"forged_entry"}),
    "a foreign counter at the end of all": (
        lambda data: foreign(data, counter=NEAR),
        {"removed_entries", "unknown_key", "missing"},
    ),
    "foreign lost lines": (
        lambda data: foreign(data, LOST, counter=NEAR, first=1, last=NEAR - 1),
        {"lost_entries", "unknown_key"},
    ),
}


@pytest.mark.parametrize("name", PASSED_OVER)
def test_a_line_that_does_not_count_is_named_and_passed_over(data: Path, name: str) -> None:
    make, named = PASSED_OVER[name]
    before, line = last(data), make(data)
    write(data, [*lines(data), line])
    assert "PROBLEM" in here("list", "--data", str(data)).out, "and the store has come as far as this line"
    run = store_run(data, "D", [metric(0.4)])
    place = run.manifest().chain
    assert place is not None
    assert (place.counter, place.previous) == (before.counter + 1, before.sha256)
    assert kinds(data) == named
    assert row(run).verdict == "PASS"
    told = here("list", "--data", str(data)).out
    assert ("not signed by the key" in told) is ("forged_entry" in named)
    assert "out of order" not in told
    write(data, [one for one in lines(data) if one != line])
    assert kinds(data) == set()
    assert "PROBLEM" not in here("list", "--data", str(data)).out
    assert row(store_run(data, "D", [metric(0.4)])).attempt == 2
    assert kinds(data) == set()


NO_ENTRIES: dict[str, Callable[[Path], bytes]] = {
    "counter": lambda data: unsigned(data, counter=HUGE),
    "counter 0": lambda data: unsigned(data, counter=0),
    "half a character": lambda data: unsigned(data, run="\ud800x"),
    "half a character in a key": lambda data: unsigned(data, key="ed25519:\ud800"),
    "NUL": lambda data: unsigned(data, run="a\0b"),
    "NUL in a serial number": lambda data: foreign(data, serial="a\0b"),
    "folder above": lambda data: unsigned(data, run="../x"),
    "folder itself": lambda data: unsigned(data, run="."),
    "parent": lambda data: unsigned(data, run=".."),
    "no name": lambda data: unsigned(data, run=""),
    "long name": lambda data: unsigned(data, run="x" * 5000),
    "foreign attempt": lambda data: foreign(data, attempt=HUGE),
    "foreign counter": lambda data: foreign(data, counter=HUGE),
    "foreign lost": lambda data: foreign(data, LOST, counter=HUGE + 1, first=1, last=HUGE),
}


@pytest.mark.parametrize("name", NO_ENTRIES)
def test_a_line_beyond_all_bounds_is_named_and_stops_no_command(data: Path, name: str) -> None:
    whole, line = lines(data), NO_ENTRIES[name](data)
    outside = data.parent / "x"
    outside.mkdir()
    (outside / CREATED_MANIFEST).write_text("{}")
    write(data, [*whole, line])
    for command in (("list",), ("store", "rebuild"), ("conclude", "--all"), ("show", "A")):
        assert here(*command, "--data", str(data)).exit_code in (0, 1), command
    assert here("verify", "--data", str(data)).exit_code == 1
    assert kinds(data) == {"forged_entry"}
    run = store_run(data, "D", [metric(0.4)])
    assert [one.name for one in outside.iterdir()] == [CREATED_MANIFEST], "nobody has looked there"
    assert kinds(data) == {"forged_entry"}
    assert row(run).verdict == "PASS"
    write(data, [one for one in lines(data) if one != line])
    assert kinds(data) == set()


def test_lines_before_the_first_entry_are_named_and_leave_every_run_its_verdict(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    junk, key = [b"junk\n"] * 3, own_key().public
    write(data, [*junk, *lines(data)])
    assert kinds(data) == set(), "power failures tear as many"
    write(data, [*junk, *lines(data)])
    another_computer(monkeypatch, tmp_path)
    trust(key)
    assert kinds(data) == {"strange_lines"}
    assert [row(run).verdict for run in Store(data).runs()] == ["FAIL", "PASS", "PASS", "PASS"]
    assert "PROBLEM" in here("list", "--data", str(data)).out


def test_forged_lines_within_a_run_leave_it_its_verdict(data: Path) -> None:
    whole = lines(data)
    write(data, [*whole[:2], unsigned(data), foreign(data, counter=NEAR), *whole[2:]])
    assert kinds(data) == {"forged_entry", "removed_entries", "unknown_key", "missing"}
    assert [row(run).verdict for run in Store(data).runs()] == ["FAIL", "PASS", "PASS", "PASS"]


@pytest.mark.parametrize("number", [1, 6])
@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_foreign_start_before_the_first_entry_is_named_and_passed_over(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, *, elsewhere: bool
) -> None:
    chain, whole = Chain(data).id, lines(data)
    start = signed_entry(START, 1, "", "then", a_key(), chain="f" * 32, before=None, replaces=None)
    write(data, [*[start.line + b"\n"] * number, *whole])
    if elsewhere:
        another_computer(monkeypatch, tmp_path)
    assert Chain(data).id == chain
    assert kinds(data) == {"unknown_key"} | ({"reordered_entries"} if number > 1 else set())
    assert [row(run).verdict for run in Store(data).runs()] == ["FAIL", "PASS", "PASS", "PASS"]
    place = store_run(data, "D", [metric(0.4)]).manifest().chain
    assert place is not None
    assert place.id == chain
    write(data, lines(data)[:-2])
    assert "truncated" in kinds(data)


@pytest.mark.parametrize("number", [1, 3])
def test_a_foreign_line_that_the_store_had_before_its_genuine_twin_is_no_break_there(data: Path, number: int) -> None:
    whole = lines(data)
    store_run(data, "D", [metric(0.4)])
    genuine = lines(data)[len(whole) :]
    write(data, whole)
    for _ in range(number):
        write(data, [*lines(data), foreign(data)])
    assert "out of order" not in here("list", "--data", str(data)).out
    write(data, [*lines(data), *genuine])
    told = here("list", "--data", str(data)).out
    assert "out of order" not in told
    assert "hash of the line" not in told
    assert "reordered_entries" not in kinds(data)


def test_foreign_copies_before_the_lines_of_runs_are_named_and_passed_over(data: Path) -> None:
    run, key = Store(data).create("D", SETUP, {}), a_key()
    entries = [entry for line in lines(data) if (entry := entry_of(line[:-1])) is not None]
    changed: list[bytes] = []
    for entry in entries:
        said = {name: entry.fields[name] for name in FIELDS[entry.kind]}
        if entry.kind in (CREATED, SEALED):
            forged = said | ({"attempt": 9000} if entry.kind == CREATED else {"sha256": "0" * 64, "verdict": "PASS"})
            copy = signed_entry(entry.kind, entry.counter, entry.fields["previous"], "then", key, **forged)
            changed.append(copy.line + b"\n")
        changed.append(entry.line + b"\n")
    write(data, changed)
    assert kinds(data) == {"unknown_key"}
    assert [row(one).verdict for one in Store(data).runs()] == ["FAIL", "PASS", "PASS", "PASS", None]
    assert "altered" not in here("list", "--data", str(data)).out
    seal(run, state="complete", verdict="PASS")
    assert kinds(data) == {"unknown_key", "altered"}, "the run has no result"
    assert store_run(data, "D", [metric(0.4)]).manifest().attempt == 2


def waiting(run: RunRecord) -> str:
    """Leave a better run.json beside the run's own, as who was killed while he sealed it; return its hash."""
    content = as_json(run.changed_manifest({"state": "complete", "verdict": "PASS", "files": {}}))
    run.write_bytes(CONCLUDED, content)
    return hashlib.sha256(content).hexdigest()


def test_a_line_of_a_foreign_key_concludes_no_run(data: Path) -> None:
    run = Store(data).create("D", SETUP, {})
    said = {"state": "complete", "verdict": "PASS", "created": 1, "sha256": waiting(run), "serial": "D"}
    write(data, [*lines(data), foreign(data, SEALED, run=run.id, **said)])
    assert not finish_seal(run)
    assert not run.has(CONCLUDED)
    assert (row(run).state, row(run).verdict) == ("recording", None)
    assert alterations(run) == ()
    with look_at(data) as view:
        assert view.open == [run.id]
        assert [one.kind for one in view.problems] == [one.kind for one in verify_folder(data).problems]


def test_what_another_bench_has_concluded_stays_for_it(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    another_computer(monkeypatch, tmp_path)
    run = Store(data).create("D", SETUP, {})
    sha256 = waiting(run)
    with writing_to(data) as chain:
        said = {"state": "complete", "verdict": "PASS", "created": 1, "serial": "D", "attempt": 1}
        chain.append(SEALED, run=run.id, sha256=sha256, **said)
    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    assert not finish_seal(run)
    assert run.has(CONCLUDED)
    another_computer(monkeypatch, tmp_path)
    assert finish_seal(run)


def test_what_another_bench_has_concluded_is_not_made_open(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    another_computer(monkeypatch, tmp_path)
    run = store_run(data, "D", [metric(2.0)], failed="lost_motion")
    opened = {name: said for name, said in run.read_json("run.json").items() if name != "files"}
    run.write_json("run.json", opened | {"state": "interrupted", "verdict": None})
    for place in ("another", "place"):
        another_computer(monkeypatch, tmp_path, place)
        assert alterations(run)
        assert [one.run for one in verify_folder(data).problems if one.kind == "altered"] == [run.id]


@pytest.mark.parametrize("manifest", [MANIFEST, CREATED_MANIFEST])
def test_a_run_begun_here_and_concluded_by_an_unknown_bench_is_named_where_its_record_is_open(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, manifest: str
) -> None:
    run = Store(data).create("D", SETUP, {})
    begun = run.read_json(MANIFEST)
    another_computer(monkeypatch, tmp_path)
    trust(last(data).key)
    seal(run, state="complete", verdict="FAIL")
    unknown = own_key().public
    run.remove(MANIFEST)
    run.write_json(manifest, begun)
    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    with look_at(data) as view:
        for problems in (view.problems, verify_folder(data).problems):
            (named,) = [one for one in problems if one.kind == "unknown_key" and one.run]
            assert named.run == run.id
            assert unknown in named.text
            assert "key --trust" in named.sentence
    listed = here("list", "--data", str(data))
    assert any(line.startswith(f"PROBLEM  {run.id}: ") and unknown in line for line in listed.out.splitlines())
    trust(unknown)
    assert not [one for one in verify_folder(data).problems if one.kind == "unknown_key"]


def test_lines_of_an_earlier_program_behind_a_forged_one_are_no_break(data: Path) -> None:
    write(data, [*lines(data), unsigned(data)])
    end = last(data)
    fields = {"first": 1, "last": 1, "sha256": ""}
    lost = signed_entry(LOST, end.counter + 1, end.sha256, "then", own_key(), **fields)
    write(data, [*lines(data), lost.line + b"\n"])
    keep_head(Head(Chain(data).id, lost.counter, lost.sha256, str(data), (own_key().public,)), own_key())
    assert kinds(data) == {"forged_entry", "lost_entries"}
    store_run(data, "D", [metric(0.4)])
    assert kinds(data) == {"forged_entry", "lost_entries"}


def test_an_end_that_was_cut_off_shows_below_a_forged_line(data: Path) -> None:
    line = unsigned(data, counter=NEAR)
    write(data, [*lines(data)[:-1], line])
    assert {"truncated", "forged_entry"} <= kinds(data)


def test_an_unsigned_line_moves_no_run_into_the_future(data: Path) -> None:
    later = datetime.now(UTC) + timedelta(days=365)
    write(data, [*lines(data), unsigned(data, run=f"{later:%Y%m%dT%H%M%S}.000Z-Z")])
    assert Store(data).create("D", SETUP, {}).id < f"{later:%Y}"


def test_two_benches_write_on_behind_each_other_before_anybody_trusts_the_second(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    another_computer(monkeypatch, tmp_path)
    store_run(data, "A", [metric(0.4)])
    second = own_key().public
    monkeypatch.setenv(PLACE, str(tmp_path / "place"))
    assert store_run(data, "A", [metric(0.4)]).manifest().attempt == 4
    assert kinds(data) == {"unknown_key", "altered"}
    trust(second)
    assert kinds(data) == set()
    another_computer(monkeypatch, tmp_path)
    store_run(data, "A", [metric(0.4)])
    assert kinds(data) == set()


def test_a_chain_of_which_no_line_counts_takes_no_run(data: Path) -> None:
    whole, before = lines(data), sorted(data.iterdir())
    write(data, [unsigned(data)])
    with pytest.raises(RecordError, match="no line is signed by a key that this computer trusts"):
        Store(data).create("D", SETUP, {})
    assert sorted(data.iterdir()) == before
    write(data, whole)
    store_run(data, "D", [metric(0.4)])
    assert kinds(data) == set()


def test_a_head_that_no_chain_can_have_keeps_no_run_from_being_measured(data: Path) -> None:
    """Programs that took a forged line for the last one have kept such heads."""
    counter = last(data).counter
    keep_head(Head(Chain(data).id, LARGEST_COUNT + 3, "x", str(data.resolve()), ()), own_key())
    assert head_of(Chain(data).id, data) is None
    place = Store(data).create("D", SETUP, {}).manifest().chain
    assert place is not None
    assert place.counter == counter + 1


def test_a_foreign_attempt_is_none_of_a_serial_number(data: Path) -> None:
    line = foreign(data, serial="A", attempt=LARGEST_COUNT)
    write(data, [*lines(data), line])
    assert store_run(data, "A", [metric(0.4)]).manifest().attempt == 3
    assert kinds(data) == {"unknown_key", "missing"}


def test_attempts_that_have_come_to_their_end_leave_no_folder(data: Path) -> None:
    fields = {"run": RUN, "serial": "A", "attempt": LARGEST_COUNT, "recipe": "r", "bench": "b"}
    end = last(data)
    line = signed_entry(CREATED, end.counter + 1, end.sha256, "then", own_key(), **fields).line
    write(data, [*lines(data), line + b"\n"])
    whole, before = lines(data), sorted(data.iterdir())
    with pytest.raises(RecordError, match=rf"{CHAIN}.*has attempt {LARGEST_COUNT} of A"):
        Store(data).create("A", SETUP, {})
    assert sorted(data.iterdir()) == before
    assert lines(data) == whole
