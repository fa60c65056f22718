"""One run's folder: its files, its manifest, and the state that the run is in.

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

A folder stands alone and is never overwritten.
"""

from __future__ import annotations

import json
from contextlib import suppress
from datetime import date
from pathlib import Path
from types import NoneType, UnionType
from typing import Any

from station.durable import as_json, refused, write_durable
from station.errors import RecordError
from station.record.run_lock import RunLock
from station.record.scan_record import RECORD_BYTES

MANIFEST = "run.json"
SAMPLES = "samples.bin"
RESULT = "result.json"
SCAN_REPORT = "scan-report.json"
RECORDING = "recording"
INTERRUPTED = "interrupted"
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

    def day(self) -> date:
        """Return the day of the run, in UTC: calibrations in its bench file are judged by it, whenever that is.

        Raises:
            RecordError: run.json cannot be read, or its `started` is no moment.

        """
        started = self.manifest()["started"]
        try:
            return date.fromisoformat(started[:10])
        except ValueError as error:
            raise RecordError(f"{self.folder / MANIFEST}: is damaged: started: {error}") from error

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
            raise refused(path, error, "read") from error
        except ValueError as error:
            raise RecordError(f"{path}: is damaged: {error}") from error

    def remove(self, name: str) -> None:
        """Remove one of the run's files if it is there; RecordError when the disk refuses that."""
        path = self.folder / name
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise RecordError(f"{path}: cannot be removed: {error.strerror}") from error

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
