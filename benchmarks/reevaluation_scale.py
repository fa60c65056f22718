"""A plant's archive re-evaluated: locally and on Ray, processes killed at random; equal ledgers, cost of a run.

    python -m benchmarks.reevaluation_scale DATA [--runs 1000] [--ray] [--recipe NEW]

DATA is the data folder of one measured run; so many copies of it, each sealed and signed with a serial number of its
own, are archived in a folder beside, and evaluated by another definition of a metric.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import secrets
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

from station.archive.place import Place
from station.archive.push import push
from station.archive.settings import load_settings
from station.documents.manifest import Setup
from station.records.data_folder import Store
from station.records.run_record import RESULT
from station.records.seal import seal
from station.reevaluation.jobs import Where
from station.reevaluation.question import Question, question_of
from station.reevaluation.run_question import Means, Reevaluated, ask_of_runs

METRIC = "stiffness_at torque=50% branch=load"
LEFT_OUT = {"run.json", RESULT, ".owner", "log.jsonl"}
CORES, PLANT_RUNS, LINE_RUNS = 64, 21_000_000, 500_000
KILL_EVERY_S = (6.0, 14.0)
MOST_TIMES = 3
"""How often it is asked again for what a killed process left out: a run is given up when three have died with it."""


def make_copies(source: Path, data: Path, count: int) -> None:
    """Make copies of the newest run of a data folder, each concluded as a run of its own."""
    run = Store(source).newest(1)[0]
    manifest = run.manifest()
    names = (*Setup.__dataclass_fields__,)
    setup = Setup(**{name: getattr(manifest, name) for name in names if hasattr(manifest, name)})
    files = {
        path.relative_to(run.folder).as_posix(): path.read_bytes()
        for path in run.folder.rglob("*")
        if path.is_file() and path.name not in LEFT_OUT
    }
    result = run.read_json(RESULT)
    with mock.patch.object(os, "fsync", return_value=None):
        for number in range(count):
            serial = f"C{number:05}"
            made = Store(data).create(serial, setup, files)
            made.write_json(RESULT, {**result, "run": made.id, "serial": serial})
            last = {"verdict": manifest.verdict, "records": manifest.records, "ended": manifest.ended}
            seal(made, samples=manifest.samples, state=manifest.state, started=manifest.started, **last)


@contextlib.contextmanager
def killing(text: str, kills: list[int]) -> Iterator[None]:
    """Kill a process that evaluates at random moments: of those that others below this one started, by a text.

    text: in the command line. What starts them (a server of forks, a node of Ray) is left alone.
    """
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(random.uniform(*KILL_EVERY_S)):  # noqa: S311 - moments, not secrets
            below = _below(os.getpid())
            found = [one for one, parent in below.items() if text in _command(one) and parent in below]
            if found:
                victim = random.choice(found)  # noqa: S311 - as above
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
                    kills.append(victim)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _below(process: int) -> dict[int, int]:
    """Return the processes that a process has started, and theirs, each with its parent."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout  # noqa: S607
    parents = {int(one): int(parent) for one, parent in (line.split() for line in listed.splitlines())}
    found: dict[int, int] = {}
    new = {process}
    while new:
        new = {one for one, parent in parents.items() if parent in new}
        found |= {one: parents[one] for one in new}
    return found


def _command(process: int) -> str:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def main() -> None:
    """Make the copies, archive and evaluate them, and print the table."""
    words = argparse.ArgumentParser()
    words.add_argument("source", type=Path)
    words.add_argument("--runs", type=int, default=1000)
    words.add_argument("--ray", action="store_true")
    words.add_argument("--recipe")
    words.add_argument("--workers", type=int, default=2)
    given = words.parse_args()
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))  # of the cluster that this program starts
    with tempfile.TemporaryDirectory(prefix="lostmotion-scale-") as scratch:
        data = Path(scratch) / "runs"
        begun = time.monotonic()
        make_copies(given.source, data, given.runs)
        (data / "archive.yaml").write_text(f"url: {scratch}/archive\n", encoding="utf-8")
        print(f"{given.runs} copies made in {time.monotonic() - begun:.0f} s", flush=True)
        begun, cpu = time.monotonic(), _cpu_s()
        lines = push(data, Place(load_settings(data))).lines
        full, trace = (sum(getattr(line, kind).bytes for line in lines) / given.runs for kind in ("full", "trace"))
        print(
            f"archived in {time.monotonic() - begun:.0f} s, {(_cpu_s() - cpu) / given.runs:.3f} s of processor a run; "
            f"{full / 1e6:.2f} MB record, {trace / 1e6:.2f} MB trace a run",
            flush=True,
        )
        for one in data.glob("*Z-*"):
            shutil.rmtree(one)  # every run is read from the archive
        question = question_of(given.recipe, None, () if given.recipe else (METRIC,))
        archive = load_settings(data)
        two = Means(given.workers, archive, from_archive=True)
        ways = {
            "1 process": (replace(two, workers=1), "", False),
            "2 processes, killed": (two, "multiprocessing", True),
        }
        if given.ray:
            ways["Ray, 2 processes, killed"] = (replace(two, cluster="local"), "ray::evaluate_one", True)
        digests = {}
        for name, (means, pattern, killed) in ways.items():
            kills: list[int] = []
            with killing(pattern, kills) if killed else contextlib.nullcontext():
                found = evaluated(data, question, means)
            digests[name] = found.digest
            alone_s = found.processor_s / given.runs
            print(
                f"{name}: {found.evaluated} evaluated in {found.seconds:.1f} s, {alone_s:.3f} s of processor a run; "
                f"{len(kills)} kills, {found.died} in the middle of a run; {found.twice} twice, "
                f"{len(found.failed)} failed; ledger {found.digest[:16]}, {dict(found.changes())}",
                flush=True,
            )
        print("ledgers equal" if len(set(digests.values())) == 1 else f"LEDGERS DIFFER: {digests}")
        for runs, what in ((LINE_RUNS, "0.5 million runs"), (PLANT_RUNS, "21 million runs")):
            hours = runs * alone_s / CORES / 3600
            print(f"{what} on {CORES} cores, if they scale as two do here and the archive delivers: {hours:.1f} h")


def evaluated(data: Path, question: Question, means: Means) -> Reevaluated:
    """Ask with an empty ledger, and once more for runs whose process died as often as one is tried."""
    shutil.rmtree(data / "reevaluations", ignore_errors=True)
    found = ask_of_runs(data, question, Where(), means)
    for _ in range(MOST_TIMES):
        if not found.failed:
            break
        print(f"  {len(found.failed)} failed: {'; '.join(found.failed.values())}; asked again", flush=True)
        again = ask_of_runs(data, question, Where(), means)
        spent = {name: getattr(found, name) + getattr(again, name) for name in ("seconds", "processor_s", "died")}
        found = replace(again, known=again.known - found.evaluated, **spent)
    return found


def _cpu_s() -> float:
    own = resource.getrusage(resource.RUSAGE_SELF)
    return own.ru_utime + own.ru_stime


if __name__ == "__main__":
    main()
