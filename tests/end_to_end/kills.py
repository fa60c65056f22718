"""Kills a run at a moment and looks at what is left. `python tests/end_to_end/kills.py [COUNT] [SEED]` does it often.

The test holds its own mapping of the ring, which outlives the file: what it says was written is what must be found.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from station.command_replay import replay_run  # noqa: E402 - after the path of a script run by hand
from station.record_check import check_file  # noqa: E402
from station.record_store import Store, process_birth  # noqa: E402
from station.recovery import recover_all  # noqa: E402
from station.ring import RingReader  # noqa: E402

COMMAND = (sys.executable, "-m", "station")
LONGEST_S = 90.0
GOLDEN_RECIPE = ROOT / "tests" / "golden" / "golden.yaml"
LASTS_S = {"opening": 1.0, "run": 10.0, "ending": 2.0}
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
    ring_left: str

    def problems(self) -> list[str]:
        """Return what must not be; empty when the run survived as it should."""
        found = []
        if self.on_disk != self.written:
            found.append(f"{self.written} records were written, {self.on_disk} are on disk")
        report = check_file(self.folder / "samples.bin", self.written)
        found += report.problems
        if self.replay_code != 0 or self.replay["identical_scans"] != self.written:
            found.append(f"replay: {self.replay}")
        # A machine that stood still for 20 ms trips the run, killed or not: that is for `lostmotion timing` to say.
        if self.state not in ("complete", "interrupted", "stopped") and self.cause != "missed_periods":
            found.append(f"state {self.state}, {self.cause or 'no alarm'}")
        if self.ring_left:
            found.append(f"{self.ring_left} was left behind")
        if self.verdict == "PASS" and self.state != "complete":
            found.append("a run that was not finished passed")
        return found


SHORTER = {
    "period: 4 ms": "period: 1 ms",
    "proof_torque: 10 %": "proof_torque: 5 %, proof_time: 50 ms",
    "torque_rate: 300 N·m/s, dwell: 40 ms": "torque_rate: 600 N·m/s, dwell: 20 ms",
    "  - unload: {torque_rate: 300 N·m/s}": "  - unload: {torque_rate: 600 N·m/s}",
}
"""What the recipe of the golden runs becomes: 1 ms, and through every state in 10 s."""


def short_recipe(folder: Path) -> Path:
    """Write the recipe of the golden runs, shorter and at 1 ms."""
    text = GOLDEN_RECIPE.read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        assert old in text, f"{GOLDEN_RECIPE}: has no {old!r} any more"
        text = text.replace(old, new)
    path = folder / "short.yaml"
    path.write_text(text, encoding="utf-8")
    return path


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


def kill(who: str, after_s: float, data: Path, *, resume: bool = False, since: str = "run") -> Killed:
    """Start a run, kill `who` ("scan" or "desk") so long after a row of BEGUN, and bring the run to its end."""
    recipe = short_recipe(data)
    desk = subprocess.Popen(
        [*COMMAND, "run", str(recipe), "--serial", "K", "--json", "--data", str(data)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        ring, ring_path = wait_for(lambda: _ring_of(data), "scan process at the ring")
        (folder,) = (path.parent for path in data.glob("*/run.json"))
        scan = ring.pid
        wait_for(lambda: BEGUN[since](ring), f"moment of '{since}'", 0.0005)
        time.sleep(after_s)
        with contextlib.suppress(ProcessLookupError):  # it may have come to its end by itself
            os.kill(scan if who == "scan" else desk.pid, signal.SIGKILL)
        desk.wait(LONGEST_S)
        if resume:
            done = subprocess.run([*COMMAND, "resume", str(folder), "--json"], cwd=ROOT, capture_output=True, text=True)  # noqa: PLW1510
            assert "Traceback" not in done.stderr, done.stderr
        wait_for(lambda: not process_birth(scan), "end of the scan process")
        recover_all(Store(data))
        written = ring.written
        ring.close()
    finally:
        if desk.poll() is None:
            os.killpg(desk.pid, signal.SIGKILL)
            desk.wait()
    code, replay = _replayed(folder) if written else (0, {"identical_scans": 0})
    manifest = json.loads((folder / "run.json").read_bytes())
    on_disk = check_file(folder / "samples.bin").records
    result = folder / "result.json"
    alarms = json.loads(result.read_bytes())["alarms"] if result.exists() else []
    cause = alarms[0]["id"] if alarms else ""
    events = folder / "events.jsonl"
    rows = [json.loads(line) for line in events.read_text("utf-8").splitlines()] if events.exists() else []
    notes = [row["text"] for row in rows if row["kind"] == "note"]
    left = str(ring_path) if ring_path.exists() else ""
    return Killed(folder, written, on_disk, manifest["state"], cause, manifest["verdict"], replay, code, notes, left)


def moment(chance: random.Random) -> tuple[str, float]:
    """Draw when to kill: one in ten while the bench is opened, one in ten while the run is concluded."""
    since = chance.choices(("opening", "run", "ending"), (1, 8, 1))[0]
    return since, chance.uniform(0.0, LASTS_S[since])


def main() -> int:
    """Kill scan and desk in turn at random moments and count what went wrong."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.SystemRandom().randrange(10**6)
    chance = random.Random(seed)  # noqa: S311 - moments, not secrets
    sys.stdout.write(f"{count} kills of each, seed {seed}\n")
    bad, records, states = 0, 0, Counter[str]()
    started = time.monotonic()
    for number in range(count):
        for who in ("scan", "desk"):
            since, after_s = moment(chance)
            with tempfile.TemporaryDirectory(prefix="lostmotion-kill-") as folder:
                left = kill(who, after_s, Path(folder), resume=who == "desk" and number % 2 == 1, since=since)
                problems = left.problems()
            records += left.written
            bad += bool(problems)
            states[f"{who} {left.state}"] += 1
            told = "; ".join(problems) or f"{left.written} records, none lost, replay identical, {left.state}"
            sys.stdout.write(f"{number + 1:4} {who:4} {since:7} + {after_s:6.3f} s: {told}\n")
            sys.stdout.flush()
    took_s = time.monotonic() - started
    sys.stdout.write(f"{', '.join(f'{name} {times}' for name, times in sorted(states.items()))}\n")
    sys.stdout.write(f"{2 * count} kills, {records} records, {bad} with problems, {took_s / (2 * count):.1f} s each\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
