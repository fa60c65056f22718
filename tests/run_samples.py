"""The samples of stored runs for tests: read wherever they are, put back as they were recorded, altered."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from station.records.run_record import PACKED, RunRecord
from station.records.samples.check import ReadBack
from station.records.samples.packed import packed
from station.records.samples.samples import check_samples, read_samples, samples_bytes
from station.records.samples.table import Table, table_of


def recorded(folder: Path) -> bytes:
    """Return all records of a run, byte for byte."""
    return samples_bytes(RunRecord(folder))


def records_of(folder: Path) -> Table:
    """Return all records of a run as a table."""
    return read_samples(RunRecord(folder))


def digest_of(folder: Path) -> str:
    """Return a hash of what a run recorded, without the columns that say how long it took."""
    rows, hashed = records_of(folder).rows, hashlib.sha256()
    for name in ("sequence", "scan", "image", "orders"):
        hashed.update(np.ascontiguousarray(rows[name]).tobytes())
    return hashed.hexdigest()


def read_back(folder: Path, expected: int | None = None) -> ReadBack:
    """Check all records of a run."""
    return check_samples(RunRecord(folder), expected)


def as_recorded(run: RunRecord) -> bytes:
    """Put the samples of a run back into the file that they were recorded to; return them."""
    content = samples_bytes(run)
    if run.is_packed():
        manifest = run.read_json("run.json")
        run.samples.write_bytes(content)
        (run.folder / PACKED).unlink()
        del manifest["samples"]
        run.write_json("run.json", manifest)
    return content


def flip(run: RunRecord, at: int, bits: int = 1) -> None:
    """Flip bits of one byte in the recorded samples, in whichever file they are."""
    content = bytearray(samples_bytes(run))
    content[at] ^= bits
    if run.is_packed():
        (run.folder / PACKED).write_bytes(packed(table_of(bytes(content), run.layout())))
    else:
        run.samples.write_bytes(content)
