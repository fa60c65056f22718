"""A recipe tried in virtual time: the same program and controller against a unit made of the catalogue values.

`lostmotion run --virtual-time` in a process of its own, with a data folder and a state folder that live as long as it:
nothing of it is in the runs, the chain, or the statistics.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock, Thread

from station.documents.result import Result
from station.errors import StationError
from station.own_place import PLACE
from station.own_program import own_module
from station.records.data_folder import Store
from station.records.revisions.revision import hash_of
from station.records.run_record import RESULT

LONGEST_S = 600.0
"""Longest time for one; a recipe of an hour takes some minutes."""

SERIAL = "DRY-RUN"
UNIT = "catalogue"
NICE = "10"
"""A unit that is measured meanwhile comes first."""

IDLE, TRYING, TRIED, FAILED = "idle", "running", "ended", "failed"


@dataclass(frozen=True)
class DryRun:
    """The newest dry run: of which text, where it is, and its result; `said` is its progress, or why it failed."""

    stage: str = IDLE
    sha256: str = ""
    title: str = ""
    said: str = ""
    result: Result | None = None
    took_s: float = 0.0


class DryRuns:
    """Dry runs of a station, one at a time."""

    def __init__(self) -> None:
        self._now = DryRun()
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._output: Path | None = None

    def start(self, content: bytes, title: str, bench: str | None) -> DryRun:
        """Begin to try the text of a recipe that was checked; StationError where another one is being tried."""
        with self._lock:
            if self._now.stage == TRYING:
                raise StationError(
                    f"A dry run of {self._now.title} is in progress. Wait for its end, then try this one."
                )
            self._now = DryRun(TRYING, hash_of(content), title)
            found = self._now
        Thread(target=self._run, args=(content, bench), daemon=True).start()
        return found

    def now(self) -> DryRun:
        """Return the newest dry run, with the newest line of its progress."""
        with self._lock:
            now, output = self._now, self._output
        return replace(now, said=_newest_line(output)) if now.stage == TRYING and output is not None else now

    def close(self) -> None:
        """End what is on: nobody sees it any more."""
        with self._lock:
            if self._process is not None:
                self._process.kill()

    def _run(self, content: bytes, bench: str | None) -> None:
        began = time.monotonic()
        try:
            with tempfile.TemporaryDirectory(prefix="lostmotion-dry-run-") as folder:
                found = self._tried(Path(folder), content, bench)
        except (OSError, StationError, subprocess.TimeoutExpired) as error:
            found = replace(self._now, stage=FAILED, said=_why(error))
        with self._lock:
            self._now = replace(found, took_s=time.monotonic() - began)
            self._process = self._output = None

    def _tried(self, folder: Path, content: bytes, bench: str | None) -> DryRun:
        recipe, data, output = folder / "recipe.yaml", folder / "runs", folder / "output"
        recipe.write_bytes(content)
        command = [
            "nice", "-n", NICE, *own_module("station", "run", recipe), "--virtual-time", "--no-report",
            "--serial", SERIAL, "--unit", UNIT, "--data", str(data), *(["--bench", bench] if bench else []),
        ]  # fmt: skip
        with output.open("wb") as said:
            process = subprocess.Popen(  # noqa: S603 - our own program
                command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True,
                env={**os.environ, PLACE: str(folder / "place")},
            )  # fmt: skip
        with self._lock:
            self._process, self._output = process, output
        try:
            process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        newest = next(iter(Store(data).newest(1)), None)
        if newest is None or not newest.has(RESULT):
            lines = output.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            raise StationError(" ".join(lines[-3:]) or "the dry run ended without a result, and said nothing")
        return replace(self._now, stage=TRIED, said="", result=newest.read(Result, RESULT))


def _why(error: Exception) -> str:
    if isinstance(error, subprocess.TimeoutExpired):
        return f"The dry run took longer than {LONGEST_S / 60:.0f} min and was ended. Try it with fewer cycles."
    return str(error)


def _newest_line(output: Path) -> str:
    try:
        lines = output.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    except OSError:
        return ""
    return lines[-1].strip() if lines else ""
