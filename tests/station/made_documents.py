"""Documents for tests, made of the entries that a test is about; the others are those of a plain run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from station.documents.entries import plain as plain_of
from station.documents.events import Alarm, LeftState
from station.documents.manifest import Manifest
from station.documents.reading import Document, of_plain
from station.documents.result import CheckValue, MetricValue, Result, StageRow
from station.documents.timing import Timing

NONE_US = {"p50": 0.0, "p99": 0.0, "p999": 0.0, "max": 0.0}
BENCH = {"name": "virtual", "revision": 1, "sha256": "11", "embedded": True}
UNIT = {"model": "RV", "virtual": "P1"}
RECIPE = {"name": "inverse", "revision": 1, "sha256": "00"}


def made(kind: type[Document], plain: object) -> Document:
    return of_plain(kind, plain, Path("made.json"))


def metric(**changes: Any) -> MetricValue:
    plain = {"id": "windup", "value": 9.0, "unit": "arcmin", "uncertainty": None, "branch": "mean", "side": "both"}
    return made(MetricValue, plain | {"verdict": None} | changes)


def checks(*rows: dict[str, Any]) -> tuple[CheckValue, ...]:
    return tuple(made(CheckValue, row) for row in rows)


def stages(*rows: dict[str, Any]) -> tuple[StageRow, ...]:
    return tuple(made(StageRow, row) for row in rows)


def timing(**changes: Any) -> Timing:
    plain = {"period_ns": 1_000_000, "clock": "virtual", "scans": 10, "missed": 0, "longest_gap_periods": 0}
    plain |= {"lateness_us": NONE_US, "work_us": NONE_US, "oldest_sample_scans": 1}
    return made(Timing, plain | changes)


def alarm(**changes: Any) -> Alarm:
    plain = {"scan": 7342, "first": True, "id": "guard_open", "reaction": "quick_stop", "t_s": 7.342}
    plain |= {"state": "calibrate", "text": "Guard opened", "cause": "open", "next_action": "Close it"}
    return made(Alarm, plain | changes)


def left(**changes: Any) -> LeftState:
    plain = {"torque_nm": -9.71, "torque_known": True, "lock": "closed", "lock_known": True, "drive": "off"}
    return made(LeftState, plain | {"drive_known": True, "release_torque_nm": 8.24} | changes)


def result(**changes: Any) -> Result:
    """A result; documents among the changes stand in it as they are."""
    plain = {"run": "id", "serial": "SN1", "recipe": RECIPE, "bench": BENCH, "unit": UNIT, "clock": "real"}
    plain |= {"state": "complete", "verdict": "PASS", "reasons": [], "metrics": []}
    return made(Result, plain_of(plain | changes))


def manifest(**changes: Any) -> Manifest:
    plain = {"id": "id", "serial": "SN1", "attempt": 1, "state": "complete", "verdict": "PASS", "clock": "virtual"}
    plain |= {"recipe": RECIPE, "bench": BENCH, "unit": UNIT, "period_ns": 1_000_000, "notes": [], "ring": None}
    plain |= {"software": {"name": "lostmotion", "version": "1", "python": "3", "platform": "here"}, "format": 1}
    plain |= {"started": "2026-01-02T03:04:05.000+00:00", "ended": "2026-01-02T03:05:05.000+00:00"}
    return made(Manifest, plain | {"desk": {"pid": 1, "birth": ""}} | changes)
