"""`lostmotion archive`: sealed runs into a plant's archive, back again, compared, and asked in SQL."""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from station.archive.ask import ask
from station.archive.check import KINDS, verify_archive
from station.archive.fetch import fetch
from station.archive.identity import archive_of
from station.archive.place import Place
from station.archive.push import push, waiting
from station.archive.settings import ArchiveSettings, load_settings
from station.cli.say import Grid, say
from station.counted import counted
from station.documents.archived import ArchiveLine
from station.records.archive_note import Note, read_note
from station.records.chain.chain_file import Chain
from station.results.csv_cells import text_cell
from station.store.engine import StoreError
from station.store.rows.archived import bring_up_archived
from station.store.view import opened, warn
from station.there import is_folder

EXIT_PROBLEMS = 1
MOST_SHOWN = 20


def push_runs(data: Path, *, new: bool, as_json: bool) -> int:
    """Put every concluded run that is not in the archive there; return 0, or 1 where some were left out.

    new: a person says that archive.yaml names another archive than before.

    Raises:
        StationError, RecipeError: no settings, or the archive cannot be used; what was noted stays.

    """
    place = Place(load_settings(data))

    def told(line: ArchiveLine) -> None:
        if not as_json:
            size = line.full.bytes + (0 if line.trace is None else line.trace.bytes)
            sys.stdout.write(f"{line.full.name}: runs {len(line.runs)}, {size / 1e6:.1f} MB, read back and compared\n")
            sys.stdout.flush()

    try:
        done = push(data, place, told, new=new)
    finally:
        _into_store(data)
    document = {
        "url": place.settings.url,
        "runs": done.runs,
        "objects": [*done.lines, *done.found],
        "found_again": len(done.found),
        "left_out": done.left_out,
        "note_set_aside": done.set_aside,
    }
    blocks: list[str | Grid] = [f"left out: {one.run}: {one.why}" for one in done.left_out]
    if done.set_aside:
        blocks.append(f"new archive: what was in the one before is kept in {data / done.set_aside}, and counts no more")
    blocks.append(f"{place.settings.url}: runs archived now {done.runs}, left out {len(done.left_out)}")
    say(document, blocks, as_json=as_json)
    return EXIT_PROBLEMS if done.left_out else 0


def _into_store(data: Path) -> None:
    """Bring the store up to the note; a store that cannot be used is told, and changes nothing."""
    try:
        database = opened(data)
        try:
            bring_up_archived(database, Chain(data))
        finally:
            database.close()
    except StoreError as error:
        warn(str(error))


@dataclass(frozen=True)
class ArchiveState:
    """What is known of an archive without reading its runs; waiting: runs of the data folder that are not there."""

    url: str
    runs: int
    objects: int
    bytes: int
    trace_bytes: int
    waiting: int
    only_archived: int


def status(data: Path, *, as_json: bool) -> int:
    """Print what is archived and what waits, by the note of the data folder; return 0.

    Raises:
        StationError, RecipeError: no settings, or the archive is not there or not the one of this data folder.

    """
    settings, note = archive_of(data).settings, read_note(data)
    found = _state(data, settings, note)
    _into_store(data)
    to_push = " (next: 'lostmotion archive push')" if found.waiting else ""
    to_fetch = " (to bring one back: 'lostmotion archive fetch RUN')" if found.only_archived else ""
    blocks = [
        found.url,
        f"runs in the archive           {found.runs}, in {counted(found.objects, 'object')}",
        f"size                          records {_mb(found.bytes)}, traces {_mb(found.trace_bytes)}",
        f"runs not yet in the archive   {found.waiting}{to_push}",
        f"runs only in the archive      {found.only_archived}{to_fetch}",
    ]
    return say(found, blocks, as_json=as_json)


def _mb(size: int) -> str:
    return f"{size / 1e6:.1f} MB"


def _state(data: Path, settings: ArchiveSettings, note: Note) -> ArchiveState:
    traces = [line.trace for line in note.lines if line.trace is not None]
    return ArchiveState(
        url=settings.url,
        runs=len(note.runs),
        objects=len(note.lines) + len(traces),
        bytes=sum(line.full.bytes for line in note.lines),
        trace_bytes=sum(one.bytes for one in traces),
        waiting=len(waiting(data, note)),
        only_archived=sum(is_folder(data / run) is False for run in note.runs),
    )


def verify(data: Path, *, as_json: bool) -> int:
    """Read the whole archive and compare it; return 0, or 1 where something is wrong.

    Raises:
        StationError, RecipeError: no settings, or the archive cannot be used.

    """
    place = archive_of(data)
    found = verify_archive(data, place)
    _into_store(data)
    there = f"{counted(found.runs, 'run')} in {counted(found.objects, 'object')}"
    blocks: list[str | Grid] = [f"{place.settings.url}: {there}, {found.bytes / 1e6:.1f} MB read"]
    blocks += [f"noted again: {counted(found.noted_again, 'object')}"] if found.noted_again else []
    for kind, action in KINDS.items():
        texts = [one.text for one in found.problems if one.kind == kind]
        blocks += [f"  {text}" for text in texts[:MOST_SHOWN]]
        blocks += [f"  ... and {len(texts) - MOST_SHOWN} more of this kind"] if len(texts) > MOST_SHOWN else []
        blocks += [f"    {action}"] if texts else []
    blocks.append("passed" if not found.problems else f"NOT PASSED: {counted(len(found.problems), 'problem')}")
    problems = [one._asdict() | {"next_action": KINDS[one.kind]} for one in found.problems]
    counts = {name: getattr(found, name) for name in ("objects", "runs", "bytes", "noted_again")}
    say({"url": place.settings.url, **counts, "problems": problems}, blocks, as_json=as_json)
    return EXIT_PROBLEMS if found.problems else 0


def fetch_run(data: Path, name: str, *, as_json: bool) -> int:
    """Bring a run back into the data folder; return 0.

    Raises:
        StationError, RecipeError: no settings, no such run, or its copy is not as it was sealed.

    """
    run = fetch(data, archive_of(data), name)
    return say(
        {"run": run.id, "record": str(run.folder)}, [f"{run.id}: is in {data} again, unchanged"], as_json=as_json
    )


def ask_archive(data: Path, sql: str, most: int, *, as_csv: bool, as_json: bool) -> int:
    """Print the answer to a question in SQL; return 0.

    Raises:
        StationError, RecipeError: no settings, or the question cannot be answered.

    """
    found = ask(archive_of(data), sql, most)
    if as_csv:
        writer = csv.writer(sys.stdout, lineterminator="\n")
        writer.writerow(found.columns)
        writer.writerows([_cell(one) for one in row] for row in found.rows)
        return 0
    rows: list[Sequence[str]] = [["" if one is None else str(one) for one in row] for row in found.rows]
    blocks: list[str | Grid] = [Grid(found.columns, rows)]
    blocks.append(f"{counted(len(rows), 'row')}{', and more: raise --most' if found.more else ''}")
    plain_rows = [
        [one if isinstance(one, bool | int | float | None) else str(one) for one in row] for row in found.rows
    ]
    return say({"columns": found.columns, "rows": plain_rows, "more": found.more}, blocks, as_json=as_json)


def _cell(value: object) -> object:
    return value if isinstance(value, int | float) else text_cell(value)
