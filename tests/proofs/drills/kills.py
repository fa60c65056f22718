"""Kills a run at a moment and looks at what is left; `kill_drill.py` does it often.

The test holds its own mapping of the ring, which outlives the file: what it says was written is what must be found.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from machine_trips import tripped_by_the_machine
from warm_supervisor import Started, cold

sys.path.append(str(Path(__file__).parents[2]))  # where a script run by hand finds the next

from patient import patient_bench, short_recipe
from run_samples import read_back, records_of

from station.cli.measure.conclude import conclude_runs
from station.cli.runs.replay import replay_run
from station.records.process_birth import process_birth
from station.records.ring.reader import RingReader

LONGEST_S = 90.0
LASTS_S = {"opening": 1.0, "run": 9.0, "ending": 2.0}
"""About how long each part of a run takes [s]."""


@dataclass(frozen=True)
class Killed:
    """What was left: the folder, records that the scan says it wrote, result, replay, and the ring's file if any."""

    folder: Path
    written: int
    on_disk: int
    state: str
    cause: str
    verdict: str | None
    replay: dict[str, Any]
    replay_code: int
    notes: list[str]
    reasons: list[str]
    ring_left: str
    machine: str
    """How the machine tripped the run before it was killed, where the record proves it."""

    def problems(self) -> list[str]:
        """Return what must not be; empty when the run survived as it should."""
        found = []
        if self.on_disk != self.written:
            found.append(f"{self.written} records were written, {self.on_disk} are on disk")
        report = read_back(self.folder, self.written)
        found += report.problems
        if self.replay_code != 0 or self.replay["identical_scans"] != self.written:
            found.append(f"replay: {self.replay}")
        if self.state not in ("complete", "interrupted", "stopped") and not self.machine:
            found.append(f"state {self.state}, {self.cause or 'no alarm'}")
        if self.ring_left:
            found.append(f"{self.ring_left} was left behind")
        if self.verdict == "PASS" and self.state != "complete":
            found.append("a run that was not finished passed")
        return found


def wait_for(condition: Any, what: str, every_s: float = 0.005) -> Any:
    """Wait until a condition is true and return it."""
    end = time.monotonic() + LONGEST_S
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(every_s)
    raise AssertionError(f"in {LONGEST_S:.0f} s there was no {what}")


def _ring_of(data: Path) -> tuple[RingReader, Path] | None:
    """Return the ring of the run below `data` once its scan process has opened it, and the ring's file."""
    for manifest in data.glob("*/run.json"):
        name = json.loads(manifest.read_bytes()).get("ring")
        if name and Path(name).exists():
            reader = RingReader(Path(name))
            if reader.pid:
                return reader, Path(name)
            reader.close()
    return None


BEGUN: dict[str, Any] = {
    "opening": lambda _ring: True,
    "run": lambda ring: ring.written > 0,
    "ending": lambda ring: ring.written > 0 and not process_birth(ring.pid),
}
"""From what the moment of a kill is counted: the scan process is there, its first record, its end."""


def _replayed(folder: Path) -> tuple[int, dict[str, Any]]:
    """Replay a run in this process, which has loaded everything already."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = replay_run(str(folder), folder.parent, None, as_json=True)
    return code, json.loads(said.getvalue())


def kill(
    who: str,
    after_s: float,
    data: Path,
    *,
    resume: bool = False,
    since: str = "run",
    period: str = "1 ms",
    start: Callable[[tuple[str, ...], Path], Started] = cold,
) -> Killed:
    """Start a run, kill `who` ("scan" or "desk") so long after a row of BEGUN, and bring the run to its end."""
    words = ("--bench", str(patient_bench(data)), "--serial", "K", "--json", "--data", str(data))
    recipe = short_recipe(data, {"sampling": {"period": period}})
    supervisor = start(("run", str(recipe), *words), data / "supervisor.txt")
    try:
        ring, ring_path = wait_for(lambda: _ring_of(data), "scan process at the ring")
        (folder,) = (path.parent for path in data.glob("*/run.json"))
        scan = ring.pid
        wait_for(lambda: BEGUN[since](ring), f"moment of '{since}'", 0.0005)
        time.sleep(after_s)
        with contextlib.suppress(ProcessLookupError):  # it may have come to its end by itself
            os.kill(scan if who == "scan" else supervisor.pid, signal.SIGKILL)
        supervisor.wait(LONGEST_S)
        if resume:
            taker = start(("resume", str(folder), "--report", "--json"), data / "resume.txt")
            try:
                taker.wait(LONGEST_S)
            finally:
                taker.end()
            assert "Traceback" not in taker.errors, taker.errors
        wait_for(lambda: not process_birth(scan), "end of the scan process")
        with contextlib.redirect_stdout(io.StringIO()):
            conclude_runs(None, data, all_runs=True, as_json=False)
        written = ring.written
        ring.close()
    finally:
        supervisor.end()
    code, replay = _replayed(folder) if written else (0, {"identical_scans": 0})
    manifest = json.loads((folder / "run.json").read_bytes())
    on_disk = read_back(folder).records
    result = folder / "result.json"
    told = json.loads(result.read_bytes()) if result.exists() else {"alarms": [], "reasons": []}
    alarms, reasons = told["alarms"], told["reasons"]
    cause = next((alarm["id"] for alarm in alarms if alarm["first"]), "")
    events = folder / "events.jsonl"
    rows = [json.loads(line) for line in events.read_text("utf-8").splitlines()] if events.exists() else []
    notes = [row["text"] for row in rows if row["kind"] == "note"]
    left = str(ring_path) if ring_path.exists() else ""
    machine = tripped_by_the_machine(records_of(folder), cause) if cause else ""
    state, verdict = manifest["state"], manifest["verdict"]
    return Killed(folder, written, on_disk, state, cause, verdict, replay, code, notes, reasons, left, machine)
