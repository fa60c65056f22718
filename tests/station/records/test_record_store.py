from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from lostmotion_command import ROOT, here
from station_samples import IMAGE, ORDERS, SETUP

import station.records.data_folder
import station.records.ring.ring
from station.atomic_file import LARGEST_DOCUMENT, NEXT_ACTIONS, Appender, read_from_disk, refused, write_atomic
from station.bench.request import load_job
from station.errors import RecordError, StationError
from station.records.data_folder import Store, check_operator, check_serial
from station.records.process_birth import process_birth
from station.records.ring.ring import ScanState, create
from station.records.ring.writer import RingWriter
from station.records.run_record import RunRecord
from station.records.samples.scan_record import pack
from station.reports.stored_result import stored_result
from station.run.new_record import Wanted, new_record
from station.run.way_back.recover import recover
from station.wall_clock import WallClock

GOLDEN = ROOT / "tests" / "proofs" / "golden" / "golden.yaml"


@pytest.fixture(autouse=True)
def _rings_in_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(station.records.ring.ring, "SHARED_MEMORY", tmp_path / "absent")


def new_run(store: Store, serial: str = "SN1") -> RunRecord:
    return store.create(
        serial, SETUP, {"recipe.yaml": b"text", "bench.yaml": b"text", "profiles/drive.yaml": b"profile"}
    )


def test_a_place_that_takes_and_gives_nothing_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RecordError, match="cannot be written: Not a directory"):
        write_atomic(tmp_path / "file" / "loop.png", b"")


def test_a_new_run_holds_what_was_known_before_it_started(tmp_path: Path) -> None:
    run = new_run(Store(tmp_path))
    assert (run.folder / "recipe.yaml").read_bytes() == b"text"
    assert (run.folder / "profiles" / "drive.yaml").read_bytes() == b"profile"
    assert run.state() == "recording"
    assert run.manifest().attempt == 1


def test_attempts_of_a_serial_are_numbered_and_kept(tmp_path: Path) -> None:
    store = Store(tmp_path)
    runs = [new_run(store, serial) for serial in ("A", "B", "A", "A/", "A_", "A")]
    assert [run.manifest().attempt for run in runs] == [1, 1, 2, 1, 1, 3]
    assert len({run.id for run in runs}) == 6


def test_runs_created_at_once_get_folders_and_attempts_of_their_own(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        runs = list(pool.map(lambda _: new_run(store), range(16)))
    assert len({run.id for run in runs}) == 16
    assert sorted(run.manifest().attempt for run in runs) == list(range(1, 17))


def test_run_ids_sort_by_time(tmp_path: Path) -> None:
    store = Store(tmp_path)
    created = [new_run(store, serial).id for serial in ("Z", "A", "M")]
    assert [run.id for run in store.runs()] == created


def test_run_ids_sort_by_time_also_after_the_clock_was_set_back(tmp_path: Path, monkeypatch) -> None:
    store = Store(tmp_path)
    first = new_run(store).id
    clock = WallClock()
    clock.step(-3600.0)
    monkeypatch.setattr(station.records.data_folder, "WALL_CLOCK", clock)
    created = [first, *(new_run(store, serial).id for serial in ("Z", "A"))]
    assert [run.id for run in store.runs()] == created
    assert store.find("last").id == created[-1], "the recovery after a fault reads how the newest run was left"


@pytest.mark.parametrize("years", [9, 11, 26, 56])
def test_run_ids_sort_by_time_also_where_an_empty_battery_has_set_the_clock_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, years: int
) -> None:
    store = Store(tmp_path)
    created = [new_run(store, "Z").id]
    clock = WallClock()
    clock.step(-years * 365.25 * 86400.0)
    monkeypatch.setattr(station.records.data_folder, "WALL_CLOCK", clock)
    created += [new_run(store, serial).id for serial in ("A", "Z")]
    assert [run.id for run in store.runs()] == created
    assert store.find("Z").id == created[-1], "the newest attempt is the one that counts"
    shutil.rmtree(tmp_path / created.pop())
    created.append(new_run(store, "M").id)
    assert [run.id for run in store.runs()] == created
    assert store.find("last").id == created[-1], "the recovery after a fault reads how the newest run was left"


@pytest.mark.parametrize("serial", ["../../etc", "a b/c:d", ".hidden", "ÄÖ-7", "x" * 128])
def test_any_serial_stays_inside_the_folder(tmp_path: Path, serial: str) -> None:
    store = Store(tmp_path)
    run = new_run(store, check_serial(serial))
    assert run.folder.parent == tmp_path
    assert run.manifest().serial == serial
    assert store.find(serial).id == run.id


@pytest.mark.parametrize("serial", ["", "  ", "a\nb", "x" * 129, "W1 ", " W1", "W1\u3000", "\uff371", "A\u0308"])
def test_serials_that_nobody_can_read_are_refused(serial: str) -> None:
    with pytest.raises(StationError, match="--serial"):
        check_serial(serial)


def test_a_stored_run_is_found_by_a_serial_number_that_no_new_run_may_have(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for serial in ("W1 ", "\uff371"):
        assert store.find(new_run(store, serial).id).serial() == serial
        assert store.find(serial).serial() == serial


def test_runs_are_found_by_id_part_serial_and_last(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first, second = new_run(store, "A1"), new_run(store, "B2")
    assert store.find(first.id).id == first.id
    assert store.find(str(first.folder)).id == first.id
    assert store.find("B2").id == second.id
    assert store.find("last").id == second.id
    with pytest.raises(StationError, match="the ids of 2 runs contain this"):
        store.find("20")
    with pytest.raises(StationError, match="no such run"):
        store.find("nothing")


def test_a_recording_whose_supervisor_is_gone_is_not_concluded(tmp_path: Path) -> None:
    run = new_run(Store(tmp_path))
    gone = subprocess.Popen([sys.executable, "-c", "pass"])
    gone.wait()
    run.update(desk={"pid": gone.pid, "birth": "1"})
    assert run.state() == "not concluded"
    run.update(desk={"pid": os.getpid(), "birth": "another process had this id"})
    assert run.state() == "not concluded"
    run.update(desk={"pid": os.getpid(), "birth": process_birth(os.getpid())})
    assert run.state() == "recording"


def test_a_scan_process_is_told_while_it_lives(tmp_path: Path) -> None:
    run = new_run(Store(tmp_path))
    assert run.scanning() == 0
    run.write_json("scan-report.json", {"state": "running", "pid": os.getpid(), "birth": process_birth(os.getpid())})
    assert run.scanning() == os.getpid()
    assert f"still running (pid {os.getpid()})" in stored_result(run).reasons[0]
    run.write_json("scan-report.json", {"state": "running", "pid": os.getpid(), "birth": "another's"})
    assert run.scanning() == 0


def test_a_failed_write_leaves_the_old_file_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.json"
    write_atomic(path, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RecordError, match="No space left on device"):
        write_atomic(path, b"new")
    monkeypatch.undo()
    assert read_from_disk(path) == b"old"
    assert [item.name for item in tmp_path.iterdir()] == ["run.json"]


def test_no_more_than_is_asked_for_is_read_from_the_disk(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.touch()
    os.truncate(path, LARGEST_DOCUMENT + 1)  # takes no room on the disk
    with pytest.raises(RecordError, match=f"{path}: cannot be read: this file is larger than"):
        read_from_disk(path)
    os.truncate(path, 9)
    assert read_from_disk(path, 9) == read_from_disk(path, None) == bytes(9)
    with pytest.raises(RecordError, match="larger than"):
        read_from_disk(path, 8)


@pytest.mark.parametrize(
    ("number", "action"),
    [
        (errno.ENOSPC, "No space left on device. Free space on this disk"),
        (errno.EDQUOT, "quota"),
        (errno.EROFS, "Read-only file system. Mount the disk for writing"),
        (errno.EIO, "Input/output error. The disk failed"),
        (errno.EACCES, "Permission denied. Give this user write permission"),
        (errno.EPERM, "Operation not permitted. Give this user write permission"),
        (errno.ENOENT, "No such file or directory. Restore what is missing of this path, from a backup"),
        (errno.ENOTDIR, "Not a directory. Restore what is missing of this path, from a backup"),
        (errno.EFBIG, "File too large. Check the disk"),
    ],
)
def test_what_to_do_about_a_disk_depends_on_what_it_answered(tmp_path: Path, number: int, action: str) -> None:
    for deed in ("written", "flushed", "read"):
        text = str(refused(tmp_path / "samples.bin", OSError(number, os.strerror(number)), deed))
        assert text.startswith(f"{tmp_path}/samples.bin: cannot be {deed}: ")
        assert (action.replace("write permission", "read permission") if deed == "read" else action) in text
        assert ("Free" in text) is (number in (errno.ENOSPC, errno.EDQUOT))
        assert (number in NEXT_ACTIONS) is (not text.endswith("Check the disk"))


def deleted(path: Path) -> None:
    path.unlink()


def moved(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))


def replaced(path: Path) -> None:
    path.with_name("other").write_bytes(b"")
    path.with_name("other").rename(path)


def without_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


@pytest.mark.parametrize("vanish", [deleted, moved, replaced, without_folder])
def test_a_file_that_vanishes_while_it_is_written_takes_nothing_more(
    tmp_path: Path, vanish: Callable[[Path], None]
) -> None:
    path = tmp_path / "run" / "samples.bin"
    path.parent.mkdir()
    file = Appender(path)
    file.write(b"one")
    file.sync()
    vanish(path)
    for deed in (lambda: file.write(b"two"), file.sync):
        with pytest.raises(RecordError, match="was deleted, moved or replaced while the program was writing it"):
            deed()


def test_a_file_that_is_put_back_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "samples.bin"
    file = Appender(path)
    path.rename(tmp_path / "elsewhere")
    with pytest.raises(RecordError, match=r"samples\.bin: this file was deleted, moved"):
        file.write(b"one")
    (tmp_path / "elsewhere").rename(path)
    file.write(b"two")
    file.close()
    assert path.read_bytes() == b"two"


def test_a_file_that_must_be_there_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="No such file"):
        Appender(tmp_path / "samples.bin", must_exist=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["99991231T235959.999Z-X", "99991231T235959.998Z-X", "zz-Z-X", "2026Z-Z-"])
def test_a_folder_that_no_clock_has_named_keeps_nobody_from_measuring(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "run.json").write_text("{}")
    store = Store(tmp_path)
    first, second = new_run(store).id, new_run(store).id
    assert first < second < "2100"


def test_a_link_in_place_of_the_lock_is_followed_by_nobody(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.write_text("as it was")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / ".lock").symlink_to(target)
    with pytest.raises(RecordError, match="Too many levels of symbolic links"):
        new_run(Store(tmp_path / "runs"))
    assert target.read_text() == "as it was"


def test_a_full_device_is_to_be_freed() -> None:
    file = Appender(Path("/dev/full"))
    with pytest.raises(
        RecordError, match=r"/dev/full: cannot be written: No space left on device\. Free space on this disk"
    ):
        file.write(b"record")


def test_a_damaged_manifest_is_told_not_thrown(tmp_path: Path) -> None:
    run = new_run(Store(tmp_path))
    (run.folder / "run.json").write_text("{")
    with pytest.raises(RecordError, match="is damaged"):
        run.manifest()


@pytest.mark.parametrize("damage", ['{"serial": "SN1"}', "[]", "{", '{"serial": "SN1", "attempt": "x", "state": 1}'])
def test_a_damaged_run_does_not_keep_its_serial_from_being_measured(tmp_path: Path, damage: str) -> None:
    store = Store(tmp_path)
    first, damaged = new_run(store), new_run(store)
    (damaged.folder / "run.json").write_text(damage)
    assert new_run(store).manifest().attempt == 3
    assert first.manifest().attempt == 1
    for look in (damaged.manifest, damaged.state):
        with pytest.raises(RecordError, match="is damaged"):
            look()


def test_an_unwritable_place_is_told(tmp_path: Path) -> None:
    place = tmp_path / "file"
    place.write_text("")
    with pytest.raises(RecordError, match="cannot be written"):
        new_run(Store(place / "runs"))


@pytest.mark.parametrize("on_disk", [0, 3, 5])
def test_a_dead_supervisor_and_a_dead_scan_lose_no_record(tmp_path: Path, on_disk: int) -> None:
    """The supervisor had written `on_disk` records to the file, and died before it could note that in the ring."""
    run = new_run(Store(tmp_path))
    ring = create(tmp_path, 16)
    writer = RingWriter(ring)
    for scan in range(5):
        writer.append(scan, 0, 0, IMAGE, ORDERS)
    writer.set_state(ScanState.RUNNING)
    writer._words[9] = 0  # the scan process is gone as well
    writer.close()
    file = Appender(run.samples)
    file.write(b"".join(pack((scan, scan, 0, 0), IMAGE, ORDERS) for scan in range(on_disk)))
    file.close()
    run.update(ring=str(ring), desk={"pid": 1, "birth": "0"})
    assert recover(run) == 5 - on_disk
    assert run.samples.read_bytes() == b"".join(pack((scan, scan, 0, 0), IMAGE, ORDERS) for scan in range(5))
    assert not ring.exists()
    assert recover(run) == 0


def test_nothing_is_taken_from_a_run_that_is_going_on(tmp_path: Path) -> None:
    run = new_run(Store(tmp_path))
    ring = create(tmp_path, 16)
    run.update(ring=str(ring))
    assert recover(run) == 0
    assert ring.exists()


def test_json_files_hold_the_signs_of_the_field(tmp_path: Path) -> None:
    run = new_run(Store(tmp_path))
    run.write_json("x.json", {"unit": "N·m"})
    assert "N·m" in (run.folder / "x.json").read_text()
    assert json.loads((run.folder / "x.json").read_text()) == {"unit": "N·m"}


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "x" * 200])
def test_an_operator_has_a_name(name: str) -> None:
    with pytest.raises(StationError, match="--operator: found"):
        check_operator(name)


def test_who_measured_stands_in_the_record(tmp_path: Path) -> None:
    job = load_job("rv-40e-121-quick", None)
    record = new_record(tmp_path, job, Wanted("S1", None, None, "Ada L.", clock="virtual"), notes=[])
    assert record.manifest().operator == "Ada L."
    record.lock.close()


def test_a_serial_number_that_differs_by_case_only_is_known(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for serial in ("W1", "X-W1", "w2", "A/1", "A_1"):
        store.create(serial, SETUP, {})
    found = {one: Store(tmp_path).other_case_of(one) for one in ("w1", "W1", "x-w1", "W3", "w2", "a/1")}
    assert found == {"w1": "W1", "W1": "", "x-w1": "X-W1", "W3": "", "w2": "", "a/1": "A/1"}
    told = here("run", str(GOLDEN), "--serial", "w1", "--virtual-time", "--no-report", "--data", str(tmp_path))
    assert "unit W1 is known here, and this is unit w1" in told.err + told.out
