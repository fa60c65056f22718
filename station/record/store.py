"""Where runs are kept: one folder per run, which stands alone and is never overwritten.

    <data>/<run id>/
        run.json          what, who, when, state of the run
        recipe.yaml       the recipe as run, byte for byte
        bench.yaml        the bench file, byte for byte
        program.json      what the recipe became: segments and limits
        samples.bin       every scan (layout in samples.json)
        events.jsonl      transitions, alarms with cause and next action, notes
        timing.json       proof of timing
        calibration.json  torque ratio, when the run measured one
        result.json       metrics and verdict
        loop.png, report.html, report.pdf, log.jsonl

The run id sorts by time, also where the computer's clock was set back between two runs. Several runs of one serial
number are attempts 1, 2, 3 ...
"""

from __future__ import annotations

import fcntl
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import NoneType, UnionType
from typing import Any

from station.durable import as_json, sync_folder, write_durable
from station.errors import RecordError, StationError
from station.record.run_lock import RunLock
from station.record.scan_record import RECORD_BYTES, describe
from station.wall_clock import WALL_CLOCK

STAMP = "%Y%m%dT%H%M%S.%f"
MANIFEST = "run.json"
SAMPLES = "samples.bin"
RESULT = "result.json"
SCAN_REPORT = "scan-report.json"
FORMAT_VERSION = 1
RECORDING = "recording"
INTERRUPTED = "interrupted"
LONGEST_SERIAL = 128
ENTRIES: dict[str, type | UnionType] = {
    "serial": str,
    "attempt": int,
    "state": str,
    "recipe": dict,
    "verdict": str | NoneType,
    "started": str,
    "desk": dict,
}
"""Entries of run.json that every run has from its start, and their types."""


def process_birth(pid: int) -> str:
    """Return when a process was started, in the kernel's ticks since boot, or '' when there is none.

    With the process id it names a process for good: ids are used again.
    """
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    fields = stat.rpartition(")")[2].split()
    return "" if fields[0] == "Z" else fields[19]


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


class RunRecord:
    """One run's folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lock = RunLock(folder)

    @property
    def id(self) -> str:
        """Run id: the folder's name."""
        return self.folder.name

    @property
    def samples(self) -> Path:
        """File of scan records."""
        return self.folder / SAMPLES

    def manifest(self) -> dict[str, Any]:
        """Return run.json; RecordError when it cannot be read or an entry that every run has is missing."""
        found = self.read_json(MANIFEST)
        if not isinstance(found, dict):
            raise RecordError(f"{self.folder / MANIFEST}: is damaged: it is not a run's manifest")
        wrong = [key for key, kind in ENTRIES.items() if not isinstance(found.get(key), kind)]
        recipe = found.get("recipe")
        if isinstance(recipe, dict):
            wrong += [f"recipe.{key}" for key in ("name", "revision", "sha256") if key not in recipe]
        if wrong:
            raise RecordError(f"{self.folder / MANIFEST}: is damaged: missing or wrong: {', '.join(wrong)}")
        return found

    def update(self, **changes: Any) -> None:
        """Change entries of run.json durably."""
        self.write_json(MANIFEST, self.manifest() | changes)

    def write_json(self, name: str, content: Any) -> None:
        """Write one of the run's JSON files durably."""
        write_durable(self.folder / name, as_json(content))

    def write_bytes(self, name: str, content: bytes) -> None:
        """Write one of the run's files durably."""
        write_durable(self.folder / name, content)

    def read_json(self, name: str) -> Any:
        """Read one of the run's JSON files; RecordError when it is missing or damaged."""
        path = self.folder / name
        try:
            return json.loads(path.read_bytes())
        except OSError as error:
            raise RecordError(f"{path}: cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise RecordError(f"{path}: is damaged: {error}") from error

    def has(self, name: str) -> bool:
        """Whether the run has this file."""
        return (self.folder / name).is_file()

    def records(self) -> int:
        """Complete scan records on disk."""
        try:
            return self.samples.stat().st_size // RECORD_BYTES
        except OSError:
            return 0

    def serial(self) -> str | None:
        """Serial number of the unit; None when the manifest is damaged."""
        try:
            return str(self.manifest()["serial"])
        except (RecordError, KeyError):
            return None

    def scanning(self) -> int:
        """Process id of the scan process while it lives, else 0."""
        if not self.has(SCAN_REPORT):
            return 0
        with suppress(RecordError, TypeError, ValueError, KeyError):
            said = self.read_json(SCAN_REPORT)
            pid = int(said["pid"])
            return pid if said["birth"] and process_birth(pid) == said["birth"] else 0
        return 0

    def state(self) -> str:
        """State of the run; a recording whose desk is gone is `interrupted`."""
        if self.deserted() and not self.lock.taken():
            return INTERRUPTED
        return str(self.manifest()["state"])

    def deserted(self) -> bool:
        """Whether the run was not concluded and its desk is not here; somebody else may own it (see `lock`)."""
        manifest = self.manifest()
        desk = manifest["desk"]
        return bool(manifest["state"] == RECORDING) and process_birth(desk.get("pid", 0)) != desk.get("birth")


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
            return RunRecord(Path(name))
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


def now_text() -> str:
    """Return the time in UTC, to the millisecond, as it stands in records."""
    return WALL_CLOCK.now().isoformat(timespec="milliseconds")
