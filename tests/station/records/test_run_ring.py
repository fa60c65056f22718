"""Rings that killed runs left in shared memory: which are collected, and which somebody still needs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from station_samples import IMAGE, ORDERS, SETUP

from station.errors import RecordError
from station.records.data_folder import Store
from station.records.ring.ring import W_PID, W_READ, W_RUN_DEVICE, W_WRITTEN, create
from station.records.ring.writer import RingWriter
from station.records.run_record import RunRecord
from station.records.run_ring import GONE_FOR_S, collect_rings, records_waiting, ring_head, ring_of
from station.records.seal import seal
from station.wall_clock import WallClock

DEAD = {"pid": 999_999, "birth": "another process"}


@pytest.fixture(autouse=True)
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "memory"
    place.mkdir()
    monkeypatch.setattr("station.records.ring.ring.SHARED_MEMORY", place)
    return place


@pytest.fixture
def run(tmp_path: Path) -> RunRecord:
    """A run with three records in its ring, supervisor and scan process dead."""
    found = Store(tmp_path / "runs").create("S", SETUP, {"recipe.yaml": b"r", "bench.yaml": b"b"})
    ring = create(tmp_path, 8, run=found.folder)
    writer = RingWriter(ring)
    for scan in range(3):
        writer.append(scan, 0, 0, IMAGE, ORDERS)
    writer._words[W_PID] = 0
    writer.close()
    found.update(ring=str(ring), desk=DEAD)
    return found


def ring(run: RunRecord) -> Path:
    return Path(run.manifest().ring)


def alive(run: RunRecord) -> None:
    writer = RingWriter(ring(run))
    writer._words[W_PID] = os.getpid()
    writer.close()


def nothing_waits(run: RunRecord) -> None:
    writer = RingWriter(ring(run))
    writer._words[W_READ], writer._words[W_PID] = writer._words[W_WRITTEN], 0
    writer.close()


def concluded(run: RunRecord) -> None:
    path = ring(run)
    kept = path.read_bytes()
    seal(run, state="interrupted", verdict="NOT DECIDABLE", records=0)
    path.write_bytes(kept)  # as by a process that was killed before it removed it


def owned(run: RunRecord) -> None:
    assert run.lock.take()
    run.update(ring=None)


@pytest.mark.parametrize(
    ("what", "gone"),
    [
        (lambda _run: None, False),
        (alive, False),
        (owned, False),
        (concluded, True),
        (lambda run: run.update(ring=None), True),
        (lambda run: (nothing_waits(run), shutil.rmtree(run.folder)), True),
        (lambda run: (nothing_waits(run), shutil.rmtree(run.folder.parent)), True),
        (lambda run: shutil.rmtree(run.folder), False),
        (lambda run: (run.folder / "run.json").write_text("{"), False),
        (lambda run: (alive(run), shutil.rmtree(run.folder)), False),
    ],
    ids=[
        "deserted",
        "scanning",
        "owned",
        "concluded",
        "not its own",
        "folder gone",
        "all gone",
        "perhaps moved",
        "damaged",
        "alive",
    ],
)
def test_a_ring_is_collected_when_nobody_needs_it(
    run: RunRecord, memory: Path, what: Callable[[RunRecord], object], *, gone: bool
) -> None:
    path = ring(run)
    what(run)
    assert collect_rings() == ([path] if gone else [])
    assert path.exists() is not gone
    run.lock.close()
    assert set(memory.iterdir()) == (set() if gone else {path})


def test_a_disk_that_is_not_mounted_takes_no_ring_with_it(run: RunRecord) -> None:
    path = ring(run)
    writer = RingWriter(path)
    writer._words[W_RUN_DEVICE] += 1  # the folder was on another disk than what stands there now
    writer.close()
    shutil.rmtree(run.folder.parent)
    assert collect_rings() == []


def test_a_ring_in_which_records_of_a_moved_run_wait_stays_for_an_hour(
    run: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, clock = ring(run), WallClock()
    monkeypatch.setattr("station.records.run_ring.WALL_CLOCK", clock)
    run.folder.rename(tmp_path / run.id)
    for seconds in (0.0, GONE_FOR_S / 2, GONE_FOR_S / 4):
        clock.step(seconds)
        assert collect_rings() == []
    clock.step(-10.0 * GONE_FOR_S)  # set back: counted anew
    assert collect_rings() == []
    clock.step(1.1 * GONE_FOR_S)
    assert collect_rings({str(path)}) == [], "a run in the data folder names it"
    assert collect_rings() == [path]


def test_what_is_no_ring_of_this_program_is_left_alone(memory: Path, tmp_path: Path) -> None:
    (memory / "lostmotion-ring-other").write_bytes(b"something else")
    os.mkfifo(memory / "lostmotion-ring-pipe")
    nobody = create(tmp_path, 8)
    assert collect_rings() == []
    assert nobody.exists()


def test_the_header_is_read_without_touching_the_ring(run: RunRecord) -> None:
    before = ring(run).read_bytes()
    head = ring_head(ring(run))
    assert head is not None
    assert (head.run, head.waiting, records_waiting(run)) == (str(run.folder), 3, 3)
    assert ring(run).read_bytes() == before


def test_a_run_gets_no_ring_but_its_own(run: RunRecord, tmp_path: Path) -> None:
    other = Store(tmp_path / "runs").create("T", SETUP, {})
    other.update(ring=str(ring(run)))
    with pytest.raises(RecordError, match=f"entry 'ring': found the record buffer of another run, {run.id}"):
        ring_of(other)
    other.update(ring="/etc/passwd")
    with pytest.raises(
        RecordError,
        match="entry 'ring': found '/etc/passwd'; allowed: the path of a file whose name begins with lostmotion-ring-",
    ):
        ring_of(other)


def test_a_run_that_was_killed_with_everything_leaves_nothing_at_the_next_start(tmp_path: Path, memory: Path) -> None:
    """The supervisor dies between the ring and its entry in the manifest: nothing waits in it."""
    words = f"""
import os, signal, sys
sys.path[:0] = ["tests/station"]
from pathlib import Path
import station.records.ring.ring as ring
from station.records.data_folder import Store
from station.wall_clock import WallClock
from station_samples import SETUP
ring.SHARED_MEMORY = Path({str(memory)!r})
run = Store(Path({str(tmp_path / "runs")!r})).create("S", SETUP, {{}}, own=True)
ring.create(run.folder, 8, run=run.folder)
os.kill(os.getpid(), signal.SIGKILL)
"""
    root = Path(__file__).parents[3]
    subprocess.run([sys.executable, "-c", words], cwd=root, check=False)
    assert len(list(memory.iterdir())) == 1
    assert len(collect_rings()) == 1
