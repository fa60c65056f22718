"""What a scenario does to the station's own processes is real, and one that left no trace fails its scenario."""

from __future__ import annotations

import dataclasses
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from faultlab.supervisor import Left
from faultlab.wires import _unproven
from station.records.run_record import RunRecord
from station.run.faults.machine_faults import DEEDS, Traces
from station.wall_clock import WALL_CLOCK
from virtual_bench.faults.scenario import Fault

ROOT = Path(__file__).parents[2]

FULL_DISK = """
import sys
from pathlib import Path
from station.atomic_file import Appender, write_atomic
from station.errors import RecordError
from station.run.faults.machine_faults import DEEDS
file = Appender(Path(sys.argv[1]) / "samples.bin")
file.write(b"before")
deed = DEEDS["machine.disk", "full"]
deed.begin(0, 0.0)
refused = []
for write in (lambda: file.write(b"lost"), lambda: write_atomic(Path(sys.argv[1]) / "result.json", b"{}")):
    try:
        write()
    except RecordError as error:
        refused.append("cannot be written" in str(error))
deed.end(0.0)
file.write(b" after")
file.close()
assert refused == [True, True], refused
"""


def test_a_full_disk_takes_no_byte_and_what_comes_later_whole(tmp_path: Path) -> None:
    words = [sys.executable, "-c", FULL_DISK, str(tmp_path)]
    subprocess.run(words, cwd=ROOT, check=True)
    assert (tmp_path / "samples.bin").read_bytes() == b"before after"
    assert not (tmp_path / "result.json").exists()


def test_a_killed_scan_is_dead_at_once() -> None:
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    DEEDS["process.scan", "kill"].begin(process.pid, 0.0)
    assert process.wait(10) == -signal.SIGKILL


def test_a_killed_supervisor_kills_itself() -> None:
    text = "from station.run.faults.machine_faults import DEEDS; DEEDS['process.desk', 'kill'].begin(0, 0.0)"
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, check=False)
    assert done.returncode == -signal.SIGKILL


def test_a_clock_that_was_set_is_put_back_at_its_end() -> None:
    before, deed = WALL_CLOCK.now(), DEEDS["machine.clock", "step"]
    deed.begin(0, 7200.0)
    try:
        assert 7199.0 < (WALL_CLOCK.now() - before).total_seconds() < 7260.0
    finally:
        deed.end(7200.0)
    assert (WALL_CLOCK.now() - before).total_seconds() < 60.0


@pytest.mark.parametrize(
    ("named", "killed", "words"),
    [
        (set(), True, "its trigger (state lock) was not reached"),
        ({"process.desk kill"}, False, "nothing changed"),
        ({"process.desk kill"}, True, ""),
    ],
)
def test_a_fault_that_was_not_done_or_left_no_trace_fails_its_scenario(tmp_path, named, killed, words) -> None:
    fault = Fault(target="process.desk", verb="kill", when={"state": "lock"})
    left = Left(RunRecord(tmp_path), traces=Traces(supervisor_killed=killed))
    why = _unproven(fault, left, named)
    assert bool(why) == bool(words)
    assert words in why


def test_a_fault_of_the_bench_is_proven_by_the_bench(tmp_path: Path) -> None:
    fault = Fault(target="io.guard", verb="open", when={"state": "lock"})
    left = Left(RunRecord(tmp_path))
    assert _unproven(fault, dataclasses.replace(left, died=True), set()) == ""
