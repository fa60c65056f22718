"""Cuts the power of everything at a moment: SIGKILL to supervisor, scan and virtual bench; looks at what is found.

`python tests/proofs/drills/power_cuts.py [CUTS] [SEED]` does it often, in one folder, so that its journal grows
over the cuts. After every other cut the ring in shared memory is gone too, as it is after a real power failure. What
SIGKILL cannot show is what the kernel had not yet written: that is at most the second between two syncs of the
supervisor.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[3])]

from kills import LASTS_S  # noqa: E402 - after the path of a script run by hand
from machine_trips import tripped_by_the_machine  # noqa: E402
from patient import patient_bench, short_recipe  # noqa: E402
from run_samples import read_back, records_of  # noqa: E402
from warm_supervisor import COMMAND, ROOT  # noqa: E402

from definitions.image import State  # noqa: E402
from station.records.ring.reader import RingReader  # noqa: E402
from station.records.ring.ring import ScanState  # noqa: E402
from station.records.run_record import RunRecord  # noqa: E402
from station.records.samples.table import Table  # noqa: E402
from station.run.outcome import scan_report  # noqa: E402

START_S = 4.0
"""About how long it takes from the command to the first record."""

SETTLE_S = 0.5

SUPERVISOR, FORKED = "supervisor", "forked"

ENDS: dict[State | None, str] = {State.COMPLETE: "complete", State.STOPPED: "stopped", State.FAULT: "fault"}

Answer = tuple[int, Any]
"""Exit code and object of a command."""


def lostmotion(*args: str) -> Answer:
    """Run a command with --json; return its exit code and object."""
    done = subprocess.run([*COMMAND, *args, "--json"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout) if done.stdout else {}


def _family(supervisor: int) -> dict[int, str]:
    """The processes of a run, its supervisor and what that started, with their modules by process id.

    One that was forked a moment ago is not yet what it will be: it has its supervisor's command line.
    """
    found = {supervisor: SUPERVISOR}
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            if int(path.joinpath("stat").read_text().rpartition(")")[2].split()[1]) != supervisor:
                continue
            words = path.joinpath("cmdline").read_bytes().decode().split("\0")
            found[int(path.name)] = next((word for word in words if word.startswith("station.")), FORKED)
    return found


def _signal(pid: int, number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)


def cut_power(supervisor: int) -> None:
    """Kill a supervisor and all that it started, as far as that can be done at one moment.

    On a busy machine half a second may lie between two kills. All stand still first, the one that acts on the silence
    of another before any: what is cut is the power, to all at once. What the supervisor started in the meantime is
    found when it stands still itself.
    """
    still: set[int] = set()
    while new := {pid: name for pid, name in _family(supervisor).items() if pid not in still}:
        for pid in sorted(new, key=lambda pid: not new[pid].startswith("station.scan")):
            _signal(pid, signal.SIGSTOP)
        still |= set(new)
    pids = list(still)
    random.shuffle(pids)
    for pid in pids:
        _signal(pid, signal.SIGKILL)


def _still_alive(folder: Path) -> list[str]:
    """Name the processes that still work on a run, or below a folder of runs."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            text = path.read_bytes().decode(errors="replace").replace("\0", " ")
            if str(folder) in text and "station." in text:
                found.append(f"still alive: {text}")
    return found


def scan_finished(folder: Path, ring: Path | None) -> bool:
    """Whether the scan of a run had come to its end, as its report or its ring says: what was cut is its evaluation."""
    if scan_report(RunRecord(folder)).state == "finished":
        return True
    if ring is None or not ring.exists():
        return False
    reader = RingReader(ring)
    try:
        return reader.state is ScanState.FINISHED
    finally:
        reader.close()


def wrong_end(state: str, shown: Mapping[str, Any], table: Table | None, *, finished: bool) -> tuple[list[str], str]:
    """Return what must not be in the end of a run that was not concluded before the cut, and what the machine did.

    It has the state of its last record; a fault only where the record proves that it was the machine's.
    """
    last = None if table is None else State(int(table["orders"]["state"][-1]))
    end, alarm = ENDS.get(last, "interrupted"), first_alarm(shown)
    machine = tripped_by_the_machine(table, alarm) if table is not None and state == "fault" else ""
    wrong = [] if state == end else [f"state {state}, by the last record {end}"]
    if state == "fault" and not machine:
        wrong.append(f"tripped by {alarm or 'no alarm'}")
    if shown.get("verdict") == "PASS" and not finished:
        wrong.append("a run that was cut off passed")
    return wrong, f" (tripped by the machine: {machine})" if machine else ""


def first_alarm(shown: Mapping[str, Any]) -> str:
    """Return the fault that a result names as the first; "" when there was none."""
    return next((str(alarm["id"]) for alarm in shown.get("alarms", ()) if alarm["first"]), "")


class Drill:
    """One folder of runs whose power is cut again and again."""

    def __init__(self, data: Path, ask: Callable[..., Answer] = lostmotion, period: str = "1 ms") -> None:
        self.data = data
        self.ask = ask
        self.runs = data / "runs"
        self.known: dict[str, tuple[str, int]] = {}
        recipe = short_recipe(data, {"sampling": {"period": period}})
        self.words = (str(recipe), "--bench", str(patient_bench(data)))

    def cut(self, after_s: float, *, ring_too: bool, loaded: bool) -> tuple[str, list[str]]:
        """Start a run, cut the power so long after the command, restart; what was found, and what must not be.

        `loaded`: so long after the first record instead.
        """
        supervisor = subprocess.Popen(
            [*COMMAND, "run", *self.words, "--serial", "PC", "--json", "--data", str(self.runs)],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        if loaded:
            self._wait_for_record(supervisor)
        with suppress(subprocess.TimeoutExpired):
            supervisor.wait(after_s)
        cut_power(supervisor.pid)
        supervisor.wait()
        time.sleep(SETTLE_S)
        folders = [path.parent for path in self.runs.glob("*/run.json") if path.parent.name not in self.known]
        if not folders:
            return "cut before the run had a folder", [*_still_alive(self.runs), *self._journal()]
        (folder,) = folders
        return self._look(folder, ring_too=ring_too)

    def _wait_for_record(self, supervisor: subprocess.Popen[bytes]) -> None:
        while supervisor.poll() is None:
            time.sleep(0.02)
            new = [path for path in self.runs.glob("*/samples.bin") if path.parent.name not in self.known]
            if new and new[0].stat().st_size:
                return

    def _look(self, folder: Path, *, ring_too: bool) -> tuple[str, list[str]]:
        manifest = json.loads((folder / "run.json").read_bytes())
        ring = Path(manifest["ring"]) if manifest.get("ring") else None
        if ring is not None and ring_too:
            ring.unlink(missing_ok=True)
        finished = scan_finished(folder, ring)
        wrong = _still_alive(self.runs)
        ended = manifest["state"] != "recording"
        wrong += self._journal()
        before, seen = (folder / "run.json").read_bytes(), self.ask("show", str(folder))[1]
        if (folder / "run.json").read_bytes() != before:
            wrong.append("looking at the run has decided it")
        if not ended and seen.get("state") != "not concluded":
            wrong.append(f"before it is concluded it is shown as {seen.get('state')}")
        self.ask("conclude", str(folder))
        code, shown = self.ask("show", str(folder))
        _, resumed = self.ask("resume", str(folder))
        state = json.loads((folder / "run.json").read_bytes())["state"]
        records = read_back(folder) if any(folder.glob("samples.[bp]*")) else None
        count = 0 if records is None else records.records
        wrong += [] if records is None else records.problems
        tripped = ""
        if not ended:
            table = records_of(folder) if count else None
            more, tripped = wrong_end(state, shown, table, finished=finished)
            wrong += more
        if resumed.get("state") != state or code not in (0, 2):
            wrong.append(f"show {code}, resume says {resumed.get('state')}, manifest says {state}")
        said = "the scan had ended" if finished else "no record" if not count else "unloaded"
        if count and not ended:
            if state != "complete":
                said, more = self._torque(folder, shown, finished=finished)
                wrong += more
            replay_code, replay = self.ask("replay", str(folder))
            if replay_code or replay["identical_scans"] != count:
                wrong.append(f"replay: {replay}")
        wrong += [f"started by itself, {text}" for text in _still_alive(self.runs)]
        if ring is not None and ring.exists():
            wrong.append(f"{ring} was left behind")
        self.known[folder.name] = (state, count)
        return f"{state}{tripped}, {count} records, {said}", wrong

    def _torque(self, folder: Path, shown: dict[str, object], *, finished: bool) -> tuple[str, list[str]]:
        """How the unit was left, as shown, and whether that is what the last record says."""
        left = shown.get("left")
        last = records_of(folder)[-1]
        torque_nm = round(float(last["image"]["torque_out_nm"] - last["orders"]["torque_out_tare_nm"]), 2)
        if not isinstance(left, dict):
            return "", ["nothing is said of how the unit was left"]
        wrong = (
            [] if left["torque_nm"] == torque_nm else [f"left with {left['torque_nm']}, last record {torque_nm} N·m"]
        )
        wrong += ["a torn-off record is told as what is now"] if left["drive_known"] and not finished else []
        lock = "closed" if last["image"]["brake_on"] or last["image"]["brake_current_a"] > 0.05 else "open"
        wrong += [] if left["lock"] == lock else [f"lock {left['lock']}, last record {lock}"]
        return str(left["text"]), wrong

    def _journal(self) -> list[str]:
        """Every run that was there before is listed as it was."""
        if not self.runs.exists():
            return []
        code, rows = self.ask("list", "--data", str(self.runs))
        if code:
            return [f"list: {code}"]
        listed = {row["run"]: row for row in rows}
        wrong = [f"{name} is not listed any more" for name in self.known if name not in listed]
        for name, (state, count) in self.known.items():
            if name in listed and listed[name]["state"] != state:
                wrong.append(f"{name}: was {state}, is {listed[name]['state']}")
            folder = self.runs / name
            if any(folder.glob("samples.[bp]*")) and read_back(folder).records != count:
                wrong.append(f"{name}: its records have changed")
        return wrong


def main() -> int:
    """Cut at random moments and count what went wrong."""
    cuts = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.SystemRandom().randrange(10**6)
    chance = random.Random(seed)  # noqa: S311 - moments, not secrets
    sys.stdout.write(f"{cuts} power cuts, seed {seed}\n")
    bad = 0
    folder = Path(tempfile.mkdtemp(prefix="lostmotion-power-"))
    drill = Drill(folder)
    for number in range(cuts):
        loaded = number % 4 != 3
        after_s = chance.uniform(0.0, LASTS_S["run"]) if loaded else chance.uniform(0.3, START_S)
        found, wrong = drill.cut(after_s, ring_too=number % 2 == 1, loaded=loaded)
        bad += bool(wrong)
        since = "its first record" if loaded else "the command"
        sys.stdout.write(f"{number + 1:4} {after_s:6.3f} s after {since}: {'; '.join((*wrong, found))}\n")
        sys.stdout.flush()
    states = [state for state, _ in drill.known.values()]
    if bad:
        sys.stdout.write(f"the runs are kept in {folder}\n")
    else:
        shutil.rmtree(folder)
    counts = ", ".join(f"{state} {states.count(state)}" for state in sorted(set(states)))
    sys.stdout.write(f"{cuts} cuts, runs: {counts}; {bad} with problems\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
