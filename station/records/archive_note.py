"""The note of a data folder on its archive, `archive.jsonl`: where each archived run is.

A line is added for each pair of objects after both were read back from the archive. A line that was torn is no line.
Nothing rests on the note: who removes a record compares the archive's bytes first, and `lostmotion archive verify`
makes a lost note again.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from station.atomic_file import append_line
from station.documents.archived import ArchivedRun, ArchiveLine
from station.documents.entries import plain
from station.documents.reading import whole_lines
from station.errors import RecordError
from station.there import is_folder

NOTE = "archive.jsonl"
SETTINGS = "archive.yaml"


@dataclass(frozen=True)
class Address:
    """Where a run is in the archive."""

    line: ArchiveLine
    run: ArchivedRun


@dataclass(frozen=True)
class Note:
    """What the note says: its lines, and the newest address of each run."""

    lines: tuple[ArchiveLine, ...] = ()
    runs: dict[str, Address] = field(default_factory=dict)

    def objects(self) -> set[str]:
        """Return the names of all objects of whole records."""
        return {line.full.name for line in self.lines}


def read_note(data: Path) -> Note:
    """Return the note of a data folder; an empty one where nothing was archived.

    Raises:
        RecordError: it cannot be read.

    """
    lines = tuple(whole_lines(ArchiveLine, data / NOTE))
    return Note(lines, {run.run: Address(line, run) for line in lines for run in line.runs})


def add_to_note(data: Path, line: ArchiveLine) -> None:
    """Add a line durably; a torn line before it stays one of its own.

    Raises:
        RecordError: the file cannot be written.

    """
    append_line(data / NOTE, json.dumps(plain(line), ensure_ascii=False, separators=(",", ":")).encode())


def only_archived(data: Path, name: str) -> list[str]:
    """Return the runs whose id contains this text that are in the archive and not in the data folder."""
    try:
        note = read_note(data)
    except RecordError:
        return []
    return sorted(run for run in note.runs if name in run and is_folder(data / run) is False)
