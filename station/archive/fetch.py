"""Out of the archive: the record of a run as the folder that it was, compared with its hashes and with the chain."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.archive.full_rows import REPLACE, ArchivedFile, files_in, opened, run_in
from station.archive.place import Place
from station.archive.settings import ArchiveError
from station.atomic_file import refused, sync_folder
from station.documents.manifest import MANIFEST
from station.records.archive_note import Address, read_note
from station.records.chain.chain_file import Chain
from station.records.run_record import RunRecord
from station.records.seal import alterations, fingerprint, sealed_names

FETCHING = ".fetching"
"""Folder beside the runs in which a record is made whole before it gets its name."""


def fetch(data: Path, place: Place, name: str) -> RunRecord:
    """Bring the record of a run back into its data folder, the same bytes.

    name: of the run, or part of it.

    Raises:
        ArchiveError: it is not archived, is here already, or its copy is not as it was archived.
        RecordError: the folder cannot be written.

    """
    address = address_of(data, name)
    run, target = address.run.run, data / address.run.run
    if target.exists():
        raise ArchiveError(f"run {run} is already in the data folder {data}. Nothing was fetched")
    part = data / FETCHING / run
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        _write(part, archived_files(place, address))
        altered = alterations(RunRecord(part), chain=Chain(data))
        if altered:
            raise ArchiveError(
                f"run {run}: its copy in the archive was changed: {altered[0]}. Nothing was fetched. "
                "Restore the archive from a copy"
            )
        part.replace(target)
        sync_folder(data)
        (data / FETCHING).rmdir()
    except OSError as error:
        raise refused(target, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return RunRecord(target)


def address_of(data: Path, name: str) -> Address:
    """Return where a run is in the archive, by its id or part of it; ArchiveError for none, or several."""
    runs = read_note(data).runs
    fitting = [name] if name in runs else sorted(run for run in runs if name in run)
    if len(fitting) == 1:
        return runs[fitting[0]]
    if not fitting:
        raise ArchiveError(f"{name}: the archive of {data} has no such run. See 'lostmotion archive status'")
    raise ArchiveError(
        f"{name}: the ids of {len(fitting)} archived runs contain this: {', '.join(fitting[:8])}. "
        "Give more characters of the run id"
    )


def archived_files(place: Place, address: Address) -> list[ArchivedFile]:
    """Return the files of a run from the archive, compared with their hashes and the one that was noted.

    Raises:
        ArchiveError: the object is gone or damaged, or holds another run.

    """
    name = address.line.full.name
    with place.opened(name) as stream:
        files = files_in(opened(stream, name), address.run.group, name)
    if next((one.sha256 for one in files if one.name == MANIFEST), "") != address.run.sha256:
        raise ArchiveError(
            f"archive object {name}: row group {address.run.group} does not contain run {address.run.run}. {REPLACE}"
        )
    return files


def why_not_archived(data: Path, place: Place, run: RunRecord) -> str:
    """Return why the archive cannot stand in for a record; '' where its copy has every byte that is sealed.

    The copy is read from the archive now, whatever was noted of it.
    """
    address = read_note(data).runs.get(run.id)
    if address is None:
        return "the run is not in the archive. Run 'lostmotion archive push'"
    if address.line.url != place.settings.url:
        return f"the run is in another archive: {address.line.url}"
    try:
        copied = {one.name: one.sha256 for one in archived_files(place, address)}
    except ArchiveError as error:
        return str(error)
    for name in (MANIFEST, *sealed_names(run)):
        if copied.get(name) != fingerprint(run.folder / name).sha256:
            return f"the file {name} of the run differs from its copy in the archive"
    return ""


@contextmanager
def folder_of(place: Place, name: str, group: int, run: str) -> Iterator[Path]:
    """Yield the record of a run in a folder that is there for a moment; ArchiveError as `archived_files`."""
    with tempfile.TemporaryDirectory(prefix="lostmotion-run-") as scratch:
        folder = Path(scratch) / run
        with place.opened(name) as stream:
            file = opened(stream, name)
            files, there = files_in(file, group, name), run_in(file, group)
        if there != run:
            raise ArchiveError(
                f"archive object {name}: row group {group} contains run {there}, expected {run}. {REPLACE}"
            )
        _write(folder, files, flush=False)
        yield folder


def _write(folder: Path, files: list[ArchivedFile], *, flush: bool = True) -> None:
    """Write files into a folder, and flush all of them with their folders."""
    for one in files:
        path = folder / one.name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            file.write(one.content)
            file.flush()
            if flush:
                os.fsync(file.fileno())
    if flush:
        for inner in {(folder / one.name).parent for one in files}:
            sync_folder(inner)
