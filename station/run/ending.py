"""How a scan ended, as its desk knows it: on disk before the run is concluded, so that anybody else can conclude it.

The room for it is taken before the run starts: a disk that fills up in the meantime costs no verdict.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from station.durable import reserve
from station.errors import BenchFaultError
from station.records.ring.reader import RingReader
from station.records.ring.ring import StopCause
from station.records.run_record import SCAN_REPORT, RunRecord

DESK_REPORT = "desk-report.json"
REPORT_BYTES = 1 << 18
"""Room that is taken for it: counters, histograms of the timing, the periods that were missed, notes."""

VIRTUAL_REALTIME: dict[str, object] = {
    "fifo": False,
    "mlock": False,
    "details": {"clock": "virtual time: scans follow each other as fast as they go, nothing is asked of the machine"},
}


@dataclass(frozen=True)
class Ending:
    """How the scan ended: records it says it wrote, those it lost, its report, and why it ended early if it did.

    `refused`: the bench could not be opened, nothing has moved. `started_ns`: monotonic time; scan n was due n + 1
    periods after it.
    """

    written: int
    lost: int = 0
    realtime: dict[str, object] = field(default_factory=lambda: dict(VIRTUAL_REALTIME))
    notes: list[dict[str, Any]] = field(default_factory=list)
    trouble: str = ""
    refused: bool = False
    counters: dict[str, int] = field(default_factory=dict)
    times: dict[str, Any] = field(default_factory=dict)
    started_ns: int = 0
    clock_jumped_s: float = 0.0
    """By how much the computer's wall clock was set in the middle."""
    stopped_because: str = ""
    """Subject of the sentence that tells who stopped the run and why; empty for the operator."""
    stopped_by: str = ""
    """Name of that cause (`StopCause`) in small letters; empty for the operator."""
    desk_died: str = ""
    """What became of a run whose desk ended in the middle; empty where it was there to the end."""
    disk: dict[str, float] = field(default_factory=dict)
    pace: dict[str, Any] | None = None
    """What the scan says of a bench that waited for it: its unit, and what was stretched; None for any other bench."""

    @classmethod
    def refused_by(cls, record: RunRecord, error: BenchFaultError) -> Self:
        """Return the ending of a run whose bench could not be opened: nothing has moved."""
        return cls(written=record.records(), realtime={"details": {}}, trouble=str(error), refused=True)

    @classmethod
    def kept_in(cls, record: RunRecord) -> Self | None:
        """Return the ending that a desk has put on disk; None where it did not come so far, or nobody can read it."""
        with suppress(TypeError):
            said = _read(record.folder / DESK_REPORT)
            return cls(**said) if said else None
        return None

    def keep(self, record: RunRecord) -> None:
        """Put the ending on disk: from here on the run is concluded by it, whoever does that.

        Raises:
            RecordError: the disk refuses it.

        """
        record.write_json(DESK_REPORT, dataclasses.asdict(self))


def take_room(record: RunRecord) -> None:
    """Take the room for the ending before the run starts; RecordError when the disk has none."""
    reserve(record.folder / DESK_REPORT, REPORT_BYTES)


def scan_report(record: RunRecord) -> dict[str, Any]:
    """Return what the scan process said at its end; nothing where a failing disk kept none of it, or half."""
    return _read(record.folder / SCAN_REPORT)


def _read(path: Path) -> dict[str, Any]:
    """Return a report in which every entry is of its kind; nothing of one that is damaged: half of it may be wrong."""
    with suppress(OSError, ValueError, RecursionError):
        said = json.loads(path.read_bytes())
        if isinstance(said, dict) and all(KINDS[name](value) for name, value in said.items() if name in KINDS):
            return said
    return {}


def _count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _flag(value: Any) -> bool:
    return isinstance(value, bool)


def _block(value: Any) -> bool:
    return isinstance(value, dict)


def _rows(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, dict) for one in value)


def _notes(value: Any) -> bool:
    return _rows(value) and all(
        _count(one.get("scan")) and _text(one.get("kind")) and _text(one.get("text")) for one in value
    )


def _realtime(value: Any) -> bool:
    return _block(value) and _block(value.get("details", {})) and _rows(value.get("machine", []))


KINDS: dict[str, Callable[[Any], bool]] = {
    "written": _count,
    "lost": _count,
    "started_ns": _count,
    "clock_jumped_s": _number,
    "state": _text,
    "error": _text,
    "trouble": _text,
    "stopped_because": _text,
    "stopped_by": _text,
    "desk_died": _text,
    "refused": _flag,
    "realtime": _realtime,
    "counters": _block,
    "times": _block,
    "disk": _block,
    "notes": _notes,
}
"""Entries of the reports of desk and scan process that are read again, and what each may hold."""


def cause_name(ring: RingReader) -> str:
    """Return the name of what stopped a run although nobody asked for it; empty where the ring knows of nothing."""
    return "" if ring.stop_cause is StopCause.NONE else ring.stop_cause.name.lower()
