"""The whole archive of a data folder held against its note: every object, every run, every byte."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from station.archive.found_again import FULL, line_of_object
from station.archive.full_rows import files_in, opened
from station.archive.place import Place
from station.archive.push import only_one
from station.archive.settings import ArchiveError
from station.archive.trace_rows import digest_of, rows_in
from station.documents.archived import ArchiveLine
from station.documents.manifest import MANIFEST
from station.records.archive_note import Note, add_to_note, read_note
from station.records.chain.chain_file import Chain
from station.records.run_record import RunRecord
from station.records.seal import fingerprint

KINDS = {
    "missing": "Restore the missing archive object from a copy of the archive. Without a copy, delete its line in "
    "archive.jsonl and run 'lostmotion archive push'",
    "changed": "Restore the changed archive object from a copy of the archive. Without a copy, delete the object and "
    "its line in archive.jsonl, then run 'lostmotion archive push'",
    "run": "Run 'lostmotion verify' to see whether the run on this computer is unchanged. Then replace the wrong copy, "
    "here or in the archive, from a backup",
    "elsewhere": "Write the URL of the other archive into archive.yaml, or copy its objects to the archive that "
    "archive.yaml names",
    "strange": "No run in the data folder belongs to this archive object. Move the object out of the archive",
}
"""What can be wrong with an archive, and what a person does about each."""


class ArchiveProblem(NamedTuple):
    """A finding: its kind (a key of `KINDS`), the object, and what was found."""

    kind: str
    object: str
    text: str


@dataclass
class Checked:
    """What was looked at: objects and runs, bytes read, lines that were noted again, and what is wrong."""

    objects: int = 0
    runs: int = 0
    bytes: int = 0
    noted_again: int = 0
    problems: list[ArchiveProblem] = field(default_factory=list)


def verify_archive(data: Path, place: Place, told: Callable[[str], None] = lambda _: None) -> Checked:
    """Read the whole archive of a data folder and compare it; objects that nobody noted are noted again.

    told: hears the name of each object that was read.

    Raises:
        ArchiveError: the archive cannot be reached, or another process is writing to it.
        RecordError: the data folder cannot be read or written.

    """
    done = Checked()
    with only_one(data):
        note, chain = read_note(data), Chain(data)
        there = set(place.names(FULL))
        for line in note.lines:
            if _superseded(note, line):
                continue
            _check_line(data, place, line, there, done)
            told(line.full.name)
        for name in sorted(there - note.objects()):
            try:
                found = line_of_object(data, place, chain, name)
            except ArchiveError as error:
                done.problems.append(ArchiveProblem("strange", name, str(error)))
                continue
            if found is not None:
                add_to_note(data, found)
                done.noted_again += 1
                done.objects += 1
                done.runs += len(found.runs)
                told(name)
    return done


def _superseded(note: Note, line: ArchiveLine) -> bool:
    """Whether every run of a line has a newer address: its object may be gone."""
    return all(note.runs[run.run].line is not line for run in line.runs)


def _check_line(data: Path, place: Place, line: ArchiveLine, there: set[str], done: Checked) -> None:
    if line.url != place.settings.url:
        text = f"{line.full.name}: was written to the archive {line.url}; archive.yaml names {place.settings.url}"
        done.problems.append(ArchiveProblem("elsewhere", line.full.name, text))
        return
    for one in (line.full, line.trace):
        if one is None:
            continue
        done.objects += 1
        done.bytes += one.bytes
        if (one is line.full and one.name not in there) or not place.exists(one.name):
            done.problems.append(ArchiveProblem("missing", one.name, f"{one.name}: is not in the archive"))
        elif place.sha256(one.name) != one.sha256:
            done.problems.append(ArchiveProblem("changed", one.name, _which(place, line, one.name)))
    done.runs += len(line.runs)
    for run in line.runs:
        path = data / run.run / MANIFEST
        if path.is_file() and fingerprint(path).sha256 != run.sha256:
            text = f"run {RunRecord(path.parent).id}: its run.json differs from the copy in {line.full.name}"
            done.problems.append(ArchiveProblem("run", line.full.name, text))


def _which(place: Place, line: ArchiveLine, name: str) -> str:
    """Return which runs of an object with other bytes than were written can still be read as they were."""
    bad = []
    for run in line.runs:
        try:
            with place.opened(name) as stream:
                file = opened(stream, name)
                if line.trace is not None and name == line.trace.name:
                    sound = run.trace is None or digest_of(rows_in(file, run.trace, name)) == run.trace_sha256
                else:
                    found = {one.name: one.sha256 for one in files_in(file, run.group, name)}
                    sound = found.get(MANIFEST) == run.sha256
        except ArchiveError:
            sound = False
        bad += [] if sound else [run.run]
    if not bad:
        return f"archive object {name}: its content has changed; every run in it can still be read unchanged"
    return f"archive object {name}: its content has changed; changed runs: {', '.join(bad)}"
