"""Whole records as rows of Parquet: a row group for each run, a row for each file of its folder, byte for byte."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from station.archive.settings import ArchiveError
from station.atomic_file import PART, read_file
from station.documents.manifest import MANIFEST, Manifest
from station.documents.result import MetricValue, Result, SideValue
from station.records.clocks import VIRTUAL, clock_of
from station.records.run_lock import LOCK
from station.records.run_record import RESULT, RunRecord

FORMAT = 1
METADATA = b"lostmotion"
"""Key in the footer of an object: what it is, of which format, and of which chain."""

_METRIC = pa.struct([
    ("metric", pa.string()), ("branch", pa.string()), ("side", pa.string()), ("main", pa.bool_()),
    ("unit", pa.string()), ("value", pa.float64()), ("uncertainty", pa.float64()), ("limit_min", pa.float64()),
    ("limit_max", pa.float64()), ("verdict", pa.string()),
])  # fmt: skip

Row = dict[str, Any]
"""A row by the names of its columns, whose types stand in the schema."""

OF_A_RUN = (
    ("run", pa.string()), ("serial", pa.string()), ("attempt", pa.int32()), ("model", pa.string()),
    ("bench", pa.string()), ("recipe", pa.string()), ("revision", pa.int32()), ("started", pa.string()),
    ("state", pa.string()), ("verdict", pa.string()), ("operator", pa.string()), ("software", pa.string()),
    ("virtual", pa.bool_()),
)  # fmt: skip
"""Columns that say the same in every row of a run: questions are asked by them."""

OF_A_FILE = (("name", pa.string()), ("bytes", pa.int64()), ("sha256", pa.string()))
ROW_SCHEMA = pa.schema([*OF_A_RUN, *OF_A_FILE, ("metrics", pa.list_(_METRIC)), ("content", pa.binary())])
PLAIN_COLUMNS = [name for name, _ in (*OF_A_RUN, *OF_A_FILE)]


@dataclass(frozen=True)
class ArchivedFile:
    """A file of a run as it is in the archive."""

    name: str
    sha256: str
    content: bytes


def schema_of(kind: str, schema: pa.Schema, chain: str) -> pa.Schema:
    """Return a schema with what an object says of itself; kind: `full` or `trace`."""
    said = json.dumps({"format": FORMAT, "kind": kind, "chain": chain})
    return schema.with_metadata({METADATA: said.encode()})


def chain_of(file: pq.ParquetFile, name: str) -> str:
    """Return the id of the chain that an object's runs are of.

    Raises:
        ArchiveError: it is no object of an archive, or of a newer format.

    """
    try:
        said = json.loads((file.schema_arrow.metadata or {})[METADATA])
        version, chain = int(said["format"]), str(said["chain"])
    except (KeyError, ValueError, TypeError) as error:
        raise ArchiveError(f"{name}: is not an archive object of lostmotion. Move it out of the archive") from error
    if version > FORMAT:
        raise ArchiveError(
            f"archive object {name}: found format {version}; this program reads up to {FORMAT}. Use a newer lostmotion"
        )
    return chain


def opened(stream: BinaryIO, name: str) -> pq.ParquetFile:
    """Return an object as Parquet; ArchiveError where it is none: cut short, or something else."""
    try:
        return pq.ParquetFile(stream)
    except (pa.ArrowInvalid, pa.ArrowException) as error:
        raise ArchiveError(
            f"archive object {name}: is incomplete: {error}. Delete it, and run 'lostmotion archive push' while its "
            "runs are on this computer"
        ) from error


def files_of(run: RunRecord) -> list[str]:
    """Return the names of all files of a run's folder, in order, without locks and what is half written."""
    paths = (path.relative_to(run.folder) for path in sorted(run.folder.rglob("*")) if path.is_file())
    return [path.as_posix() for path in paths if path.name != LOCK and not path.name.endswith(PART)]


def rows_of_run(run: RunRecord) -> pa.Table:
    """Return the rows of a run.

    Raises:
        RecordError: a file of it cannot be read.

    """
    manifest = run.manifest()
    content: dict[str, bytes] = {}
    for name in files_of(run):
        content[name] = read_file(run.folder / name, None)
    said = _said(manifest)
    rows = [
        said
        | {"name": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest(), "content": data}
        | {"metrics": _metrics(run) if name == MANIFEST else None}
        for name, data in content.items()
    ]
    return pa.Table.from_pylist(rows, schema=ROW_SCHEMA)


def _said(manifest: Manifest) -> Row:
    return {
        "run": manifest.id,
        "serial": manifest.serial,
        "attempt": manifest.attempt,
        "model": manifest.unit.model,
        "bench": manifest.bench.name,
        "recipe": manifest.recipe.name,
        "revision": manifest.recipe.revision,
        "started": manifest.started,
        "state": manifest.state,
        "verdict": manifest.verdict,
        "operator": manifest.operator,
        "software": manifest.software.version,
        "virtual": bool(manifest.bench.embedded or manifest.unit.virtual) or clock_of(manifest.clock) == VIRTUAL,
    }


def _metrics(run: RunRecord) -> list[Row]:
    """Return value, U, limits and verdict of every side of every metric; none of a run without a result."""
    if not run.has(RESULT):
        return []
    return [
        {
            "metric": metric.id,
            "branch": metric.branch,
            "side": side,
            "main": side == metric.side,
            "unit": metric.unit,
            "value": found.value,
            "uncertainty": found.uncertainty,
            "limit_min": metric.limits.min,
            "limit_max": metric.limits.max,
            "verdict": found.verdict,
        }
        for metric in run.read(Result, RESULT).metrics
        for side, found in _sides(metric).items()
    ]


def _sides(metric: MetricValue) -> dict[str, MetricValue | SideValue]:
    return {**metric.sides, metric.side: metric}


def full_writer(path: Path, chain: str) -> pq.ParquetWriter:
    """Return what writes an object of whole records: `write_table` for each run."""
    return pq.ParquetWriter(
        path,
        schema_of("full", ROW_SCHEMA, chain),
        compression="zstd",
        use_dictionary=PLAIN_COLUMNS,
        write_statistics=PLAIN_COLUMNS,
    )


def files_in(file: pq.ParquetFile, group: int, place: str) -> list[ArchivedFile]:
    """Return the files of a run from its row group, each compared with its SHA-256.

    Raises:
        ArchiveError: the row group cannot be read, or a file is not as it was archived.

    """
    try:
        table = file.read_row_group(group, columns=[*(name for name, _ in OF_A_FILE), "run", "content"])
    except (pa.ArrowException, OSError, IndexError) as error:
        raise ArchiveError(f"archive object {place}: row group {group} cannot be read: {error}. {REPLACE}") from error
    found = []
    for row in table.to_pylist():
        name, content = str(row["name"]), row["content"]
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise ArchiveError(
                f"archive object {place}: its file {name!r} would be written outside the run's folder. {REPLACE}"
            )
        if hashlib.sha256(content).hexdigest() != row["sha256"]:
            raise ArchiveError(
                f"archive object {place}: the file {name} of run {row['run']} has changed since it was archived. "
                f"{REPLACE}"
            )
        found.append(ArchivedFile(name, row["sha256"], content))
    return found


REPLACE = (
    "This archive object was changed or damaged. Restore it from a copy of the archive. Without a copy, delete the "
    "object and its line in archive.jsonl, then run 'lostmotion archive push' while its runs are on this computer"
)
"""What a person does about an object that is not as it was written."""


def run_in(file: pq.ParquetFile, group: int) -> str:
    """Return the id of the run in a row group."""
    return str(file.read_row_group(group, columns=["run"]).column("run")[0].as_py())
