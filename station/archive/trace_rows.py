"""Traces as rows of Parquet: a row group for each run, its eight channels, and beside them what an evaluation asks.

What an evaluation asks beside the channels (recipe, bench, segments, counts of the recording) is JSON in the first row
of a run, so that one row group answers what another definition of a metric would say.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import CHANNELS, SegmentInfo, Trace
from analysis.trace.units import FloatArray
from recipes import RecipeError
from station.archive.full_rows import REPLACE, schema_of
from station.archive.settings import ArchiveError
from station.atomic_file import read_file
from station.bench.measuring import CHANNEL_OF_SENSOR
from station.bench.request import Source
from station.documents.archived import TraceFacts
from station.documents.entries import plain
from station.documents.reading import document_in
from station.errors import RecordError, StationError
from station.records.run_record import BENCH_COPY, RunRecord
from station.records.seal import fingerprint
from station.results.run_analysis import recorded_trace

DELAY = "delay_s_"
"""How the column begins that says how long before its row a channel was measured [s]."""

DELAYED = tuple(CHANNEL_OF_SENSOR.values())
FIGURES = (*CHANNELS, *(f"{DELAY}{name}" for name in DELAYED))
TRACE_SCHEMA = pa.schema([
    ("run", pa.string()),
    *((name, pa.float64()) for name in FIGURES),
    ("segment", pa.int32()),
    ("facts", pa.string()),
])  # fmt: skip


class ArchivedTrace(NamedTuple):
    """A trace as it is in the archive."""

    facts: TraceFacts
    trace: Trace


def trace_writer(path: Path, chain: str) -> pq.ParquetWriter:
    """Return what writes an object of traces: `write_table` for each run."""
    return pq.ParquetWriter(
        path,
        schema_of("trace", TRACE_SCHEMA, chain),
        compression="zstd",
        use_dictionary=["run", "segment", *(f"{DELAY}{name}" for name in DELAYED)],
        column_encoding=dict.fromkeys(CHANNELS, "BYTE_STREAM_SPLIT"),
        write_statistics=["run"],
    )


def trace_rows(run: RunRecord) -> pa.Table | None:
    """Return the rows of a run's trace; None for a run that has no complete one, or an older kind of record."""
    if run.manifest().state != "complete":
        return None
    try:
        recipe, bench = (read_file(run.folder / f"{part}.yaml").decode() for part in ("recipe", "bench"))
        recorded = recorded_trace(run, Source.read(run.folder / BENCH_COPY).bench())
        facts = TraceFacts(
            run=run.id,
            sha256=fingerprint(run.folder / "run.json").sha256,
            recipe=recipe,
            bench=bench,
            day=run.day().isoformat(),
            period_ns=recorded.period_ns,
            counts=recorded.counts,
            objections=tuple(recorded.objections),
            segments={str(key): (one.role, one.direction, one.cycle) for key, one in recorded.trace.segments.items()},
        )
    except (StationError, RecipeError, AnalysisError, ValueError, OSError):
        return None  # what cannot be read today is kept in the whole record, byte for byte
    return _table(recorded.trace, facts)


def _table(trace: Trace, facts: TraceFacts) -> pa.Table:
    count = trace.samples
    columns: dict[str, pa.Array] = {"run": pa.array([facts.run] * count, pa.string())}
    for name in CHANNELS:
        columns[name] = _floats(getattr(trace, name), count)
    for name in DELAYED:
        columns[f"{DELAY}{name}"] = _floats(trace.delays_s.get(name), count)
    columns["segment"] = pa.nulls(count, pa.int32()) if trace.segment is None else pa.array(trace.segment, pa.int32())
    said = json.dumps(plain(facts), ensure_ascii=False)
    columns["facts"] = pa.array([said, *([None] * (count - 1))], pa.string())
    return pa.table(columns, schema=TRACE_SCHEMA)


def _floats(values: FloatArray | None, count: int) -> pa.Array:
    return pa.nulls(count, pa.float64()) if values is None else pa.array(values, pa.float64())


def digest_of(table: pa.Table) -> str:
    """Return the SHA-256 over the values of a trace and its facts, whatever file they stand in."""
    digest = hashlib.sha256()
    for name in (*FIGURES, "segment"):
        column = table.column(name)
        digest.update(f"{name} {column.null_count} {len(column)}\n".encode())
        if column.null_count == 0:
            digest.update(np.ascontiguousarray(column.to_numpy()).tobytes())
    digest.update(str(table.column("facts")[0].as_py()).encode())
    return digest.hexdigest()


def rows_in(file: pq.ParquetFile, group: int, place: str) -> pa.Table:
    """Return the rows of a run; ArchiveError where they cannot be read."""
    try:
        return file.read_row_group(group)
    except (pa.ArrowException, OSError, IndexError) as error:
        raise ArchiveError(f"archive object {place}: row group {group} cannot be read: {error}. {REPLACE}") from error


def trace_in(table: pa.Table, sha256: str, place: str) -> ArchivedTrace:
    """Return rows as a trace again, the same numbers to the last bit.

    Raises:
        ArchiveError: they are not those that were archived.

    """
    if digest_of(table) != sha256:
        raise ArchiveError(f"archive object {place}: its trace has changed since it was archived. {REPLACE}")
    try:
        facts = document_in(TraceFacts, str(table.column("facts")[0].as_py()).encode(), Path(place))
    except RecordError as error:
        raise ArchiveError(f"{place}: {error}") from error
    measured = {name: array for name in CHANNELS if (array := _array(table, name)) is not None}
    delays = {name: array for name in DELAYED if (array := _array(table, f"{DELAY}{name}")) is not None}
    segments = {int(key): SegmentInfo(*one) for key, one in facts.segments.items()}
    segment = table.column("segment")
    return ArchivedTrace(
        facts,
        Trace(
            **measured,  # type: ignore[arg-type]
            delays_s=delays,
            segment=None if segment.null_count else segment.to_numpy().astype(np.int64),
            segments=segments,
            source=facts.run,
        ),
    )


def _array(table: pa.Table, name: str) -> FloatArray | None:
    column = table.column(name)
    return None if column.null_count else column.to_numpy()
