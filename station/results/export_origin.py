"""What an exported file says of its run beyond the columns: by it the file is evaluated as the run is, and names it.

Parquet and TDMS hold it themselves; of a CSV file it is in the JSON file beside it. A file without it is a trace
measured elsewhere.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import CHANNELS, ROLES, Trace
from analysis.validity.evidence import RunFacts
from recipes import Recipe, RecipeError, load_bench
from recipes.schema.recipe_schema import Sampling
from station.errors import StationError
from station.records.clocks import VIRTUAL, clock_of
from station.records.program_file import StoredProgram
from station.records.run_record import RunRecord
from station.records.samples.table import Table
from station.records.timing_proof import counts_of, facts_of_counts
from station.results.evaluation import trace_of
from station.results.export import RUN_KEY, Column, sidecar, trace_columns

UNREADABLE = (StationError, RecipeError, AnalysisError, AttributeError, KeyError, TypeError, ValueError)
"""What reading a run raises that was altered, or ended before anything was measured: its files may hold anything."""

TOLD = ("serial", "attempt", "started", "state", "verdict", "unit", "clock", "scenario", "operator")
"""What the result of an exported file repeats of its run."""


def for_analysis(run: RunRecord, table: Table) -> tuple[Sequence[Column], dict[str, Any]]:
    """Return the columns of a run's trace, and what is to be said of the run beside them.

    Said are `trace`, the fingerprint of the trace, and `recorded`, what was counted while it was recorded, where the
    run has both; columns are missing where bench or program cannot be read any more.
    """
    said: dict[str, Any] = {}
    columns: Sequence[Column] = ()
    with suppress(*UNREADABLE):
        bench = load_bench(run.folder / "bench.yaml")
        segments = StoredProgram.of(run).segments
        columns = trace_columns(table, segments, bench)
        trace = trace_of(table, segments, bench, int(run.manifest()["period_ns"]), run.id)
        said |= {"trace": fingerprint_of(trace), "recorded": counts_of(table, run.read_json("timing.json"))}
    return columns, said


def fingerprint_of(trace: Trace) -> str:
    """Return the SHA-256 over all channels of a trace and the segment of each sample, as hexadecimal digits.

    Where a branch has steps, the rows are part of it at which a new one begins.
    """
    digest = hashlib.sha256()
    for name in CHANNELS:
        values = getattr(trace, name)
        digest.update(name.encode() + (b"-" if values is None else np.ascontiguousarray(values).tobytes()))
    if trace.segment is not None and trace.segments:
        ids, places = np.unique(trace.segment, return_inverse=True)
        infos = [trace.segments[int(key)] for key in ids]
        rows = np.array([(ROLES.index(one.role), one.direction, one.cycle) for one in infos], dtype=np.int64)
        digest.update(rows[places].tobytes())
        starts = np.flatnonzero(np.diff(trace.segment)) + 1
        alike = (rows[places[starts]] == rows[places[starts - 1]]).all(axis=1)
        digest.update(starts[alike].astype(np.int64).tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Origin:
    """The run that a file was exported from, as the file says; `changed` when the trace in it is another now."""

    file: Path
    run: dict[str, Any]
    changed: bool

    @property
    def day(self) -> date:
        """Day of the measurement."""
        return date.fromisoformat(self.run["started"][:10])

    @property
    def objections(self) -> list[str]:
        """Return why nothing is decided on this file, whatever its trace shows."""
        return [f"it was exported from an altered record: {one}" for one in self.run.get("altered") or ()]

    @property
    def virtual(self) -> bool:
        """Whether no real unit was measured."""
        return clock_of(self.run) == VIRTUAL or bool(self.run.get("virtual_unit"))

    def facts(self, sampling: Sampling) -> RunFacts:
        """Return how the trace was recorded, with what a recipe allows."""
        return facts_of_counts(self.run["recorded"], self.run["period_ns"], sampling)

    def is_own(self, kind: str, sha256: str) -> bool:
        """Whether a file (`recipe` or `bench`) is the one that the run was measured by."""
        return bool(self.run[kind]["sha256"] == sha256)

    def check_complete(self) -> None:
        """Refuse the export of a run that did not come to its end."""
        run, state = self.run["id"], self.run["state"]
        if state != "complete":
            raise StationError(
                f"{self.file}: exported from run {run}, which ended as {state}: it has no complete trace to evaluate. "
                f"See 'lostmotion show {run}'",
            )

    def check_recipe(self, recipe: Recipe, recipe_file: Path) -> None:
        """Refuse a recipe for another model of unit."""
        asked, was = recipe.unit_under_test.model, self.run["unit"]
        if asked != was:
            raise StationError(
                f"{recipe_file}: unit_under_test.model: found {asked}; {self.file} was exported from run "
                f"{self.run['id']}, which measured a {was}. Choose a recipe for that model",
            )

    def text(self) -> str:
        """Return where the file comes from, as one line for a person."""
        run = self.run
        said = (
            f"exported from run {run['id']} of unit {run['serial']}, measured on {run['started'][:10]} by lostmotion "
            f"{run['software']['version']}; the run's own verdict is {run['verdict']}"
        )
        return f"{said}. CHANGED SINCE: the trace in the file is not the run's" if self.changed else said

    def to_dict(self) -> dict[str, Any]:
        """Return what a result repeats of the run, as plain data."""
        told = {key: self.run.get(key) for key in TOLD}
        return {"run": self.run["id"], **told, "changed": self.changed, "text": self.text()}

    def badges(self) -> dict[str, Any]:
        """Return those keys of a result by which it is shown as that of a virtual bench, or with faults injected."""
        unit = {"model": self.run["unit"], "virtual": self.run.get("virtual_unit")}
        found = {"bench": self.run["bench"], "unit": unit}
        return found | {key: self.run[key] for key in ("scenario", "operator", "clock") if key in self.run}


def origin_of(file: Path, trace: Trace) -> Origin | None:
    """Return which run a file was exported from; None for a trace measured elsewhere.

    Raises:
        StationError: the file is an export that cannot be evaluated: without a trace, or with a damaged description.

    """
    run = next((found for read in (_in_parquet, _in_tdms, _beside_csv) if (found := read(file)) is not None), None)
    if run is None:
        return None
    try:
        origin = Origin(file, run, changed=run.get("trace") != fingerprint_of(trace))
        _ = origin.day, origin.to_dict(), origin.badges(), origin.objections
        _ = [run[kind][key] for kind in ("recipe", "bench") for key in ("name", "sha256")]
        if "trace" in run:
            _ = RunFacts(**run["recorded"], missed_allowed=0.0, sample_age_allowed_scans=0), 1e9 / run["period_ns"]
            _ = [count + 0 for count in run["recorded"].values()]
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise StationError(
            f"{file}: its description of the run is damaged ({error!r}). Export the run again"
        ) from error
    if "trace" not in run:
        raise StationError(
            f"{file}: exported from run {run['id']} without its trace: nothing was measured, or an older version wrote "
            "it. Export the run again",
        )
    return origin


def _in_parquet(file: Path) -> dict[str, Any] | None:
    import pyarrow as pa  # noqa: PLC0415 - as in `export`, each format loads its own library
    import pyarrow.parquet as pq  # noqa: PLC0415

    if not _begins_with(file, b"PAR1"):
        return None
    try:
        metadata = pq.read_schema(file).metadata or {}
    except (OSError, ValueError, pa.ArrowException):
        return None
    return _object(lambda: json.loads(metadata[RUN_KEY.encode()]))


def _in_tdms(file: Path) -> dict[str, Any] | None:
    from nptdms import TdmsFile  # noqa: PLC0415

    if not _begins_with(file, b"TDSm"):
        return None
    return _object(lambda: json.loads(TdmsFile.read_metadata(file).properties[RUN_KEY]))


def _beside_csv(file: Path) -> dict[str, Any] | None:
    beside = sidecar(file)
    return _object(lambda: json.loads(beside.read_bytes())["run"]) if beside.is_file() else None


def _begins_with(file: Path, magic: bytes) -> bool:
    with file.open("rb") as stream:
        return stream.read(len(magic)) == magic


def _object(read: Callable[[], Any]) -> dict[str, Any] | None:
    """Return what was read; None where it is no object with the id of a run: the file is not one of ours."""
    try:
        found = read()
    except (KeyError, TypeError, ValueError, OSError):
        return None
    return found if isinstance(found, dict) and isinstance(found.get("id"), str) else None
