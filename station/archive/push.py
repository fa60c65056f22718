"""Into the archive: concluded runs that are not there yet, an object for each bench and hour, read back and compared.

The order is what makes it safe to be killed: the object is made beside, put under a temporary name, put in place, read
back and compared; then its line is noted. An object that is in place and not noted, because its writer was killed, is
looked at first by the next one: it is read, compared, and noted as it is. So nothing is lost and no run is there twice.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from station.archive.found_again import FULL, line_of_object, trace_name, traced_run, with_groups
from station.archive.full_rows import files_in, full_writer, opened, rows_of_run
from station.archive.identity import claim, still
from station.archive.place import Place
from station.archive.settings import ArchiveError
from station.archive.trace_rows import digest_of, rows_in, trace_writer
from station.documents.archived import ArchivedRun, ArchiveLine
from station.documents.manifest import Manifest
from station.errors import RecordError, StationError
from station.records.archive_note import Note, add_to_note, read_note
from station.records.chain.chain_file import Chain
from station.records.run_folders import is_run
from station.records.run_record import RunRecord
from station.records.seal import alterations, fingerprint, is_sealed
from station.wall_clock import now_text

LOCK = "archive.lock"
MAKING = ".archiving-"
"""How the folder begins, beside the runs, in which objects are made."""

NAME_DIGITS = 32
"""Hexadecimal digits of the SHA-256 by which an object is named."""


class LeftOut(NamedTuple):
    """A run that was not archived, and why."""

    run: str
    why: str


@dataclass
class Pushed:
    """What a push did: objects written, objects found that nobody had noted, runs in both, and runs left out."""

    lines: list[ArchiveLine] = field(default_factory=list)
    found: list[ArchiveLine] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    set_aside: str = ""
    """Name of the note of the archive before a new one."""

    @property
    def runs(self) -> int:
        """Runs that are in the archive since."""
        return sum(len(line.runs) for line in (*self.lines, *self.found))


Told = Callable[[ArchiveLine], None]


def push(data: Path, place: Place, told: Told = lambda _: None, *, new: bool = False) -> Pushed:
    """Put every concluded run that is not in the archive there.

    told: hears of each pair of objects when it is noted. new: a person says that the place is another archive than
    before.

    Raises:
        ArchiveError: the archive cannot be used, is not the one of this data folder, or another push is on; what was
            noted stays.
        RecordError: the data folder cannot be read or written.

    """
    done = Pushed()
    with only_one(data):
        claimed, done.set_aside = claim(data, place, new=new)
        chain, note = Chain(data), read_note(data)
        place.remove_incoming(chain.id)
        for left_behind in data.glob(f"{MAKING}*"):
            shutil.rmtree(left_behind, ignore_errors=True)
        ready = dict(_ready(data, chain, note, done.left_out))
        for folder, runs in _by_hour(ready).items():
            found = _found_again(data, place, chain, note, folder)
            for line in found:
                still(data, place, claimed)
                _note(data, line, done.found, told)
            there = {one.run for line in found for one in line.runs}
            left = [run for run in runs if run not in there]
            for begin in range(0, len(left), place.settings.runs_per_object):
                several = [RunRecord(data / run) for run in left[begin : begin + place.settings.runs_per_object]]
                line = _written(data, place, chain, folder, several)
                still(data, place, claimed)
                _note(data, line, done.lines, told)
    return done


def _note(data: Path, line: ArchiveLine, lines: list[ArchiveLine], told: Told) -> None:
    add_to_note(data, line)
    lines.append(line)
    told(line)


@contextmanager
def only_one(data: Path) -> Iterator[None]:
    """Be the only one who writes to the archive of a data folder; ArchiveError where another one is."""
    try:
        handle = os.open(data / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise RecordError(
            f"{data / LOCK}: cannot be written: {error.strerror}. Give this user write permission"
        ) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ArchiveError(
                f"{data}: another process is writing to the archive of this data folder. Wait for its end"
            ) from None
        yield
    finally:
        os.close(handle)


def waiting(data: Path, note: Note) -> list[str]:
    """Return the runs of a data folder that are not in the archive yet, by their folders alone."""
    with os.scandir(data) as there:
        names = sorted(one.name for one in there if "Z-" in one.name)
    return [name for name in names if name not in note.runs and is_run(data / name)]


def _ready(data: Path, chain: Chain, note: Note, left_out: list[LeftOut]) -> Iterator[tuple[str, Manifest]]:
    """Yield the runs to archive; one that is not as it was sealed is left out, one that is not concluded waits."""
    for name in waiting(data, note):
        run = RunRecord(data / name)
        try:
            manifest = run.manifest()
            if not is_sealed(manifest):
                continue
            altered = alterations(run, chain=chain)
        except StationError as error:
            altered = (str(error),)
        if altered:
            left_out.append(LeftOut(name, f"has changed since it was sealed: {altered[0]}. Restore it from a backup"))
        else:
            yield name, manifest


def _by_hour(ready: dict[str, Manifest]) -> dict[str, list[str]]:
    """Return the runs by the folder of their objects below `full` and `trace`: bench, and hour of the start in UTC."""
    found: dict[str, list[str]] = {}
    for run, manifest in sorted(ready.items()):
        bench = re.sub(r"[^A-Za-z0-9._-]", "_", manifest.bench.name)
        hour = datetime.fromisoformat(manifest.started).astimezone(UTC).strftime("%Y-%m-%dT%H")
        found.setdefault(f"bench={bench}/{hour}", []).append(run)
    return found


def _found_again(data: Path, place: Place, chain: Chain, note: Note, folder: str) -> list[ArchiveLine]:
    """Return the objects of a folder that are in place and not noted, each compared byte for byte."""
    known = note.objects()
    new = [name for name in place.names(f"{FULL}/{folder}") if name not in known]
    return [line for name in new if (line := line_of_object(data, place, chain, name)) is not None]


def _written(data: Path, place: Place, chain: Chain, folder: str, runs: Sequence[RunRecord]) -> ArchiveLine:
    """Write runs into a pair of objects, read both back, and return their line."""
    with tempfile.TemporaryDirectory(prefix=MAKING, dir=data) as scratch:
        full_path, trace_path = Path(scratch) / "full.parquet", Path(scratch) / "trace.parquet"
        found: list[ArchivedRun] = []
        with full_writer(full_path, chain.id) as full, trace_writer(trace_path, chain.id) as trace:
            for group, run in enumerate(runs):
                full.write_table(rows_of_run(run))
                found.append(traced_run(run, group, trace))
        archived = with_groups(found)
        _compare(full_path, trace_path, archived, runs)
        name = f"{FULL}/{folder}/part-{fingerprint(full_path).sha256[:NAME_DIGITS]}.parquet"
        whole = place.keep(full_path, name, chain.id)
        traced = any(one.trace is not None for one in archived)
        channels = place.keep(trace_path, trace_name(name), chain.id) if traced else None
    return ArchiveLine(url=place.settings.url, verified=now_text(), full=whole, trace=channels, runs=tuple(archived))


def _compare(full_path: Path, trace_path: Path, runs: Sequence[ArchivedRun], folders: Sequence[RunRecord]) -> None:
    """Read both files back from the disk and compare every file with the record, and every trace with its digest."""
    with full_path.open("rb") as stream:
        file = opened(stream, str(full_path))
        for one, run in zip(runs, folders, strict=True):
            for there in files_in(file, one.group, str(full_path)):
                if there.sha256 != fingerprint(run.folder / there.name).sha256:
                    raise ArchiveError(
                        f"run {run.id}: its file {there.name} was changed while it was archived. Run the command again"
                    )
    with trace_path.open("rb") as stream:
        file = opened(stream, str(trace_path))
        for one in runs:
            if one.trace is not None and digest_of(rows_in(file, one.trace, str(trace_path))) != one.trace_sha256:
                raise ArchiveError(
                    f"run {one.run}: its trace (torque and angle) reads back differently from what was written. "
                    "Check the disk"
                )
