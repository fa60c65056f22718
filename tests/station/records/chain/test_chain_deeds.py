"""Whatever is done to a chain or to the folders of its runs is named, and forges no verdict."""

from __future__ import annotations

import copy
import hashlib
import json
import operator
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import pytest
from chain_folders import a_key, folder, lines, write
from lostmotion_command import here
from run_copies import alone
from stored_runs import metric, store_run

from station.atomic_file import as_json
from station.documents.manifest import Manifest
from station.documents.reading import document_in
from station.errors import RecordError
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, Chain
from station.records.chain.entries import CREATED, FIELDS, entry_of, signed_entry
from station.records.chain.keys import FOLDER_KEYS, BenchKey, own_key
from station.records.chain.problems import PROBLEMS
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import CONCLUDED, alterations, seal
from station.records.verify import verify_folder
from station.reports.stored_result import stored_result
from station.run.run_list import row
from station.run.way_back.recover import recover

NOBODY = 1 << 22  # no process has this number


def forge(data: Path, key: BenchKey | None = None) -> None:
    """Make a PASS of the first run: result, hashes, verdict, line, and every hash behind it, as far as one can."""
    run = RunRecord(folder(data, 0))
    result = json.loads((run.folder / "result.json").read_text(encoding="utf-8").replace("FAIL", "PASS"))
    run.write_json("result.json", result)
    manifest = run.read_json("run.json")
    content = (run.folder / "result.json").read_bytes()
    files = manifest["files"] | {"result.json": {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}}
    whole = as_json(manifest | {"verdict": "PASS", "files": files})
    (run.folder / "run.json").write_bytes(whole)
    changed, previous = [], ""
    for line in lines(data):
        entry = entry_of(line[:-1])
        assert entry is not None
        fields = entry.fields | {"previous": previous}
        if fields.get("run") == run.id and entry.kind == "sealed":
            fields |= {"sha256": hashlib.sha256(whole).hexdigest(), "verdict": "PASS"}
        own = {name: fields[name] for name in FIELDS[entry.kind]}
        again = signed_entry(entry.kind, entry.counter, previous, fields["time"], key or own_key(), **own)
        if key is None:  # without a key of any kind: the old signatures stay below changed lines
            again = entry_of(again.line.rpartition(b'"signature":"')[0] + b'"signature":"' + b"0" * 128 + b'"}')
            assert again is not None
        changed.append(again.line + b"\n")
        previous = again.sha256
    write(data, changed)


def forge_a_chain(data: Path) -> None:
    """Forge with a key of one's own, in a chain of another id, with that key in the folder."""
    key = a_key()
    write(data, [line.replace(Chain(data).id.encode(), b"ab" * 16) for line in lines(data)])
    (data / FOLDER_KEYS).write_text(f"{key.public}\n")
    forge(data, key)


def forge_an_index(data: Path) -> None:
    """Make the first run one from before the chain, by an index and a first line that nobody has signed."""
    run = RunRecord(folder(data, 0))
    manifest = {key: value for key, value in run.read_json("run.json").items() if key != "chain"} | {"verdict": "PASS"}
    result = (run.folder / "result.json").read_bytes().replace(b"FAIL", b"PASS")
    (run.folder / "result.json").write_bytes(result)
    manifest["files"]["result.json"] = {"sha256": hashlib.sha256(result).hexdigest(), "bytes": len(result)}
    content = as_json(manifest)
    (run.folder / "run.json").write_bytes(content)
    index = as_json({"run": run.id, "sha256": hashlib.sha256(content).hexdigest(), "verdict": "PASS"})
    index = json.dumps(json.loads(index)).encode() + b"\n"
    (data / "index.jsonl").write_bytes(index)
    before = {"bytes": len(index), "sha256": hashlib.sha256(index).hexdigest(), "unconcluded": []}
    start = lines(data)[0].replace(b'"before":null', b'"before":' + json.dumps(before).encode())
    write(data, [start, lines(data)[1], *lines(data)[3:]])


def seal_again(data: Path, changed: list[bytes]) -> None:
    """Leave these lines, alter the first run, and have the bench itself seal it."""
    write(data, changed)
    run = RunRecord(folder(data, 0))
    result = (run.folder / "result.json").read_bytes().replace(b"FAIL", b"PASS")
    (run.folder / "result.json").write_bytes(result)
    seal(run, verdict="PASS")


def bring_to_be_sealed(data: Path) -> None:
    """Copy a run under another id, and have the bench itself seal it, which it refuses."""
    copy = data / "20300101T000000.000Z-A"
    shutil.copytree(folder(data, 2), copy)
    run = RunRecord(copy)
    run.write_json("result.json", run.read_json("result.json") | {"run": run.id})
    with pytest.raises(RecordError, match="no entry that begins this run"):
        seal(run, id=run.id)


def hide_a_deletion(data: Path, content: str) -> None:
    """Delete a FAIL, and leave what a run has whose run.json is about to get its name."""
    lost = folder(data, 0)
    shutil.rmtree(lost)
    lost.mkdir()
    (lost / CREATED_MANIFEST).write_text(content)


def unconclude(run: RunRecord, *, waits: bool) -> None:
    """Make a run.json as it is while a run is recorded; `waits`: beside an empty one that seems to be being sealed."""
    manifest = {key: value for key, value in run.read_json("run.json").items() if key not in ("files", "samples")}
    manifest["desk"] |= {"pid": NOBODY}
    (run.folder / "run.json").write_bytes(as_json(manifest | {"state": "recording", "verdict": None}))
    if waits:
        (run.folder / CONCLUDED).touch()


def swap(one: Path, other: Path) -> None:
    aside = one.with_name("aside")
    one.rename(aside)
    other.rename(one)
    aside.rename(other)


def replace_folder(data: Path) -> None:
    shutil.rmtree(data)
    store_run(data, "A", [metric(0.4)])


DEEDS: dict[str, tuple[Callable[[Path], object], str]] = {
    "delete a FAIL": (lambda data: shutil.rmtree(folder(data, 0)), "missing"),
    "delete a FAIL behind an empty run.json": (lambda data: hide_a_deletion(data, ""), "missing"),
    "delete a FAIL behind a run.json": (
        lambda data: hide_a_deletion(data, (folder(data, 0) / "run.json").read_text(encoding="utf-8")),
        "missing",
    ),
    "put an unconcluded run in its place": (
        lambda data: unconclude(RunRecord(folder(data, 0)), waits=False),
        "altered",
    ),
    "put one there that seems to be being sealed": (
        lambda data: unconclude(RunRecord(folder(data, 0)), waits=True),
        "altered",
    ),
    "delete the newest run": (lambda data: shutil.rmtree(folder(data, -1)), "missing"),
    "delete the newest run and its lines": (
        lambda data: (shutil.rmtree(folder(data, -1)), write(data, lines(data)[:-2])),
        "truncated",
    ),
    "delete a run and its lines": (
        lambda data: (shutil.rmtree(folder(data, 0)), write(data, [lines(data)[0], *lines(data)[3:]])),
        "removed_entries",
    ),
    "delete the chain": (lambda data: (data / CHAIN).unlink(), "no_chain"),
    "empty the chain": (lambda data: write(data, []), "truncated"),
    "write before the first line": (lambda data: write(data, [b"junk\n"] * 4 + lines(data)), "strange_lines"),
    "delete the first line": (lambda data: write(data, lines(data)[1:]), "no_start"),
    "delete the lines of the newest run": (lambda data: write(data, lines(data)[:-2]), "lost_line"),
    "replace the folder": (replace_folder, "replaced"),
    "copy": (lambda data: shutil.copytree(folder(data, 1), data / "20300101T000000.000Z-B"), "copied"),
    "rename": (lambda data: folder(data, 1).rename(data / "20300101T000000.000Z-B"), "renamed"),
    "swap": (lambda data: swap(folder(data, 0), folder(data, 1)), "swapped"),
    "double a line": (lambda data: write(data, [*lines(data), lines(data)[2]]), "reordered_entries"),
    "exchange two lines": (
        lambda data: write(data, [*lines(data)[:3], lines(data)[4], lines(data)[3], *lines(data)[5:]]),
        "reordered_entries",
    ),
    "change a line": (
        lambda data: write(data, [line.replace(b'"verdict":"FAIL"', b'"verdict":"PASS"') for line in lines(data)]),
        "forged_entry",
    ),
    "forge without the key": (forge, "forged_entry"),
    "forge with a key of one's own": (lambda data: forge(data, a_key()), "unknown_key"),
    "forge a chain with a key of one's own": (forge_a_chain, "replaced"),
    "forge an index": (forge_an_index, "forged_entry"),
    "take out a line and have the run sealed again": (
        lambda data: seal_again(data, [*lines(data)[:2], *lines(data)[3:]]),
        "removed_entries",
    ),
    "cut off the end and have the run sealed again": (lambda data: seal_again(data, lines(data)[:2]), "lost_entries"),
    "have a run sealed that nobody began": (bring_to_be_sealed, "copied"),
    "bring a run from elsewhere": (
        lambda data: shutil.copytree(
            store_run(data.parent / "elsewhere", "D", [metric(0.1)]).folder, data / "20300101T000000.000Z-D"
        ),
        "not_in_chain",
    ),
    "edit run.json": (lambda data: RunRecord(folder(data, 0)).update(verdict="PASS"), "altered"),
    "edit a result": (lambda data: (folder(data, 0) / "result.json").write_text("{}"), "altered"),
    "damage run.json": (lambda data: (folder(data, 0) / "run.json").write_text("{"), "damaged"),
}


def test_a_run_is_sealed_once_and_where_it_was_begun(data: Path) -> None:
    chain = (data / CHAIN).read_bytes()
    run = RunRecord(folder(data, 0))
    elsewhere = data.parent / "elsewhere" / run.id
    unconclude(run, waits=True)
    shutil.copytree(run.folder, elsewhere)
    copy = data / "20300101T000000.000Z-A"
    shutil.copytree(run.folder, copy)
    for one in (run, RunRecord(elsewhere), RunRecord(copy)):
        content = (one.folder / "run.json").read_bytes()
        for conclude in (recover, lambda record: seal(record, state="complete", verdict="PASS")):
            with pytest.raises(RecordError):
                conclude(one)
        assert (one.folder / "run.json").read_bytes() == content
    assert (data / CHAIN).read_bytes() == chain
    assert here("conclude", run.id, "--data", str(data)).exit_code != 0
    assert row(store_run(data, "D", [metric(0.4)])).verdict == "PASS"


def test_a_run_that_a_strange_key_began_is_not_sealed(data: Path) -> None:
    copy = data / "20300101T000000.000Z-A"
    shutil.copytree(folder(data, 2), copy)
    run, end = RunRecord(copy), entry_of(lines(data)[-1][:-1])
    assert end is not None
    manifest = run.read_json("run.json") | {"id": run.id}
    parts = {"recipe": manifest["recipe"]["sha256"], "bench": manifest["bench"]["sha256"]}
    begun = signed_entry(
        CREATED, end.counter + 1, end.sha256, "then", a_key(), run=run.id, serial="A", attempt=9, **parts
    )
    write(data, [*lines(data), begun.line + b"\n"])
    place = {"id": Chain(data).id, "counter": begun.counter, "previous": end.sha256}
    run.write_json("run.json", manifest | {"chain": place})
    with pytest.raises(RecordError, match="no entry that begins this run"):
        seal(run)
    assert lines(data)[-1] == begun.line + b"\n"


@pytest.mark.parametrize("put", ["further up", "of another folder"])
def test_a_line_that_was_signed_and_put_there_changes_nothing_once_it_is_gone(data: Path, put: str) -> None:
    store_run(data.parent / "elsewhere", "E", [metric(0.1)])
    line = lines(data)[2] if put == "further up" else lines(data.parent / "elsewhere")[-1]
    write(data, [*lines(data), line])
    assert here("verify", "--data", str(data)).exit_code == 1
    run = store_run(data, "D", [metric(0.4)])
    assert row(run).verdict == "PASS"
    assert "reordered_entries" in {problem.kind for problem in verify_folder(data).problems}
    write(data, [one for number, one in enumerate(lines(data)) if one != line or number < 9])
    assert verify_folder(data).problems == []


def test_an_untouched_folder_passes(data: Path) -> None:
    found = verify_folder(data)
    assert found.problems == []
    assert (found.runs, found.concluded, found.walk.entries) == (4, 4, 9)
    assert found.trust.warning == ""
    assert here("verify", "--data", str(data)).exit_code == 0


@pytest.mark.parametrize("deed", DEEDS)
def test_every_deed_is_named_and_leaves_no_altered_run_its_verdict(data: Path, deed: str) -> None:
    act, kind = DEEDS[deed]
    verdicts = {run.id: run.manifest().verdict for run in Store(data).runs()}
    act(data)
    found = verify_folder(data)
    assert kind in {problem.kind for problem in found.problems}
    ran = here("verify", "--data", str(data), "--json")
    assert (ran.exit_code, ran.json["passed"]) == (1, False)
    assert kind in {problem["kind"] for problem in ran.json["problems"]}
    for run in Store(data).runs():
        shown = row(run).verdict
        assert shown in (None, verdicts.get(run.id), *(["PASS"] if deed == "replace the folder" else []))


def test_every_kind_of_problem_is_met_or_belongs_to_another_test() -> None:
    elsewhere = {"trace", "broken_link", "lost_entries", "old_index", "attempt", "recipes", "archive", "study"}
    elsewhere |= {"unsigned"}
    assert {kind for _, kind in DEEDS.values()} | elsewhere == set(PROBLEMS)


def test_a_changed_line_breaks_the_link_of_the_next_one(data: Path) -> None:
    write(data, [line.replace(b'"time":"20', b'"time":"19', 1) for line in lines(data)[:2]] + lines(data)[2:])
    kinds = {problem.kind for problem in verify_folder(data).problems}
    assert {"forged_entry", "broken_link"} <= kinds


@pytest.mark.parametrize(
    "line",
    [
        b"[" * 100_000,
        b'{"kind":"lost","counter":4,"first":1,"last":"x","sha256":"","time":"","previous":"","key":"","signature":""}',
        b'{"kind":"x","counter":4,"run":abc,"serial":"A"}',
        b'{"kind":"x","counter":4,"run":5,"serial":"A"}',
        b'{"kind":"start","counter":1,"chain":5,"before":5,"replaces":7,"time":"","previous":"","key":5,"signature":1}',
    ],
)
def test_a_line_of_another_shape_stops_no_command(data: Path, line: bytes) -> None:
    for changed in ([*lines(data)[:3], line + b"\n", *lines(data)[3:]], [line + b"\n", *lines(data)]):
        write(data, changed)
        assert here("verify", "--data", str(data)).exit_code in (0, 1)
        assert here("list", "--data", str(data)).exit_code == 0
        assert here("capability", "--metric", "m", "--data", str(data)).exit_code == 2
        assert row(RunRecord(folder(data, 1))).verdict == "PASS"


@pytest.mark.parametrize("name", [CHAIN, FOLDER_KEYS, "run.json", "samples.json", "result.json"])
def test_a_pipe_in_place_of_a_file_is_not_waited_for(data: Path, name: str) -> None:
    path = data / name if (data / name).exists() else folder(data, 0) / name
    path.unlink(missing_ok=True)
    os.mkfifo(path)
    here("verify", "--data", str(data), "--json")
    assert here("list", "--data", str(data)).exit_code in (0, 2)
    if path.parent != data:
        assert row(RunRecord(folder(data, 0))).verdict is None


@pytest.mark.parametrize("chained", [True, False])
@pytest.mark.parametrize("end", [b"\xff", b"\x1b[1A\x1b[2KPASS", b"\n20300101T000000.001Z-B", "\u202e".encode()])
def test_a_folder_whose_name_is_no_text_is_named_and_stops_no_command(data: Path, end: bytes, *, chained: bool) -> None:
    odd = os.fsdecode(os.fsencode(data / "20300101T000000.000Z-") + end)
    shutil.copytree(folder(data, 0), odd)
    if not chained:
        (data / CHAIN).unlink()
    shown = 0 if chained else 3
    for words, code in (("list", 0), ("list --all", 0), ("list --json", 0), ("store rebuild", 0), ("show last", shown)):
        assert here(*words.split(), "--data", str(data)).exit_code == code, words
    (Path(odd) / "run.json").write_text("{}")
    assert here("conclude", "--all", "--data", str(data)).exit_code == 0
    listed = here("list", "--data", str(data)).out
    assert ": the name of this folder is no readable text" in listed
    assert all(line.isprintable() for line in listed.splitlines())
    assert here("verify", "--data", str(data)).exit_code == 1
    problems = [problem for problem in verify_folder(data).problems if "no readable text" in problem.text]
    assert [problem.kind for problem in problems] == ["not_in_chain"]
    run = store_run(data, "B", [metric(0.4)])
    assert row(run).verdict == "PASS"


def texts_of(found: Any, place: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield the places of all texts in plain data."""
    if isinstance(found, str):
        yield place
    parts = found.items() if isinstance(found, dict) else enumerate(found) if isinstance(found, list) else ()
    for name, part in parts:
        yield from texts_of(part, (*place, name))


def forged_at(found: Any, places: Sequence[tuple[str | int, ...]], end: str) -> Any:
    """Return a copy of plain data with an end behind the texts at these places."""
    again = copy.deepcopy(found)
    for place in places:
        holder = reduce(operator.getitem, place[:-1], again)
        holder[place[-1]] += end
    return again


def said_of(manifest: bytes) -> str:
    """Return what is said of a manifest that is refused; nothing of one that is taken."""
    try:
        document_in(Manifest, manifest, Path("run.json"))
    except RecordError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("end", ["\x1b[1A\x1b[2KPASS", "\r20300101T000000.001Z-B", "\u202e", "\x9b2K", "\x7f"])
def test_no_text_of_a_forged_run_moves_the_cursor(data: Path, end: str) -> None:
    run = RunRecord(folder(data, 0))
    whole = run.read_json("run.json") | {"operator": "A", "notes": ["N"], "trouble": "T"}
    said = {place: said_of(as_json(forged_at(whole, [place], end))) for place in texts_of(whole)}
    assert all(text.isprintable() for text in said.values())
    taken, refused = (
        [place for place, text in said.items() if bool(text) == is_refused] for is_refused in (False, True)
    )
    assert {("serial",), ("operator",), ("notes", 0), ("trouble",), ("bench", "name")} <= set(taken)
    for places in (taken, refused):
        (run.folder / "run.json").write_bytes(as_json(forged_at(whole, places, end)))
        for words in (
            "list --all",
            "list --json",
            f"show {run.id}",
            "verify",
            "store rebuild",
            "units",
            "conclude --all",
        ):
            ran = here(*words.split(), "--data", str(data))
            assert all(line.isprintable() for line in (ran.out + ran.err).split("\n")), words


def test_a_head_that_is_no_head_stops_no_command(data: Path, place: Path) -> None:
    for path in (*place.glob("chains/*/*.json"), *place.glob("folders/*.json")):
        path.write_bytes(b"[" * 100_000)
    assert here("list", "--data", str(data)).exit_code == 0


def test_a_copied_run_is_shown_with_its_verdict_where_no_chain_is(data: Path) -> None:
    copy = Store(data).find(str(alone(RunRecord(folder(data, 1))).folder), alone=True)
    assert stored_result(copy).state == "complete"
    assert alterations(copy) == ()
