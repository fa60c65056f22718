"""Runs on a busy computer: `make run`, time after time, while processes of ordinary priority burn every core.

Each run must be a PASS with the same bytes of samples (wake-up latency and work aside), and say by how much its
periods were stretched. With `--ordinary` the runs are made without the capabilities that a real-time priority and
locked memory need, as by an ordinary user.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from run_samples import digest_of  # noqa: E402 - as a script it has to know where

RECIPE = "recipes/rv-40e-121-quick.yaml"
BURN = "while True: pass"
SEED = "1"


@contextmanager
def burning(processes: int) -> Iterator[None]:
    """Keep processors busy with processes of ordinary priority."""
    burners = [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(processes)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


ORDINARY = ("setpriv", "--bounding-set=-sys_nice,-ipc_lock", "--inh-caps=-sys_nice,-ipc_lock", "--")


def run_once(data: Path, recipe: str, options: list[str], *, ordinary: bool) -> dict[str, Any]:
    """Run once; return the result and the digest of its samples."""
    command = [sys.executable, "-m", "station", "run", recipe, "--serial", "BUSY", "--data", str(data), "--json"]
    command = [*(ORDINARY if ordinary else ()), *command, "--seed", SEED, "--no-report", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if not done.stdout.startswith("{"):
        raise SystemExit(f"the run ended with {done.returncode} and said no result: {done.stderr[-2000:]}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result | {"digest": digest_of(Path(result["record"]))}


def main() -> int:
    """Run as asked; 0 when every run passed with the same samples."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=int, nargs="?", default=10)
    parser.add_argument("--burners", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--ordinary", action="store_true", help="without real-time priority and locked memory")
    parser.add_argument("--recipe", default=RECIPE)
    parser.add_argument("--pace", default="deadlines")
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="lostmotion-busy-"))
    digests, good = set(), True
    try:
        with burning(asked.burners):
            for number in range(1, asked.runs + 1):
                begin = time.monotonic()
                result = run_once(folder, asked.recipe, ["--pace", asked.pace], ordinary=asked.ordinary)
                pace = result["timing"]["pace"]
                digests.add(result["digest"])
                good &= result["verdict"] == "PASS"
                sys.stdout.write(
                    f"run {number}: {result['verdict']} in {time.monotonic() - begin:.0f} s, clock {result['clock']}, "
                    f"{pace['stretched']} periods stretched by {pace['stretched_s']:.3f} s in all, longest "
                    f"{pace['longest_s'] * 1e3:.0f} ms, unanswered {pace['unanswered']}, with real hardware "
                    f"{pace['would_have_missed']} of {result['timing']['scans']} missed, fifo "
                    f"{result['timing']['realtime']['fifo']}, samples {result['digest'][:16]}\n"
                )
                for reason in result["reasons"]:
                    sys.stdout.write(f"  {reason}\n")
                sys.stdout.flush()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    same = "the same samples" if len(digests) == 1 else f"{len(digests)} different samples"
    sys.stdout.write(f"{asked.runs} runs: {'all passed' if good else 'NOT all passed'}, {same}\n")
    return 0 if good and len(digests) == 1 else 1


if __name__ == "__main__":
    sys.exit(main())
