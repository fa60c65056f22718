"""A backup brings back every byte, or nothing at all."""

from __future__ import annotations

import io
import json
import os
import secrets
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
from lostmotion_command import here
from opcua_support import SETTINGS
from station_samples import SETUP
from stored_runs import metric, store_run

import station.cli.store.backup
from station.errors import RecordError, StationError
from station.opcua.certificates import checked_certificate, make_certificate
from station.opcua.settings import load_opcua
from station.records.backup import LIST, back_up, restore
from station.records.chain.chain_file import CHAIN
from station.records.data_folder import Store
from station.records.verify import verify_folder
from station.store.places import FILE as STORE
from station.store.places import STORE_URL
from station.web.people import audit
from station.web.people.database import FILE, StationDatabase


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    for number in range(3):
        store_run(folder, f"U{number}", [metric(0.4)], failed="too wide" if number == 1 else None)
    database = StationDatabase(folder)
    with database.writing() as connection:
        for number in range(5):
            audit.write(connection, "admin", "enter", audit.DONE, {"number": number})
    database.close()
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != ".lock" and ".sqlite3" not in path.name
    }


def head_of(folder: Path) -> audit.Head:
    database = StationDatabase(folder)
    with database.reading() as connection:
        assert audit.problems_of(connection) == []
        head = audit.head_of(connection)
    database.close()
    return head


def test_what_was_wiped_comes_back_as_it_was(data: Path, tmp_path: Path) -> None:
    before, head, file = content(data), head_of(data), tmp_path / "backup.tar"
    made = here("backup", str(file), "--data", str(data), "--json")
    assert made.exit_code == 0, made.err
    shutil.rmtree(data)
    back = here("restore", str(file), "--data", str(data), "--json")
    assert back.exit_code == 0, back.err
    assert content(data) == before
    assert head_of(data) == head
    assert verify_folder(data).problems == []
    told, again = json.loads(made.out), json.loads(back.out)
    assert told["audit"] == again["audit"] == {"lines": 5, "sha256": head.head_sha256}
    assert [told[name] for name in ("runs", "chain_entries", "files")] == [
        again[name] for name in ("runs", "chain_entries", "files")
    ]
    assert [run["verdict"] for run in json.loads(here("list", "--data", str(data), "--json").out)] == [
        "PASS", "FAIL", "PASS",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["a?b", "a#b", "a%20b", "a@b:c"])
def test_accounts_and_audit_trail_are_in_it_whatever_the_folder_is_called(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.delenv(STORE_URL, raising=False)
    head, folder, file = head_of(data), tmp_path / name, tmp_path / "backup.tar"
    data.rename(folder)
    assert here("list", "--data", str(folder)).exit_code == 0
    assert (folder / STORE).is_file()
    assert head_of(folder) == head
    back_up(folder, file)
    restore(file, tmp_path / f"{name} again")
    assert head_of(tmp_path / f"{name} again") == head
    assert {one.name for one in tmp_path.iterdir() if one.suffix != ".tar"} == {name, f"{name} again"}


def test_a_name_that_is_no_text_and_a_damaged_database_are_refused_by_name(data: Path, tmp_path: Path) -> None:
    odd = Path(os.fsdecode(bytes(data) + b"/\xff.txt"))
    odd.touch()
    with pytest.raises(RecordError, match=r"xff\.txt: this name is no UTF-8 text") as told:
        back_up(data, tmp_path / "b.tar")
    assert str(told.value).isprintable()
    odd.unlink()
    (data / FILE).write_bytes(b"this is no database" * 999)
    with pytest.raises(RecordError, match=r"station\.sqlite3: cannot be read as a database"):
        back_up(data, tmp_path / "b.tar")
    assert [one.name for one in tmp_path.iterdir()] == ["runs"]


def test_a_backup_removes_no_part_of_another_one(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = iter(("1111", "2222"))
    monkeypatch.setattr(secrets, "token_hex", lambda _: next(names))
    other = tmp_path / ".b.tar.1111.part"
    other.write_bytes(b"of another one")
    with pytest.raises(RecordError):
        back_up(data, tmp_path / "b.tar")
    assert other.read_bytes() == b"of another one"
    back_up(data, tmp_path / "b.tar")  # what a killed one has left refuses no later one
    assert {one.name for one in tmp_path.iterdir()} == {"runs", "b.tar", other.name}


def test_keys_and_secrets_are_in_it_and_stay_for_their_owner_alone(data: Path, tmp_path: Path) -> None:
    (data / "opcua.yaml").write_text(SETTINGS.format(port=4840), encoding="utf-8")
    (data / "opcua" / "trusted").mkdir(parents=True)
    make_certificate(data, load_opcua(data), ())
    secret = data / "mes-secret"
    secret.write_bytes(b"s" * 32)
    secret.chmod(0o600)
    of_a_group = data / "secret of a group"
    of_a_group.write_bytes(b"g")
    of_a_group.chmod(0o640)
    file, restored = tmp_path / "backup.tar", tmp_path / "restored"
    back_up(data, file)
    assert file.stat().st_mode & 0o777 == 0o600
    restore(file, restored)
    settings = load_opcua(restored)
    checked_certificate(restored, settings)  # refuses a key that others can read
    for name in (settings.key, "mes-secret", of_a_group.name, FILE):
        assert (restored / name).read_bytes() == (data / name).read_bytes() or name == FILE
        assert (restored / name).stat().st_mode & 0o777 == 0o600, name
    assert (restored / settings.certificate).stat().st_mode & 0o777 == 0o644


def test_a_backup_of_an_older_version_does_not_say_what_is_private(data: Path, tmp_path: Path) -> None:
    file, older = tmp_path / "backup.tar", tmp_path / "older.tar"
    back_up(data, file)
    with tarfile.open(file) as there, tarfile.open(older, "w", format=tarfile.PAX_FORMAT) as made:
        for entry in there:
            text = there.extractfile(entry).read()
            if entry.name == LIST:
                text = text.replace(b', "private": true', b"").replace(b', "private": false', b"")
                assert b"private" not in text
            entry.size = len(text)
            made.addfile(entry, io.BytesIO(text))
    restore(older, tmp_path / "restored")
    modes = {one.stat().st_mode & 0o777 for one in (tmp_path / "restored").rglob("*") if one.is_file()}
    assert modes == {0o600}, "any of them may hold a secret"
    assert content(tmp_path / "restored") == content(data)


def test_a_server_that_is_on_does_not_keep_its_accounts_out_of_it(data: Path, tmp_path: Path) -> None:
    database = StationDatabase(data, serving=True)
    with database.writing() as connection:
        audit.write(connection, "admin", "enter", audit.DONE, {})
    back_up(data, tmp_path / "b.tar")
    database.close()
    restore(tmp_path / "b.tar", tmp_path / "again")
    assert head_of(tmp_path / "again").lines == 6
    assert (tmp_path / "again" / FILE).stat().st_mode & 0o077 == 0


def test_a_run_behind_a_link_is_not_left_out_without_a_word(data: Path, tmp_path: Path) -> None:
    run = Store(data).find("last").folder
    run.symlink_to(run.rename(tmp_path / run.name))
    with pytest.raises(StationError, match=f"{run.name}: this is a link"):
        back_up(data, tmp_path / "b.tar")
    assert not (tmp_path / "b.tar").exists()


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def flipped(file: Path) -> None:
    whole = bytearray(file.read_bytes())
    at = whole.index(b"centreline")
    whole[at] ^= 1
    file.write_bytes(whole)


def without_list(file: Path) -> None:
    rewritten(file, lambda name: name != LIST)


def without_one(file: Path) -> None:
    rewritten(file, lambda name: not name.endswith("result.json"))


def rewritten(file: Path, keep: Callable[[str], bool]) -> None:
    other = file.with_name("other.tar")
    with tarfile.open(file) as there, tarfile.open(other, "w") as out:
        for entry in there:
            if keep(entry.name):
                out.addfile(entry, there.extractfile(entry))
    other.replace(file)


def escaping(file: Path) -> None:
    other = file.with_name("other.tar")
    with tarfile.open(other, "w") as out:
        out.addfile(tarfile.TarInfo("../outside"))
    other.replace(file)


def no_tar(file: Path) -> None:
    file.write_text("no archive", encoding="utf-8")


@pytest.mark.parametrize("damage", [cut, flipped, without_list, without_one, escaping, no_tar])
def test_a_backup_that_is_not_whole_leaves_nothing_behind(
    data: Path, tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    file, target = tmp_path / "backup.tar", tmp_path / "place" / "again"
    back_up(data, file)
    damage(file)
    with pytest.raises(StationError):
        restore(file, target)
    assert list((tmp_path / "place").iterdir()) == []
    assert not (tmp_path / "outside").exists()


def test_nothing_is_written_over(data: Path, tmp_path: Path) -> None:
    file = tmp_path / "backup.tar"
    back_up(data, file)
    with pytest.raises(StationError, match="exists already"):
        back_up(data, file)
    with pytest.raises(StationError, match="not empty"):
        restore(file, data)
    with pytest.raises(StationError, match="inside the data folder"):
        back_up(data, data / "backup.tar")


def test_there_is_no_backup_while_a_run_is_on(data: Path, tmp_path: Path) -> None:
    on = Store(data).create("U9", SETUP, {}, own=True)
    with pytest.raises(StationError, match=on.id):
        back_up(data, tmp_path / "backup.tar")
    assert not (tmp_path / "backup.tar").exists()
    on.lock.close()


def test_a_run_that_was_left_behind_long_ago_is_named_and_keeps_no_other_out(data: Path, tmp_path: Path) -> None:
    left = Store(data).create("U9", SETUP, {})
    left.update(desk={"pid": 999_999, "birth": "gone"})
    left.samples.unlink()  # so that nobody can conclude it
    for _ in range(6):
        store_run(data, "U8", [metric(0.5)])
    made = here("backup", str(tmp_path / "b.tar"), "--data", str(data), "--json")
    assert (made.exit_code, made.json["passed"], made.json["not_concluded"]) == (1, True, [left.id])
    back = here("restore", str(tmp_path / "b.tar"), "--data", str(tmp_path / "again"))
    assert back.exit_code == 1
    assert f"conclude {left.id}" in back.out
    assert content(tmp_path / "again") == content(data)
    assert left.lock.take()
    with pytest.raises(StationError, match=left.id):  # somebody concludes it now
        back_up(data, tmp_path / "c.tar")
    left.lock.close()


@pytest.mark.parametrize("folder", ["jogs", "recoveries"])
def test_jogs_and_recoveries_are_in_it_and_none_is_on_meanwhile(data: Path, tmp_path: Path, folder: str) -> None:
    below = data / folder
    store_run(below, "jog", [], state="stopped")
    made = here("backup", str(tmp_path / "b.tar"), "--data", str(data), "--json")
    assert (made.exit_code, made.json[folder]) == (0, 1), made.out + made.err
    assert f"{folder}/{CHAIN}" in content(data)
    restore(tmp_path / "b.tar", tmp_path / "again")
    assert content(tmp_path / "again") == content(data)
    assert here("verify", "--data", str(tmp_path / "again")).exit_code == 0
    on = Store(below).create("jog", SETUP, {}, own=True)
    refused = here("backup", str(tmp_path / "c.tar"), "--data", str(data))
    assert refused.exit_code == 2
    assert f"{folder}/{on.id}" in refused.err
    assert not (tmp_path / "c.tar").exists()
    on.lock.close()


def test_a_damaged_run_keeps_no_other_out_of_the_backup(data: Path, tmp_path: Path) -> None:
    newest = Store(data).newest(1)[-1]
    (newest.folder / "run.json").write_text("{", encoding="utf-8")
    made = here("backup", str(tmp_path / "b.tar"), "--data", str(data))
    assert made.exit_code == 1
    assert newest.id in made.out
    assert here("restore", str(tmp_path / "b.tar"), "--data", str(tmp_path / "again")).exit_code == 1
    assert content(tmp_path / "again") == content(data)


def test_a_disk_that_is_full_leaves_no_half_backup(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tarfile.TarFile, "addfile", full)
    with pytest.raises(StationError, match="No space left"):
        back_up(data, tmp_path / "backup.tar")
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_a_backup_names_the_run_that_it_reaches_where_others_begin_meanwhile(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    newest, later, file = Store(data).newest(1)[0].id, list[str](), tmp_path / "b.tar"

    def begun(_: int) -> None:
        if not later:
            later.append(store_run(data, "LATER", [metric(0.4)]).id)

    with monkeypatch.context() as patched:
        patched.setattr(station.cli.store.backup, "back_up", lambda folder, place: back_up(folder, place, begun))
        made = here("backup", str(file), "--data", str(data), "--json").json
    assert (made["reaches"], made["newer_runs"]) == (newest, 1)
    restored = here("restore", str(file), "--data", str(tmp_path / "again"), "--json")
    assert (restored.exit_code, restored.json["reaches"], restored.json["newer_runs"]) == (0, newest, 0)
    assert later[0] not in restored.out
    now = here("backup", str(tmp_path / "c.tar"), "--data", str(data), "--json").json
    assert (now["reaches"], now["newer_runs"]) == (later[0], 0)
