"""The samples of a run, wherever they are: raw while it is recorded, packed from when it is concluded.

    samples.bin      every record as it came from the scan; stays where a run was interrupted or a record is not sound
    samples.parquet  the same records, packed when the run is concluded (`station.records.samples.packed`)

`samples` in run.json says that they are packed, and has size and SHA-256 of the raw bytes. The raw file goes only after
the packed one was read back from the disk, gave the same bytes, and is sealed; who is killed in between loses nothing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from station.atomic_file import open_file, read_from_disk, refused, write_atomic
from station.documents.manifest import PackedSamples
from station.errors import RecordError
from station.records.run_record import PACKED, RunRecord
from station.records.samples.check import ReadBack, check_bytes
from station.records.samples.layout import Layout
from station.records.samples.packed import packed, read_columns, unpacked, unpacked_parts
from station.records.samples.table import AbsentChannelError, Table, table_of


def samples_bytes(run: RunRecord) -> bytes:
    """Return all records as they were recorded, byte for byte; RecordError when they cannot be read."""
    path = run.folder / PACKED if run.is_packed() else run.samples
    try:
        with open_file(path) as file:
            content = file.read()
    except OSError as error:
        raise refused(path, error, "read") from error
    return unpacked(content, run.layout(), path) if run.is_packed() else content


def read_samples(run: RunRecord) -> Table:
    """Return all complete records of a run; RecordError when they cannot be read."""
    return table_of(samples_bytes(run), run.layout())


def check_samples(run: RunRecord, expected: int | None = None) -> ReadBack:
    """Check all records (see `check_bytes`), and packed ones against the SHA-256 of what was recorded; never raises."""
    try:
        return _checked(run, samples_bytes(run), expected)
    except RecordError as error:
        return ReadBack(0, (str(error),))


def checked_samples(run: RunRecord, expected: int | None = None) -> tuple[ReadBack, Table]:
    """Return what checking all records showed, and the records; RecordError when they cannot be read."""
    content = samples_bytes(run)
    return _checked(run, content, expected), table_of(content, run.layout())


def _checked(run: RunRecord, content: bytes, expected: int | None) -> ReadBack:
    kept = run.manifest().samples
    read_back = check_bytes(content, expected, run.layout(), unpacked=kept is not None)
    if kept is None or kept.sha256 == hashlib.sha256(content).hexdigest():
        return read_back
    return ReadBack(read_back.records, (*read_back.problems, f"{PACKED}: holds other records than those recorded"))


def channel_values(run: RunRecord, wanted: Sequence[tuple[str, str]]) -> list[npt.NDArray[Any]]:
    """Return some channels of a run, by group and name, without reading the others.

    Raises:
        RecordError: they cannot be read; AbsentChannelError where the record does not have one of them.

    """
    layout = run.layout()
    channels = {(one.group, one.name): one for one in layout.channels}
    for group, name in wanted:
        if (group, name) not in channels:
            raise AbsentChannelError(group, name)
    if run.is_packed():
        return read_columns(run.folder / PACKED, [channels[one] for one in wanted])
    try:
        with open_file(run.samples) as file:
            rows = np.memmap(file, dtype=layout.dtype, mode="r", shape=(run.records(),))
    except (OSError, ValueError) as error:
        raise RecordError(f"{run.samples}: cannot be read: {error}") from error
    return [np.array((rows if group == "record" else rows[group])[name]) for group, name in wanted]


def pack_samples(run: RunRecord, content: bytes, *, sound: bool) -> PackedSamples | None:
    """Pack the samples beside the raw ones and read them back; return what the manifest has to say of them.

    None is returned, and the samples stay raw, where the disk refuses the packed file or it does not give back the
    recorded bytes: the raw file is as good a record.

    content: the raw samples. sound: False for those that are not what was written; they stay as they are.
    """
    path, layout = run.folder / PACKED, run.layout()
    if not (sound and _written(path, content, layout)):
        run.remove(PACKED)
        return None
    return PackedSamples(file=PACKED, sha256=hashlib.sha256(content).hexdigest(), bytes=len(content))


def _written(path: Path, content: bytes, layout: Layout) -> bool:
    """Write the packed file; return whether it reads back from the disk as the same bytes."""
    at = 0
    try:
        write_atomic(path, packed(table_of(content, layout)))
        for part in unpacked_parts(read_from_disk(path, most=None), layout, path):
            if content[at : at + len(part)] != part:
                return False
            at += len(part)
    except RecordError:
        return False
    return at == len(content)
