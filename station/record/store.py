"""Where runs are kept: one folder per run, named by moment and serial number, and how a run is found again.

The run id sorts by time, also where the computer's clock was set back between two runs. Several runs of one serial
number are attempts 1, 2, 3 ...
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from station.durable import sync_folder
from station.errors import RecordError, StationError
from station.record.run_record import MANIFEST, RECORDING, RunRecord, process_birth
from station.record.scan_record import RECORD_BYTES, describe
from station.wall_clock import WALL_CLOCK, now_text

STAMP = "%Y%m%dT%H%M%S.%f"
FORMAT_VERSION = 1
LONGEST_SERIAL = 128


def check_serial(serial: str) -> str:
    """Return a serial number as it may be stored; StationError when it is empty, too long or not printable."""
    if not serial.strip() or len(serial) > LONGEST_SERIAL or not serial.isprintable():
        raise StationError(
            f"--serial: found {serial[:40]!r}; allowed are 1 to {LONGEST_SERIAL} printable characters. Scan it again",
        )
    return serial


def check_operator(name: str) -> str:
    """Return an operator's name as it may be stored; StationError when it is empty, too long or not printable."""
    if not name.strip() or len(name) > LONGEST_SERIAL or not name.isprintable():
        raise StationError(f"--operator: found {name[:40]!r}; allowed are 1 to {LONGEST_SERIAL} printable characters")
    return name.strip()


def _folder_name(serial: str) -> str:
    return re.sub(r"[^A-Za-z0-9._+-]", "_", serial).lstrip(".") or "_"


def _stamp(moment: datetime) -> str:
    return moment.strftime(STAMP)[:-3] + "Z"


def _moment_of(name: str, otherwise: datetime) -> datetime:
    """Return the moment that a run's folder is named by; `otherwise` for a folder that is named in another way."""
    try:
        return datetime.strptime(name.partition("Z-")[0], STAMP).replace(tzinfo=UTC)
    except ValueError:
        return otherwise


class Store:
    """All runs below one folder."""

    def __init__(self, data: Path) -> None:
        self.data = data

    def create(self, serial: str, manifest: dict[str, Any], files: dict[str, bytes], *, own: bool = False) -> RunRecord:
        """Create the folder of a new run with its manifest and the files that are known before it starts.

        With `own` this process owns it before anybody can see it, until the lock is released or the process ends.

        Raises:
            RecordError: the folder cannot be written.

        """
        try:
            self.data.mkdir(parents=True, exist_ok=True)
            with self._locked():
                attempt = self._next_attempt(serial)
                record = self._new_folder(serial)
                if own:
                    record.lock.take()
                head = {"id": record.id, "serial": serial, "attempt": attempt, "state": RECORDING}
                desk = {"pid": os.getpid(), "birth": process_birth(os.getpid())}
                dates = {"started": now_text(), "ended": None, "format": FORMAT_VERSION, "desk": desk}
                record.write_json(MANIFEST, {**head, **manifest, **dates})
        except OSError as error:
            raise RecordError(f"{self.data}: cannot be written: {error.strerror}. Choose another --data") from error
        for name, content in files.items():
            (record.folder / name).parent.mkdir(exist_ok=True)
            record.write_bytes(name, content)
        record.write_json("samples.json", {"record_bytes": RECORD_BYTES, "byte_order": "little", "fields": describe()})
        sync_folder(self.data)
        return record

    def _new_folder(self, serial: str) -> RunRecord:
        """Make a folder that is not there yet, and whose name comes after those of all others."""
        newest = max((path.name for path in self.data.glob("*Z-*")), default="")
        while True:
            now = WALL_CLOCK.now()
            stamp = _stamp(now)
            if f"{stamp}-" < newest:  # the clock was set back since then: a millisecond after it
                stamp = _stamp(max(now, _moment_of(newest, now) + timedelta(milliseconds=1)))
            folder = self.data / f"{stamp}-{_folder_name(serial)}"
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            return RunRecord(folder)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        with (self.data / ".lock").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _next_attempt(self, serial: str) -> int:
        """Return the number of the next attempt; a damaged run counts, for it may have been one of this serial."""
        highest, damaged = 0, 0
        for folder in self.data.glob(f"*-{_folder_name(serial)}"):
            record = RunRecord(folder)
            if not record.has(MANIFEST):
                continue
            try:
                manifest = record.manifest()
            except RecordError:
                damaged += 1
                continue
            if manifest["serial"] == serial:
                highest = max(highest, manifest["attempt"])
        return 1 + highest + damaged

    def runs(self) -> list[RunRecord]:
        """All runs, oldest first."""
        if not self.data.is_dir():
            return []
        return [RunRecord(path.parent) for path in sorted(self.data.glob(f"*/{MANIFEST}"))]

    def another_recipe(self, name: str, revision: int, sha256: str) -> dict[str, Any] | None:
        """Return run.json of the newest run by a recipe of the same name and revision, but of other content."""
        for run in reversed(self.runs()):
            try:
                manifest = run.manifest()
                recipe = manifest["recipe"]
                same = (recipe["name"], recipe["revision"]) == (name, revision)
            except (RecordError, KeyError, TypeError):
                continue
            if same and recipe["sha256"] != sha256:
                return manifest
        return None

    def find(self, name: str) -> RunRecord:
        """Find a run by id, folder, the end of its id, serial number (newest attempt), or `last`.

        Raises:
            StationError: there is none, or the name fits several.

        """
        if not name.strip():
            raise StationError("RUN is empty; allowed are a run id or part of it, a serial number, a folder, or last")
        if (Path(name) / MANIFEST).is_file():
            return RunRecord(Path(name).resolve())  # a run is named by its folder, and `.` has no name
        runs = self.runs()
        if Path(name).is_dir() and not any(name in (run.id, run.serial()) for run in runs):
            raise StationError(f"{name}: this folder is no run: it has no {MANIFEST}. See 'lostmotion list'")
        if not runs:
            raise StationError(f"{self.data}: holds no runs. Make one with 'lostmotion run', or name --data")
        if name == "last":
            return runs[-1]
        exact = [run for run in runs if run.id == name]
        by_serial = [run for run in runs if run.serial() == name]
        by_part = [run for run in runs if name in run.id]
        if exact or by_serial:
            return (exact or by_serial)[-1]
        if len(by_part) == 1:
            return by_part[0]
        if by_part:
            ids = ", ".join(run.id for run in by_part[:8])
            raise StationError(f"{name}: fits {len(by_part)} runs: {ids}. Write more of the id")
        raise StationError(f"{name}: no such run in {self.data}; newest is {runs[-1].id}. See 'lostmotion list'")
