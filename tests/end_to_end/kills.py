"""Kills a run at a moment and looks at what is left. `python tests/end_to_end/kills.py [COUNT] [SEED]` does it often.

The test holds its own mapping of the ring, which outlives the file: what it says was written is what must be found.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from station.record_check import check_file  # noqa: E402 - after the path of a script run by hand
from station.record_store import process_birth  # noqa: E402
from station.ring import RingReader  # noqa: E402

COMMAND = (sys.executable, "-m", "station")
LONGEST_S = 90.0
GOLDEN_RECIPE = ROOT / "tests" / "golden" / "golden.yaml"
RUN_S = 13.0
"""About how long the short recipe takes."""


@dataclass(frozen=True)
class Killed:
    """What was left: the folder, records that the scan says it wrote, result and replay."""

    folder: Path
    written: int
    on_disk: int
    state: str
    cause: str
    verdict: str | None
    replay: dict[str, Any]
    replay_code: int

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
        if self.state not in ("complete", "interrupted") and self.cause != "missed_periods":
            found.append(f"state {self.state}, {self.cause or 'no alarm'}")
        if self.verdict == "PASS" and self.state != "complete":
            found.append("a run that was not finished passed")
        return found


def short_recipe(folder: Path) -> Path:
    """Write the recipe of the golden runs at 1 ms."""
    text = GOLDEN_RECIPE.read_text(encoding="utf-8").replace("period: 4 ms", "period: 1 ms")
    path = folder / "short.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def wait_for(condition: Any, what: str) -> Any:
    """Wait until a condition is true and return it."""
    end = time.monotonic() + LONGEST_S
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError(f"in {LONGEST_S:.0f} s there was no {what}")


def _ring_of(data: Path) -> RingReader | None:
    for manifest in data.glob("*/run.json"):
        name = json.loads(manifest.read_bytes()).get("ring")
        if name and Path(name).exists():
            reader = RingReader(Path(name))
            if reader.written:
                return reader
            reader.close()
    return None


def lostmotion(*args: str) -> tuple[int, dict[str, Any]]:
    """Run a command with --json; return its exit code and object."""
    done = subprocess.run([*COMMAND, *args, "--json"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout) if done.stdout else {}


def kill(who: str, after_s: float, data: Path, *, resume: bool = False) -> Killed:
    """Start a run, kill `who` ("scan" or "desk") so long after its first record, and bring it to its end."""
    recipe = short_recipe(data)
    desk = subprocess.Popen(
        [*COMMAND, "run", str(recipe), "--serial", "K", "--json", "--data", str(data)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        ring = wait_for(lambda: _ring_of(data), "record in the ring")
        (folder,) = (path.parent for path in data.glob("*/run.json"))
        scan = ring.pid
        time.sleep(after_s)
        os.kill(scan if who == "scan" else desk.pid, signal.SIGKILL)
        desk.wait(LONGEST_S)
        if resume:
            lostmotion("resume", str(folder))
        wait_for(lambda: not process_birth(scan), "end of the scan process")
        lostmotion("list", "--data", str(data))
        written = ring.written
        ring.close()
    finally:
        if desk.poll() is None:
            os.killpg(desk.pid, signal.SIGKILL)
            desk.wait()
    code, replay = lostmotion("replay", str(folder))
    manifest = json.loads((folder / "run.json").read_bytes())
    on_disk = check_file(folder / "samples.bin").records
    result = folder / "result.json"
    alarms = json.loads(result.read_bytes())["alarms"] if result.exists() else []
    cause = alarms[0]["id"] if alarms else ""
    return Killed(folder, written, on_disk, manifest["state"], cause, manifest["verdict"], replay, code)


def main() -> int:
    """Kill scan and desk in turn at random moments and count what went wrong."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.SystemRandom().randrange(10**6)
    chance = random.Random(seed)  # noqa: S311 - moments, not secrets
    sys.stdout.write(f"{count} kills of each, seed {seed}\n")
    bad, records = 0, 0
    for number in range(count):
        for who in ("scan", "desk"):
            after_s = chance.uniform(0.0, RUN_S)
            with tempfile.TemporaryDirectory(prefix="lostmotion-kill-") as folder:
                left = kill(who, after_s, Path(folder), resume=who == "desk" and number % 2 == 1)
                problems = left.problems()
            records += left.written
            bad += bool(problems)
            told = "; ".join(problems) or f"{left.written} records, none lost, replay identical, {left.state}"
            sys.stdout.write(f"{number + 1:4} {who} after {after_s:6.3f} s: {told}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{2 * count} kills, {records} records, {bad} with problems\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
