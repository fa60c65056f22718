"""Where archived runs are: a line of `archive.jsonl` for each pair of objects, and what of a trace is no channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.documents.entries import Count
from station.documents.exported import Counts
from station.documents.manifest import Large, Moment, Name, Period


@dataclass(frozen=True, slots=True, kw_only=True)
class ArchiveId:
    """The marker of an archive, by which it is known: an id of its own, and when it was made."""

    id: Name
    made: Moment


@dataclass(frozen=True, slots=True, kw_only=True)
class ArchiveObject:
    """An object of the archive: its name below the archive's URL, SHA-256 and size of its bytes."""

    name: Name
    sha256: str
    bytes: Large


@dataclass(frozen=True, slots=True, kw_only=True)
class ArchivedRun:
    """A run in a pair of objects: SHA-256 of its run.json, and its row groups.

    `trace` is None for a run that has no complete trace; `trace_sha256` is that of its channels and facts.
    """

    run: Name
    sha256: str
    group: Count
    trace: Count | None = None
    trace_sha256: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ArchiveLine:
    """A line of the note: whole records in `full`, channels in `trace` (None: no run of them has a trace).

    It is written after both objects were read back from the archive and compared.
    """

    url: Name
    verified: Moment
    full: ArchiveObject
    trace: ArchiveObject | None = None
    runs: tuple[ArchivedRun, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceFacts:
    """What an evaluation asks of a run beside its channels.

    `objections` speak against the record; `segments`: role, direction and cycle by number.
    """

    run: Name
    sha256: str
    recipe: str
    bench: str
    day: str
    period_ns: Period
    counts: Counts
    objections: tuple[str, ...] = ()
    segments: Mapping[str, tuple[str, int, int]]
