"""A data folder of thousands of concluded runs, every one sealed and signed as a bench does it, with small files."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest import mock

from station.atomic_file import as_json
from station.documents.entries import plain
from station.records.chain.entries import CREATED, SEALED
from station.records.chain.writing import writing_to
from station.records.run_record import RunRecord
from station.records.seal import fingerprint, sealed_names

FIRST = datetime(2024, 1, 1, tzinfo=UTC)
EVERY = timedelta(minutes=4)
UNITS_MEASURED_TWICE = 20
"""One in so many units fails and is measured a second time."""

METRICS = ("backlash_width_3pct", "lost_motion", "spring_constant", "hysteresis_loss", "torsional_stiffness")
CHECKS = ("loop_closed", "drift", "saturation", "missed_periods", "sample_age", "points", "lag", "noise")


def make_runs(data: Path, count: int, first: int = 0) -> None:
    """Make that many runs in a data folder, numbered from `first`.

    Nothing waits for the disk, which a benchmark's folder need not survive.
    """
    data.mkdir(parents=True, exist_ok=True)
    recipe, bench = b"recipe: {name: small, revision: 1}\n", b"bench: {name: line-1, revision: 1}\n"
    with _no_waiting(), writing_to(data) as chain:
        for number in range(first, first + count):
            again = number % UNITS_MEASURED_TWICE == UNITS_MEASURED_TWICE - 1
            serial, attempt = f"U{number - again:06}", 1 + again
            moment = FIRST + number * EVERY
            run = RunRecord(data / f"{moment:%Y%m%dT%H%M%S}.000Z-{serial}")
            run.folder.mkdir()
            hashes = {"recipe": hashlib.sha256(recipe).hexdigest(), "bench": hashlib.sha256(bench).hexdigest()}
            place = chain.next_place
            chain.append(CREATED, run=run.id, serial=serial, attempt=attempt, **hashes)
            manifest = _manifest(run, serial, attempt, moment, hashes) | {"chain": plain(place)}
            verdict = "FAIL" if (number + 1) % UNITS_MEASURED_TWICE == UNITS_MEASURED_TWICE - 1 else "PASS"
            _write(run, recipe, bench, _result(run, manifest, number, verdict))
            files = {name: plain(fingerprint(run.folder / name)) for name in sealed_names(run)}
            content = as_json(manifest | {"state": "complete", "verdict": verdict, "records": 0, "files": files})
            (run.folder / "run.json").write_bytes(content)
            said = {"serial": serial, "attempt": attempt, "created": place.counter}
            sha256 = hashlib.sha256(content).hexdigest()
            chain.append(SEALED, run=run.id, sha256=sha256, state="complete", verdict=verdict, **said)


@contextlib.contextmanager
def _no_waiting() -> Iterator[None]:
    with mock.patch.object(os, "fsync", return_value=None):
        yield


def _manifest(run: RunRecord, serial: str, attempt: int, moment: datetime, hashes: dict[str, str]) -> dict[str, Any]:
    started = moment.isoformat(timespec="milliseconds")
    return {
        "id": run.id,
        "serial": serial,
        "attempt": attempt,
        "recipe": {"name": "small", "revision": 1, "sha256": hashes["recipe"], "file": "small.yaml"},
        "bench": {"name": "line-1", "revision": 1, "sha256": hashes["bench"], "embedded": False},
        "software": {"name": "lostmotion", "version": "benchmark"},
        "unit": {"model": "RV-40E-121", "virtual": None},
        "scenario": None,
        "operator": None,
        "clock": "real",
        "period_ns": 1_000_000,
        "notes": [],
        "ring": None,
        "started": started,
        "ended": started,
        "format": 1,
        "desk": {"pid": 1, "birth": ""},
    }


def _write(run: RunRecord, recipe: bytes, bench: bytes, result: dict[str, Any]) -> None:
    for name, content in (
        ("recipe.yaml", recipe), ("bench.yaml", bench), ("samples.bin", b""), ("events.jsonl", b"{}\n"),
        ("samples.json", b'{"record_bytes": 1, "fields": []}\n'), ("timing.json", b"{}\n"), ("program.json", b"{}\n"),
        ("result.json", json.dumps(result).encode()),
    ):  # fmt: skip
        (run.folder / name).write_bytes(content)


def _result(run: RunRecord, manifest: dict[str, Any], number: int, verdict: str) -> dict[str, Any]:
    metrics = []
    for place, name in enumerate(METRICS):
        value = 0.5 + 0.0123456789 * ((number * 7919 + place * 104729) % 97) / 97
        side = {"value": value, "uncertainty": 0.0123, "verdict": verdict if place == 0 else "PASS"}
        metrics.append({
            "id": name, "definition": f"definition of {name}", "unit": "arcmin", "branch": "mean", "side": "+",
            "estimator": "interpolation", "choices": [], "band": 0.03, "torque_nm": None, "cycles": 3,
            "coverage_factor": 2.0, "limits": {"min": None, "max": 1.0}, **side, "sides": {"+": side, "-": side},
        })  # fmt: skip
    gates = [{"id": name, "figure": 0.1, "limit": 1.0, "unit": "%", "passed": True, "text": name} for name in CHECKS]
    own = {
        key: manifest[key] for key in ("serial", "attempt", "recipe", "bench", "unit", "scenario", "operator", "clock")
    }
    own |= {"run": run.id, "state": "complete", "verdict": verdict, "reasons": [], "alarms": [], "notes": []}
    own |= {"stages": [{"stage": "output torque", "applied": False}], "timing": None}
    return own | {"metrics": metrics, "gates": gates}
