"""Disks that are full, read-only or slow, each a real one: a small tmpfs, or a C library whose fsync takes seconds."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from lostmotion_command import ROOT, Running, forked, here
from patient import GOLDEN_RECIPE, QUICK_RECIPE, write_changed
from run_samples import read_back

import station.cli.measure.run
from station.atomic_file import Appender, reserve, write_atomic
from station.errors import RecordError
from station.records.samples.check import check_bytes
from station.records.samples.scan_record import RECORD_BYTES

pytestmark = pytest.mark.wires
GOLDEN = str(GOLDEN_RECIPE)
DISK_MB = 48
IN_THE_RAMP = 5800


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of its own, of 48 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "lostmotion-test", str(place)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"a disk of its own cannot be mounted here: {done.stderr.strip()}")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)  # noqa: S607


@pytest.fixture
def begin(start, one_ramp_at_1_ms) -> Callable[[Path], Running]:
    """Start a run that stores on a disk."""
    return lambda data: start("run", *one_ramp_at_1_ms, "--serial", "D", "--json", data=data)


def fill(disk: Path) -> Path:
    """Fill a disk to its last byte, as something else on the computer does; return the file that holds it."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 16))
    assert shutil.disk_usage(disk).free == 0
    return ballast


def recording(data: Path, period_ms: int = 1) -> bool:
    """True once such a run is in its ramp: to bring that torque to zero takes two seconds."""
    size = IN_THE_RAMP // period_ms * RECORD_BYTES
    return any(path.stat().st_size > size for path in data.glob("*/samples.bin"))


def test_a_disk_that_fills_up_stops_the_run_and_loses_nothing(disk, begin):
    run = begin(disk)
    run.wait_for(lambda: recording(disk))
    (manifest,) = disk.glob("*/run.json")
    ring = Path(json.loads(manifest.read_bytes())["ring"])
    assert ring.exists()
    ballast = fill(disk)
    ran = run.finish()
    (folder,) = (path.parent for path in disk.glob("*/run.json"))
    assert ran.exit_code == 4
    assert ran.json["verdict"] == "NOT DECIDABLE"
    (reason,) = ran.json["reasons"]
    for words in ("No space left on device", "torque was brought to zero", "wait in memory", f"conclude {folder.name}"):
        assert words in reason
    assert "stopping: the torque is brought to zero first, because the record cannot be kept" in ran.err
    assert read_back(folder).problems == (), "what was written is whole"
    on_disk = read_back(folder).records
    assert on_disk > 0

    ballast.unlink()
    waiting = here("show", folder.name, "--data", str(disk), "--json").json
    assert (waiting["state"], waiting["waiting"] > 0) == ("not concluded", True)
    assert here("conclude", folder.name, "--data", str(disk)).exit_code == 0
    shown = here("show", folder.name, "--data", str(disk), "--json").json
    assert (shown["state"], shown["verdict"]) == ("stopped", "NOT DECIDABLE")
    assert any("because records could not be written to disk, stopped the run" in one for one in shown["reasons"])
    assert shown["stopped_by"] == "disk"
    assert not any("ended in the middle" in one for one in shown["reasons"]), "the scan came to its end, and said so"
    proof = json.loads((folder / "timing.json").read_bytes())
    assert {"histograms_us", "missed_scans"} & set(proof), proof.keys()
    assert proof["histograms_us"]["work"], "the report of the scan process had its room"
    assert shown["timing"]["wires"], "the report of the scan process had its room"
    whole = read_back(folder, shown["timing"]["scans"])
    assert whole.problems == ()
    assert whole.records > on_disk
    assert here("replay", str(folder)).exit_code == 0
    assert not ring.exists()


def test_a_disk_that_is_full_for_a_moment_costs_the_run_but_no_record(disk, start, one_ramp):
    run = start("run", *one_ramp, "--serial", "D", "--json", data=disk)
    run.wait_for(lambda: recording(disk, period_ms=4))
    ballast = fill(disk)
    size = next(disk.glob("*/samples.bin")).stat().st_size
    time.sleep(0.4)
    assert next(disk.glob("*/samples.bin")).stat().st_size <= size + 4096
    ballast.unlink()
    ran = run.finish()
    result = ran.json
    assert (ran.exit_code, result["state"], result["verdict"]) == (4, "stopped", "NOT DECIDABLE")
    assert any("records could not be written to disk" in one for one in result["reasons"])
    assert result["timing"]["disk"]["refused"] >= 1
    assert read_back(ran.record, result["timing"]["scans"]).problems == ()


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The quick recipe, with a tenth of its scans."""
    target = tmp_path_factory.mktemp("recipe") / "quick.yaml"
    return str(write_changed(QUICK_RECIPE, target, {"sampling": {"period": "10 ms"}}))


UNIT = ("--serial", "SN 1", "--operator", "A. Tester", "--no-report")


@pytest.fixture(scope="module")
def undisturbed(stored_once, recipe):
    return stored_once("undisturbed", recipe, *UNIT)


@pytest.mark.parametrize("pages", [0, 1, 3, 12, 30])
def test_a_disk_that_fills_up_while_a_run_is_concluded_costs_time_and_no_verdict(
    disk, recipe, undisturbed, pages, monkeypatch
):
    """In so many free pages there is room for no file of the conclusion, or for some, or for all but the last."""
    honest = station.cli.measure.run.conclude

    def in_little_room(*args):
        (disk / "ballast").write_bytes(bytes(shutil.disk_usage(disk).free - 4096 * pages))
        return honest(*args)

    with monkeypatch.context() as patched:
        patched.setattr(station.cli.measure.run, "conclude", in_little_room)
        ran = forked("run", recipe, *UNIT, "--virtual-time", "--json", "--data", str(disk))
    (folder,) = (path.parent for path in disk.glob("*/run.json"))
    (disk / "ballast").unlink()
    assert ran.exit_code == 4, ran.err
    assert "Traceback" not in ran.err
    (reason,) = ran.json["reasons"]
    for words in ("No space left on device", f"conclude {folder.name}"):
        assert words in reason
    assert here("conclude", "--all", "--data", str(disk)).exit_code == 0
    shown = here("show", folder.name, "--data", str(disk), "--json").json
    own = ("run", "record")
    expected = here("show", "last", "--data", str(undisturbed.data), "--json").json
    assert expected["verdict"] == "PASS"
    assert {**shown, **dict.fromkeys(own)} == {**expected, **dict.fromkeys(own)}
    assert here("list", "--data", str(disk), "--json").json[0]["state"] == "complete"
    assert here("replay", str(folder)).exit_code == 0
    assert not list(folder.glob(".*.part"))


def test_a_disk_without_room_is_refused_before_anything_moves(disk):
    ballast = fill(disk)
    os.truncate(ballast, ballast.stat().st_size - 4_000_000)
    done = here("run", GOLDEN, "--serial", "D", "--data", str(disk / "runs"))
    assert done.exit_code == 2
    assert "MB free" in done.err
    assert "Free the disk" in done.err
    assert not (disk / "runs").exists()


def test_a_read_only_disk_is_refused_before_anything_moves(disk):
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)  # noqa: S607
    done = here("run", GOLDEN, "--serial", "D", "--data", str(disk))
    assert done.exit_code == 2
    assert "Read-only file system" in done.err
    assert "--data" in done.err
    assert list(disk.iterdir()) == []


def test_a_disk_that_became_read_only_is_not_to_be_freed(disk):
    file = Appender(disk / "samples.bin")
    file.close()
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)  # noqa: S607
    for deed in (
        lambda: write_atomic(disk / "run.json", b"{}"),
        lambda: reserve(disk / "result.json", 4096),
        lambda: Appender(disk / "samples.bin"),
    ):
        with pytest.raises(RecordError, match=r"cannot be written: Read-only file system\. Mount the disk for writing"):
            deed()


def test_a_run_on_a_read_only_disk_is_reported_and_exported_elsewhere(disk, golden_run, tmp_path):
    record = golden_run.copy(disk / "runs")
    for name in ("report.html", "report.pdf"):
        (record / name).unlink(missing_ok=True)
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)  # noqa: S607
    before = sorted(path.name for path in record.iterdir())
    for words in (("report",), ("export", "--out", str(disk)), ("export", "--format", "csv", "--out", str(disk))):
        refused = here(words[0], "last", "--data", str(record.parent), *words[1:])
        assert refused.exit_code == 2, refused
        assert "Read-only file system. Choose another place with --out" in refused.err
    assert here("report", "last", "--data", str(record.parent), "--out", str(tmp_path / "out")).exit_code == 0
    assert (tmp_path / "out" / "report.html").is_file()
    out = tmp_path / "out.parquet"
    assert here("export", "last", "--data", str(record.parent), "--out", str(out)).exit_code == 0
    assert sorted(path.name for path in record.iterdir()) == before


SLOW_LIBRARY = """
#include <sys/syscall.h>
#include <string.h>
#include <stdio.h>
#include <unistd.h>
int fsync(int handle) {
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t size = readlink(link, path, sizeof path - 1);
    path[size < 0 ? 0 : size] = 0;
    if (strstr(path, "samples.bin")) usleep(SLEEP_US);
    return (int)syscall(SYS_fsync, handle);
}
"""


def slow_library(folder: Path, seconds: float) -> Path:
    """Compile a library whose fsync of the samples takes so long."""
    if shutil.which("gcc") is None:
        pytest.skip("a slow disk needs gcc, which is not installed")
    source, library = folder / "slow.c", folder / "slow.so"
    source.write_text(SLOW_LIBRARY.replace("SLEEP_US", str(int(seconds * 1e6))))
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)  # noqa: S607
    return library


SLOW_SUPERVISOR = """
import sys, time
from pathlib import Path
sys.path.insert(0, "tests/station")
from station_samples import IMAGE, ORDERS
from station.atomic_file import Appender
from station.records.ring.to_disk import RecordWriter
from station.records.ring.ring import create
from station.records.ring.reader import RingReader
from station.records.ring.writer import RingWriter
folder, capacity, count = Path(sys.argv[1]), int(sys.argv[2]), 1500
path = create(folder, capacity)
scan, ring = RingWriter(path), RingReader(path)
path.unlink()
writer = RecordWriter(ring, Appender(folder / "samples.bin"))
writer.start()
longest = 0.0
for number in range(count):
    start = time.monotonic()
    scan.append(number, 0, 0, IMAGE, ORDERS)
    ring.beat()
    longest = max(longest, time.monotonic() - start)
    time.sleep(0.001)
writer.finish()
print(writer.written, ring.lost, writer.times.longest_flush_s, writer.times.most_waiting, longest)
print(ring.stopped_because)
"""


@pytest.mark.parametrize(("capacity", "lost"), [(2000, False), (200, True)])
def test_a_slow_disk_is_made_up_for_from_the_ring_or_its_loss_is_told(tmp_path, capacity, lost):
    library = slow_library(tmp_path, 0.8)
    words = [sys.executable, "-c", SLOW_SUPERVISOR, str(tmp_path), str(capacity)]
    environment = os.environ | {"LD_PRELOAD": str(library), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    figures, because = done.stdout.splitlines()
    written, missing, flush_s, most_waiting, longest_s = (float(word) for word in figures.split())
    assert flush_s >= 0.8
    assert written + missing == 1500
    assert most_waiting >= min(capacity, 300), "the slow flush never held anything up"
    assert longest_s < 0.4, "the slow disk held the supervisor"
    assert (missing > 0) is lost
    assert ("records were lost" in because) is lost
    report = check_bytes((tmp_path / "samples.bin").read_bytes(), 1500)
    assert bool(report.problems) is lost, "what is missing is told"
