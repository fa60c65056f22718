"""The archive of a plant: the same bytes in and out, whoever is killed when, and every damage has its name."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from archives import data_with_archive, kill_at, killed
from lostmotion_command import ROOT, here
from stored_runs import START, metric, store_run

from recipes import RecipeError
from station.archive import push as push_module
from station.archive.ask import ask
from station.archive.check import verify_archive
from station.archive.fetch import fetch, why_not_archived
from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import ArchiveError, ArchiveSettings, load_settings
from station.errors import StationError
from station.records.archive_note import NOTE, read_note
from station.records.chain.chain_file import Chain
from station.records.data_folder import Store
from station.records.seal import alterations
from station.records.verify import verify_folder
from station.store.outbox import rebuild
from station.store.retention import apply, load_rules, plan
from station.store.table_counts import all_rows
from station.store.view import look_at, opened

GOLDEN = ROOT / "tests" / "proofs" / "golden" / "golden.yaml"
RULES = "rules:\n  - {id: old, class: virtual, keep_days: 30, then: nothing, kept_in: archive}\n"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run, and four small ones of two hours.

    In a chain of their own: of copies of one chain, what is written to the second stands behind what was cut off it.
    """
    data = tmp_path_factory.mktemp("archive") / "runs"
    ran = here("run", str(GOLDEN), "--serial", "R", "--virtual-time", "--no-report", "--data", str(data))
    assert ran.exit_code in (0, 3), ran
    for number, day in enumerate((0.0, 0.001, 0.002, 1.0)):
        store_run(data, f"U{number}", [metric(0.4 + 0.01 * number, uncertainty=0.02)], day=day, virtual="P1")
    return data


@pytest.fixture(scope="module")
def archived(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with all of it archived; the archive lies beside it and is named by its whole path."""
    data, place = data_with_archive(runs, tmp_path_factory.mktemp("archived"))
    assert push(data, place).runs == 5
    return data


def copy_of(archived: Path, tmp_path: Path) -> tuple[Path, Place]:
    """Copy data folder and archive: the note goes on naming the URL that it was written to."""
    data = Path(shutil.copytree(archived, tmp_path / "runs"))
    shutil.copytree(archived.parent / "archive", tmp_path / "archive")
    url = str(tmp_path / "archive")
    note = (data / NOTE).read_text(encoding="utf-8").replace(str(archived.parent / "archive"), url)
    (data / NOTE).write_text(note, encoding="utf-8")
    (data / "archive.yaml").write_text(f"url: {url}\n", encoding="utf-8")
    return data, Place(load_settings(data))


def content(folder: Path) -> dict[str, bytes]:
    return {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*") if one.is_file()}


def golden(data: Path) -> Path:
    return next(run.folder for run in Store(data).runs() if run.serial() == "R")


def objects(place: Place, kind: str = "full") -> list[Path]:
    return sorted(Path(place.settings.root, kind).rglob("*.parquet"))


def test_each_bench_and_hour_has_an_object_and_a_second_push_does_nothing(archived: Path, tmp_path: Path) -> None:
    data, place = copy_of(archived, tmp_path)
    assert sorted(len(line.runs) for line in read_note(data).lines) == [1, 1, 3]
    assert len(objects(place)) == 3
    assert len(objects(place, "trace")) == 1, "a run without samples has no trace"
    before = content(tmp_path)
    assert push(data, place).runs == 0
    assert {name: one for name, one in content(tmp_path).items() if not name.endswith(".lock")} == {
        name: one for name, one in before.items() if not name.endswith(".lock")
    }
    assert not verify_archive(data, place).problems


def test_a_copy_takes_the_place_of_the_record_by_rule_and_comes_back_the_same(archived: Path, tmp_path: Path) -> None:
    data, place = copy_of(archived, tmp_path)
    run = golden(data)
    before, verdict = content(run), Store(data).find(run.name).manifest().verdict
    replayed = here("replay", run.name, "--data", str(data), "--json").json
    (data / "retention.yaml").write_text(RULES, encoding="utf-8")
    (only,) = [one for one in plan(data, load_rules(data), START + timedelta(days=3000)) if one.run == run.name]
    assert "newest run of its bench" in only.why_not
    planned = [only._replace(why_not="")]  # as if another one had come behind it
    refused = apply(data, planned, {}, "A. Tester", why_not_archived=lambda _: "differs")
    assert (len(refused.removed), run.exists()) == (0, True)
    removed = apply(
        data, planned, {}, "A. Tester", why_not_archived=lambda one: why_not_archived(data, place, one)
    ).removed
    assert ([one.run for one in removed], run.exists()) == ([run.name], False)
    for command in ("show", "replay"):
        told = here(command, run.name, "--data", str(data))
        assert (told.exit_code, f"lostmotion archive fetch {run.name}" in told.err) == (2, True), told
    found = verify_folder(data)
    assert (found.removed, found.problems) == (1, [])
    assert "1 of them only in the archive" in here("verify", "--data", str(data)).out
    fetched = here("archive", "fetch", run.name, "--data", str(data))
    assert fetched.exit_code == 0, fetched
    same = {name: one for name, one in before.items() if name != ".owner"}
    assert content(run) == same
    record = Store(data).find(run.name)
    assert (record.manifest().verdict, alterations(record)) == (verdict, ())
    again = here("replay", run.name, "--data", str(data), "--json")
    assert again.exit_code == 0
    assert again.json["identical_scans"] == replayed["identical_scans"]
    assert not verify_folder(data).problems
    with pytest.raises(ArchiveError, match=r"is already in the data folder"):
        fetch(data, place, run.name)


def test_the_command_removes_what_the_archive_holds_and_asks_for_a_backup_where_a_rule_does(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    for number, serial in enumerate(("A", "A", "B")):
        store_run(data, serial, [metric(0.4)], day=number, virtual="P1")
    (data / "archive.yaml").write_text(f"url: {tmp_path / 'archive'}\n", encoding="utf-8")
    words = ("retention", "apply", "--operator", "A. Tester", "--data", str(data))
    (data / "retention.yaml").write_text(RULES.replace(", kept_in: archive", ""), encoding="utf-8")
    told = here(*words)
    assert (told.exit_code, "--backup is missing" in told.err) == (2, True), told
    (data / "retention.yaml").write_text(RULES, encoding="utf-8")
    told = here(*words)
    assert (told.exit_code, "is not in the archive" in told.out) == (1, True), told
    assert here("archive", "push", "--data", str(data)).exit_code == 0
    first = Store(data).runs()[0]
    told = here(*words)
    assert "1 run removed" in told.out, told
    assert not first.folder.exists()
    assert here("archive", "status", "--data", str(data), "--json").json["only_archived"] == 1
    with look_at(data) as view:
        assert view.problems == []


KILLS = {
    "before anything is put": (Place, "put", True),
    "when the temporary name is written": (Place, "_upload", False),
    "when the records are in place": (Place, "put", False),
    "before the note": (push_module, "add_to_note", True),
    "behind the note": (push_module, "add_to_note", False),
}


@pytest.mark.parametrize("moment", KILLS)
def test_who_is_killed_loses_nothing_and_doubles_nothing(
    runs: Path, tmp_path: Path, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, place = data_with_archive(runs, tmp_path)
    with monkeypatch.context() as patched:
        owner, name, before = KILLS[moment]
        kill_at(patched, owner, name, before=before)
        killed(lambda: push(data, place))
    push(data, place)
    noted = [run.run for line in read_note(data).lines for run in line.runs]
    assert sorted(noted) == sorted(run.id for run in Store(data).runs())
    rows = ask(place, "SELECT run, count(*) FROM runs GROUP BY run", 100).rows
    assert sorted(rows) == [(run, 1) for run in sorted(noted)]
    assert not [one for one in tmp_path.rglob("incoming/**/*") if one.is_file()]
    assert not list(data.glob(".archiving-*"))
    assert not verify_archive(data, place).problems


def test_a_torn_line_of_the_note_is_found_again(runs: Path, tmp_path: Path) -> None:
    data, place = data_with_archive(runs, tmp_path)
    push(data, place)
    whole = (data / NOTE).read_bytes()
    (data / NOTE).write_bytes(whole[:-40])
    assert len(read_note(data).lines) == 2
    again = push(data, place)
    assert (len(again.found), len(again.lines)) == (1, 0)
    assert set(read_note(data).runs) == {run.id for run in Store(data).runs()}
    assert read_note(data).lines[-1].full == json_line(whole)


def json_line(whole: bytes) -> Any:
    from station.documents.archived import ArchiveLine  # noqa: PLC0415
    from station.documents.reading import document_in  # noqa: PLC0415

    return document_in(ArchiveLine, whole.splitlines()[-1], Path(NOTE)).full


def test_a_byte_that_was_changed_is_named_with_its_run_and_nothing_is_removed_for_it(
    archived: Path, tmp_path: Path
) -> None:
    data, place = copy_of(archived, tmp_path)
    run = golden(data)
    name = read_note(data).runs[run.name].line.full.name
    path = Path(place.path(name))
    bad = bytearray(path.read_bytes())
    bad[len(bad) // 2] ^= 1
    path.write_bytes(bad)
    (problem,) = verify_archive(data, place).problems
    assert (problem.kind, problem.object) == ("changed", name)
    assert run.name in problem.text
    assert "was changed or damaged" in why_not_archived(data, place, Store(data).find(run.name))
    shutil.move(run, tmp_path / "kept")
    with pytest.raises(ArchiveError, match="changed or damaged"):
        fetch(data, place, run.name)
    assert not run.exists()
    told = here("archive", "verify", "--data", str(data))
    assert (told.exit_code, "NOT PASSED: 1 problem" in told.out) == (1, True)


def test_objects_that_are_half_there_gone_or_strange_are_named(archived: Path, tmp_path: Path) -> None:
    data, place = copy_of(archived, tmp_path)
    first, second, third = objects(place)
    first.write_bytes(first.read_bytes()[:-100])
    second.unlink()
    (third.parent / "part-of-nobody.parquet").write_bytes(b"PAR1")
    found = {one.kind: one for one in verify_archive(data, place).problems}
    assert set(found) == {"changed", "missing", "strange"}
    assert "part-of-nobody" in found["strange"].text
    lost = next(run for run, one in read_note(data).runs.items() if second.name in one.line.full.name)
    assert "is missing" in why_not_archived(data, place, Store(data).find(lost))


def test_a_run_that_is_not_as_it_was_sealed_is_left_out(runs: Path, tmp_path: Path) -> None:
    data, place = data_with_archive(runs, tmp_path)
    run = next(one for one in Store(data).runs() if one.serial() == "U1")
    (run.folder / "result.json").write_bytes((run.folder / "result.json").read_bytes() + b" ")
    done = push(data, place)
    assert [one.run for one in done.left_out] == [run.id]
    assert "result.json" in done.left_out[0].why
    assert done.runs == 4
    told = here("archive", "push", "--data", str(data))
    assert (told.exit_code, "left out: " in told.out) == (1, True)


def test_the_store_keeps_the_addresses_and_finds_them_again(archived: Path, tmp_path: Path) -> None:
    data, place = copy_of(archived, tmp_path)
    here("archive", "status", "--data", str(data))
    database, chain = opened(data), Chain(data)
    with look_at(data):
        pass
    rows = all_rows(database, chain)
    assert {row[1] for row in rows["archived"]} == {run.id for run in Store(data).runs()}
    rebuild(database, chain)
    assert all_rows(database, chain) == rows
    (data / NOTE).unlink()
    assert verify_archive(data, place).noted_again == 3
    rebuild(database, chain)
    database.close()
    without = slice(0, -1)  # the moment at which an object was compared is another one
    again = opened(data)
    assert [row[without] for row in all_rows(again, chain)["archived"]] == [row[without] for row in rows["archived"]]
    again.close()


def test_questions_in_sql_read_the_archive_and_nothing_else(archived: Path, tmp_path: Path) -> None:
    data, place = copy_of(archived, tmp_path)
    assert ask(place, "SELECT verdict, count(*) FROM runs WHERE serial LIKE 'U%' GROUP BY 1", 9).rows == (("PASS", 4),)
    values = ask(place, "SELECT value FROM metrics WHERE main AND run LIKE '%-U_' ORDER BY 1", 9).rows
    assert [round(row[0], 2) for row in values] == [0.4, 0.41, 0.42, 0.43]
    samples = ask(place, "SELECT count(*), max(torque_out_nm) FROM traces", 9).rows[0]
    assert samples[0] > 1000
    assert ask(place, "SELECT name FROM files WHERE run LIKE '%-R'", 3).more
    for sql in (
        "SELECT * FROM read_csv('/etc/passwd')",
        f"COPY runs TO '{tmp_path}/x.csv'",
        "SELECT nothing FROM runs",
    ):
        with pytest.raises(ArchiveError, match="runs, metrics"):
            ask(place, sql, 9)
    for nothing in ("", " ", ";", "-- a remark"):
        with pytest.raises(ArchiveError, match="is empty"):
            ask(place, nothing, 9)
    told = here("archive", "ask", "SELECT serial FROM runs ORDER BY 1", "--csv", "--data", str(data))
    assert told.out.splitlines()[:2] == ["serial", "R"]


SETTINGS = {
    "no url": ("region: x\n", "url"),
    "no scheme that is known": ("url: ftp://x/y\n", "s3://BUCKET/FOLDER"),
    "a relative folder": ("url: archive\n", "s3://BUCKET/FOLDER"),
    "credentials in the URL": ("url: s3://key:secret@bucket/x\n", "a URL with credentials"),
    "a secret in the file": ("url: s3://b/x\nkey_from: K\nsecret_from: wJalrXUtnFEMI/K7\n", "holds no secret"),
    "an access key in the file": ("url: s3://b/x\nkey_from: AKIAIOSFODNN7EXAMPLE\nsecret_from: S\n", "holds no secret"),
    "half of the credentials": ("url: s3://b/x\nkey_from: K\n", "both or none"),
    "an open line to elsewhere": ("url: s3://b/x\nendpoint: http://plant.example:9000\n", "https"),
    "S3's options for a folder": ("url: /mnt/x\nregion: eu\n", "region with a url that is a folder"),
    "too many runs": ("url: /mnt/x\nruns_per_object: 0\n", "runs_per_object"),
    "a word that is none": ("url: /mnt/x\nfolder: y\n", "folder"),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_settings_that_are_wrong_are_refused_without_showing_a_secret(tmp_path: Path, case: str) -> None:
    text, told = SETTINGS[case]
    (tmp_path / "archive.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RecipeError) as refused:
        load_settings(tmp_path)
    assert told in str(refused.value)
    assert not any(secret in str(refused.value) for secret in ("wJalr", "AKIA", "secret@"))


def test_places_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="Make this file with one line, where the archive is"):
        load_settings(tmp_path)
    (tmp_path / "archive.yaml").write_text(f"url: {tmp_path / 'inside'}\n", encoding="utf-8")
    with pytest.raises(ArchiveError, match="is inside the data folder"):
        load_settings(tmp_path)
    with pytest.raises(ArchiveError, match="NOT_SET_HERE is not set"):
        Place(ArchiveSettings(url="s3://b/x", key_from="NOT_SET_HERE", secret_from="NOT_SET_HERE"))  # noqa: S106
    with pytest.raises(StationError, match="no such folder"):
        load_settings(tmp_path / "nowhere")
