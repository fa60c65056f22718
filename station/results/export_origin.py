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
from typing import Any, NamedTuple

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import CHANNELS, ROLES, Trace
from analysis.validity.evidence import RunFacts
from recipes import Recipe, RecipeError
from recipes.schema.recipe_schema import Sampling
from station.bench.request import Source
from station.documents.entries import Plain
from station.documents.exported import Counts, ExportedRun
from station.documents.manifest import Unit
from station.documents.reading import NEXT_STEP, of_plain
from station.documents.result import OriginNote
from station.documents.timing import Timing
from station.errors import RecordError, StationError
from station.records.clocks import VIRTUAL, clock_of
from station.records.program_file import StoredProgram
from station.records.run_record import BENCH_COPY, TIMING, RunRecord
from station.records.samples.table import Table
from station.records.timing_proof import counts_of, facts_of_counts
from station.results.evaluation import trace_of
from station.results.export import RUN_KEY, Column, sidecar, trace_columns
from station.results.trace_origin import MeasuredUnit, check_recipe_fits

UNREADABLE = (StationError, RecipeError, AnalysisError, AttributeError, KeyError, TypeError, ValueError)
"""What reading a run raises that was altered, or ended before anything was measured: its files may hold anything."""


HOLDS_UNKNOWN = (
    "an older version exported this file, which does not say whether a ramp was held. If it was, U must be stated with "
    "k = 3. Export the run again"
)


class TraceNote(NamedTuple):
    """Fingerprint of the trace of a run, and what was counted while it was recorded."""

    fingerprint: str
    recorded: Counts


def for_analysis(run: RunRecord, table: Table) -> tuple[Sequence[Column], TraceNote | None]:
    """Return the columns of a run's trace, and what is to be said of the run beside them.

    Columns are missing where bench or program cannot be read any more, and the note where there is no trace.
    """
    said = None
    columns: Sequence[Column] = ()
    with suppress(*UNREADABLE):
        bench = Source.read(run.folder / BENCH_COPY).bench()
        segments = StoredProgram.of(run).segments
        columns = trace_columns(table, segments, bench)
        trace = trace_of(table, segments, bench, run.manifest().period_ns, run.id)
        said = TraceNote(fingerprint_of(trace), counts_of(table, run.read(Timing, TIMING)))
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
    run: ExportedRun
    recorded: Counts
    changed: bool

    @property
    def day(self) -> date:
        """Day of the measurement."""
        return date.fromisoformat(self.run.started[:10])

    @property
    def objections(self) -> list[str]:
        """Return why nothing is decided on this file, whatever its trace shows."""
        return [f"it was exported from an altered record: {one}" for one in self.run.altered or ()]

    @property
    def virtual(self) -> bool:
        """Whether no real unit was measured."""
        return clock_of(self.run.clock) == VIRTUAL or bool(self.run.virtual_unit)

    def facts(self, sampling: Sampling) -> RunFacts:
        """Return how the trace was recorded, with what a recipe allows."""
        return facts_of_counts(self.recorded, self.run.period_ns, sampling)

    def is_own(self, kind: str, sha256: str) -> bool:
        """Whether a file (`recipe` or `bench`) is the one that the run was measured by."""
        return (self.run.recipe if kind == "recipe" else self.run.bench).sha256 == sha256

    def check_complete(self) -> None:
        """Refuse the export of a run that did not come to its end."""
        run, state = self.run.id, self.run.state
        if state != "complete":
            raise StationError(
                f"{self.file}: this file was exported from run {run}, which ended as {state}: it has no complete trace "
                f"to evaluate. See 'lostmotion show {run}'",
            )

    def check_recipe(self, recipe: Recipe, recipe_file: Path) -> None:
        """Refuse a recipe for another model of unit, or for one of another ratio or loaded by the other shaft."""
        run = self.run
        check_recipe_fits(
            recipe, recipe_file, MeasuredUnit(run.unit, run.loading, run.ratio), f"{run.id} (file {self.file})"
        )

    def text(self) -> str:
        """Return where the file comes from, as one line for a person."""
        run = self.run
        said = (
            f"exported from run {run.id} of unit {run.serial}, measured on {run.started[:10]} by lostmotion "
            f"{run.software.version}; the run's own verdict is {run.verdict}"
        )
        return f"{said}. CHANGED SINCE: the trace in the file is not the run's" if self.changed else said

    @property
    def unknown(self) -> tuple[str, ...]:
        """Return what the file does not say of its run, and what that means for the result."""
        return (HOLDS_UNKNOWN,) if self.recorded.holds is None else ()

    def document(self) -> OriginNote:
        """Return what a result repeats of the run."""
        run = self.run
        return OriginNote(
            run=run.id,
            serial=run.serial,
            attempt=run.attempt,
            started=run.started,
            state=run.state,
            verdict=run.verdict,
            unit=run.unit,
            clock=run.clock,
            scenario=run.scenario,
            operator=run.operator,
            changed=self.changed,
            text=self.text(),
        )

    @property
    def unit(self) -> Unit:
        """The unit, by which a result is shown as that of a virtual bench."""
        return Unit(model=self.run.unit, virtual=self.run.virtual_unit, noise_seed=self.run.noise_seed)


def origin_of(file: Path, trace: Trace) -> Origin | None:
    """Return which run a file was exported from; None for a trace measured elsewhere.

    Raises:
        StationError: the file is an export that cannot be evaluated: without a trace, or with a damaged description.

    """
    found = next((said for read in (_in_parquet, _in_tdms, _beside_csv) if (said := read(file)) is not None), None)
    if found is None:
        return None
    try:
        run = of_plain(ExportedRun, found, file)
    except RecordError as error:
        what = str(error).removeprefix(f"{file}: is damaged: ").removesuffix(f". {NEXT_STEP}")
        raise StationError(
            f"{file}: the description of the run in this file is damaged ({what}). Export the run again"
        ) from error
    if run.trace is None:
        raise StationError(
            f"{file}: this file of run {run.id} has no trace: nothing was measured, or an older version wrote the "
            "file. Export the run again",
        )
    if run.recorded is None:
        raise StationError(
            f"{file}: the description of the run in this file is damaged (the section 'recorded' is missing). Export "
            "the run again"
        )
    return Origin(file, run, run.recorded, changed=run.trace != fingerprint_of(trace))


def _in_parquet(file: Path) -> Plain | None:
    import pyarrow as pa  # noqa: PLC0415 - as in `export`, each format loads its own library
    import pyarrow.parquet as pq  # noqa: PLC0415

    if not _begins_with(file, b"PAR1"):
        return None
    try:
        metadata = pq.read_schema(file).metadata or {}
    except (OSError, ValueError, pa.ArrowException):
        return None
    return _object(lambda: json.loads(metadata[RUN_KEY.encode()]))


def _in_tdms(file: Path) -> Plain | None:
    from nptdms import TdmsFile  # noqa: PLC0415

    if not _begins_with(file, b"TDSm"):
        return None
    return _object(lambda: json.loads(TdmsFile.read_metadata(file).properties[RUN_KEY]))


def _beside_csv(file: Path) -> Plain | None:
    beside = sidecar(file)
    return _object(lambda: json.loads(beside.read_bytes())["run"]) if beside.is_file() else None


def _begins_with(file: Path, magic: bytes) -> bool:
    with file.open("rb") as stream:
        return stream.read(len(magic)) == magic


def _object(read: Callable[[], Any]) -> Plain | None:
    """Return what was read; None where it is no object with the id of a run: the file is not one of ours."""
    try:
        found = read()
    except (KeyError, TypeError, ValueError, OSError):
        return None
    return found if isinstance(found, dict) and isinstance(found.get("id"), str) else None
