"""Objects that are in the archive and that nobody noted: looked through byte for byte, and told as a line of the note.

Their writer was killed between place and note, or the note of the data folder is lost.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq

from station.archive.fetch import folder_of
from station.archive.full_rows import chain_of, files_in, opened, run_in
from station.archive.place import Place
from station.archive.settings import ArchiveError
from station.archive.trace_rows import digest_of, trace_rows, trace_writer
from station.documents.archived import ArchivedRun, ArchiveLine, ArchiveObject
from station.documents.manifest import MANIFEST
from station.records.chain.chain_file import Chain
from station.records.chain.entries import SEALED
from station.records.run_record import RunRecord
from station.records.seal import fingerprint
from station.wall_clock import now_text

FULL, TRACE = "full", "trace"
"""Folders of the archive: whole records, and traces."""


def trace_name(full: str) -> str:
    """Return the name of the traces of an object of whole records: the same below `trace`."""
    return f"{TRACE}/{full.removeprefix(f'{FULL}/')}"


def traced_run(run: RunRecord, group: int, writer: pq.ParquetWriter) -> ArchivedRun:
    """Write the trace of a run, where it has one; return the run, `trace` being 0 where it has."""
    rows = trace_rows(run)
    if rows is not None:
        writer.write_table(rows)
    return ArchivedRun(
        run=run.id,
        sha256=fingerprint(run.folder / MANIFEST).sha256,
        group=group,
        trace=None if rows is None else 0,
        trace_sha256=None if rows is None else digest_of(rows),
    )


def with_groups(runs: Iterable[ArchivedRun]) -> tuple[ArchivedRun, ...]:
    """Return runs with the row groups of their traces, which stand one after the other."""
    found, group = [], 0
    for one in runs:
        found.append(one if one.trace is None else replace(one, trace=group))
        group += one.trace is not None
    return tuple(found)


def line_of_object(data: Path, place: Place, chain: Chain, name: str) -> ArchiveLine | None:
    """Return the line of an object of whole records that is in place; None where it is of another chain.

    Its traces are made again of its records: they are the same bytes where the object of traces is in place too.

    Raises:
        ArchiveError: it is not as it was written.

    """
    full = _whole(place, chain, name)
    if full is None:
        return None
    with tempfile.TemporaryDirectory(prefix=".archiving-", dir=data) as scratch:
        path = Path(scratch) / "trace.parquet"
        found = []
        with trace_writer(path, chain.id) as writer:
            for group, run in enumerate(_runs(place, name)):
                with folder_of(place, name, group, run) as folder:
                    found.append(traced_run(RunRecord(folder), group, writer))
        runs = with_groups(found)
        traced = any(one.trace is not None for one in runs)
        trace = place.keep(path, trace_name(name), chain.id) if traced else None
    return ArchiveLine(url=place.settings.url, verified=now_text(), full=full, trace=trace, runs=runs)


def _runs(place: Place, name: str) -> list[str]:
    with place.opened(name) as stream:
        file = opened(stream, name)
        return [run_in(file, group) for group in range(file.num_row_groups)]


def _whole(place: Place, chain: Chain, name: str) -> ArchiveObject | None:
    """Read a whole object, and hold the run.json of each run against the chain; None for one of another chain."""
    with place.opened(name) as stream:
        file = opened(stream, name)
        if chain_of(file, name) != chain.id:
            return None
        for group in range(file.num_row_groups):
            sha256 = next((one.sha256 for one in files_in(file, group, name) if one.name == MANIFEST), "")
            run = run_in(file, group)
            sealed = [str(one.fields["sha256"]) for one in chain.entries_of(run) if one.kind == SEALED and one.signed]
            if sealed and sha256 not in sealed:  # a run from before the chain has no line in it
                raise ArchiveError(
                    f"archive object {name}: the run.json of run {run} differs from its entry in chain.jsonl. "
                    "Move this object out of the archive"
                )
        size = stream.seek(0, os.SEEK_END)
    return ArchiveObject(name=name, sha256=place.sha256(name), bytes=size)
