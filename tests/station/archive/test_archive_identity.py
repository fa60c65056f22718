"""An archive whose share is away is not made anew on the local disk: a marker says which archive it is."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from archives import data_with_archive
from lostmotion_command import here
from stored_runs import metric, store_run

from recipes import RecipeError
from station.archive import push as push_module
from station.archive.check import verify_archive
from station.archive.identity import MARKER
from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import ArchiveError, load_settings
from station.records.archive_note import NOTE, read_note
from station.records.data_folder import Store

RULES = "rules:\n  - {id: old, class: virtual, keep_days: 30, then: nothing, kept_in: archive}\n"


def content(folder: Path) -> dict[str, bytes]:
    return {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*") if one.is_file()}


@pytest.fixture
def bench(tmp_path: Path) -> tuple[Path, Place]:
    """A data folder with three archived runs, the archive being on a share, and two runs since."""
    for number, serial in enumerate(("A", "A", "B")):
        store_run(tmp_path / "made", serial, [metric(0.4)], day=number, virtual="P1")
    (tmp_path / "mnt").mkdir()
    data, place = data_with_archive(tmp_path / "made", tmp_path, str(tmp_path / "mnt" / "archive"))
    assert push(data, place).runs == 3
    for number in range(3, 5):
        store_run(data, f"U{number}", [metric(0.4)], day=number, virtual="P1")
    return data, place


def unmount(data: Path) -> Path:
    """Take the share away: an empty folder is in its place, as below a mount point; return it."""
    (data.parent / "mnt").rename(data.parent / "away")
    (data.parent / "mnt").mkdir()
    return data.parent / "mnt"


def mount(data: Path) -> None:
    shutil.rmtree(data.parent / "mnt")
    (data.parent / "away").rename(data.parent / "mnt")


def test_while_the_share_is_away_nothing_is_archived_counted_or_removed(bench: tuple[Path, Place]) -> None:
    data, place = bench
    (data / "retention.yaml").write_text(RULES, encoding="utf-8")
    empty = unmount(data)
    before = content(data)
    run = Store(data).runs()[0].id
    for words in (
        ("archive", "push"),
        ("archive", "status"),
        ("archive", "verify"),
        ("archive", "fetch", run),
        ("archive", "ask", "SELECT 1"),
        ("retention", "apply", "--operator", "A. Tester"),
    ):
        told = here(*words, "--data", str(data))
        assert told.exit_code == 2, (words, told)
        for text in ("this is not the archive of", "mount it", "--new-archive"):
            assert text in told.err, (words, told)
    assert not list(empty.iterdir())
    kept = content(data)
    assert {name: kept[name] for name in before} == before
    mount(data)
    assert push(data, place).runs == 2
    assert here("archive", "status", "--data", str(data), "--json").json["runs"] == 5
    assert not verify_archive(data, place).problems
    assert "removed" in here("retention", "apply", "--operator", "A. Tester", "--data", str(data)).out


def test_a_share_that_goes_away_in_the_middle_of_a_push_is_seen_before_the_note(
    bench: tuple[Path, Place], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, place = bench
    real, noted = push_module._written, set(read_note(data).runs)

    def away_first(*args: Any) -> Any:
        if not (data.parent / "away").exists():
            unmount(data)
        return real(*args)

    monkeypatch.setattr(push_module, "_written", away_first)
    with pytest.raises(ArchiveError, match="this is not the archive of"):
        push(data, place)
    assert set(read_note(data).runs) == noted


def test_the_place_of_another_archive_is_refused(bench: tuple[Path, Place], tmp_path: Path) -> None:
    data, place = bench
    other, elsewhere = data_with_archive(tmp_path / "made", tmp_path / "second", str(tmp_path / "archive2"))
    push(other, elsewhere)
    (data / "archive.yaml").write_text(f"url: {tmp_path / 'archive2'}\n", encoding="utf-8")
    with pytest.raises(ArchiveError, match=r"has the id [0-9a-f]{32}; expected is the id"):
        push(data, Place(load_settings(data)))
    assert (data / MARKER).read_bytes() == Path(place.path(MARKER)).read_bytes()


def test_a_person_says_that_an_archive_is_a_new_one_and_every_run_is_archived_there(bench: tuple[Path, Place]) -> None:
    data, place = bench
    words = ("archive", "push", "--new-archive", "--data", str(data))
    told = here(*words)
    assert (told.exit_code, "is the archive of this data folder already" in told.err) == (2, True), told
    unmount(data)
    note = (data / NOTE).read_bytes()
    told = here(*words)
    assert (told.exit_code, "runs archived now 5" in told.out) == (0, True), told
    (aside,) = data.glob("archive-until-*.jsonl")
    assert aside.name in told.out.replace("\n", "")
    assert aside.read_bytes() == note
    assert here("archive", "status", "--data", str(data), "--json").json["runs"] == 5
    assert not verify_archive(data, place).problems
    mount(data)
    assert here("archive", "push", "--data", str(data)).exit_code == 2


def without_markers(data: Path, place: Place) -> None:
    """Make an archive one from before there were markers."""
    (data / MARKER).unlink()
    Path(place.path(MARKER)).unlink()


def test_an_archive_from_before_gets_its_marker_only_where_its_oldest_object_is(bench: tuple[Path, Place]) -> None:
    data, place = bench
    without_markers(data, place)
    assert here("archive", "status", "--data", str(data)).exit_code == 0
    assert not (data / MARKER).exists(), "a look writes nothing"
    unmount(data)
    for words in (("archive", "status"), ("archive", "push")):
        told = here(*words, "--data", str(data))
        assert (told.exit_code, "its oldest object" in told.err) == (2, True), told
    assert not (data / MARKER).exists()
    mount(data)
    assert push(data, place).runs == 2
    assert (data / MARKER).read_bytes() == Path(place.path(MARKER)).read_bytes()


def test_what_was_put_on_the_local_disk_before_there_were_markers_is_not_taken_for_the_archive(
    bench: tuple[Path, Place],
) -> None:
    data, place = bench
    without_markers(data, place)
    note = (data / NOTE).read_bytes()
    (data / NOTE).unlink()
    unmount(data)
    for run in [one for one in Store(data).runs() if one.serial() not in ("U3", "U4")]:
        run.folder.rename(data.parent / run.id)
    assert push(data, place).runs == 2  # as the version before did it, onto the local disk
    without_markers(data, place)
    (data / NOTE).write_bytes(note + (data / NOTE).read_bytes())
    with pytest.raises(ArchiveError, match="its oldest object"):
        push(data, place)
    mount(data)
    push(data, place)
    assert {one.kind for one in verify_archive(data, place).problems} == {"missing"}


def test_two_benches_share_an_archive_and_its_marker(bench: tuple[Path, Place], tmp_path: Path) -> None:
    data, place = bench
    store_run(tmp_path / "third", "X", [metric(0.4)])
    other, same = data_with_archive(tmp_path / "third", tmp_path / "fourth", place.settings.url)
    assert push(other, same).runs == 1
    assert (other / MARKER).read_bytes() == (data / MARKER).read_bytes()


def test_a_damaged_marker_is_named(bench: tuple[Path, Place]) -> None:
    data, place = bench
    Path(place.path(MARKER)).write_bytes(b"{")
    with pytest.raises(ArchiveError, match=r"archive-id.json is damaged. Restore it"):
        push(data, place)


def test_while_nothing_is_mounted_at_the_mount_point_not_even_the_first_push_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store_run(tmp_path / "made", "U", [metric(0.4)])
    (tmp_path / "mnt").mkdir()
    data, _ = data_with_archive(tmp_path / "made", tmp_path)
    (data / "archive.yaml").write_text(f"url: {tmp_path}/mnt/archive\nmount_point: {tmp_path}/mnt\n", encoding="utf-8")
    told = here("archive", "push", "--data", str(data))
    assert (told.exit_code, "nothing is mounted there" in told.err) == (2, True), told
    assert not list((tmp_path / "mnt").iterdir())
    monkeypatch.setattr("os.path.ismount", lambda path: path == f"{tmp_path}/mnt")
    assert push(data, Place(load_settings(data))).runs == 1
    for text in (f"url: {tmp_path}/mnt/archive\nmount_point: /other\n", "url: s3://b/x\nmount_point: /mnt\n"):
        (data / "archive.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(RecipeError, match="mount_point"):
            load_settings(data)
