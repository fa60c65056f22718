"""What is kept of a run whose record a retention rule has removed: its result, its manifest and its loop.

    <data folder>/traces/RUN/     run.json, result.json, recipe.yaml, bench.yaml, and loop.csv of one that was evaluated

The signed line of the removal holds the hash of the whole folder, so that a trace is as good a witness as the record,
of what is in it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from station.atomic_file import read_file, refused, sync_folder, write_atomic
from station.errors import RecordError
from station.records.chain.entries import Entry
from station.records.chain.problems import Problem

FOLDER = "traces"


def keep_trace(data: Path, run: str, files: Mapping[str, bytes]) -> str:
    """Write the trace of a run, and return its hash.

    Raises:
        RecordError: it cannot be written.

    """
    folder = data / FOLDER / run
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            write_atomic(folder / name, content)
        sync_folder(folder)
        sync_folder(folder.parent)
    except OSError as error:
        raise refused(folder, error) from error
    return hash_of(files)


def hash_of(files: Mapping[str, bytes]) -> str:
    """Return one hash for files by name, whatever their order."""
    lines = sorted(f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in files.items())
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def is_as_kept(trace: Path, removed: Entry) -> bool:
    """Whether the folder of a trace is the one that the line of its run's removal names."""
    try:
        now = hash_of({one.name: read_file(one, None) for one in trace.iterdir()})
    except (OSError, RecordError):
        return False
    return now == str(removed.fields["trace"])


def trace_problems(data: Path, removed: Mapping[str, Entry]) -> list[Problem]:
    """Return the traces that are not as they were kept; removed: the lines of the removals, by run."""
    found = []
    for run, line in removed.items():
        if line.fields["trace"] and not is_as_kept(data / FOLDER / run, line):
            found.append(Problem("trace", run, f"{run}: its trace is missing, or not as it was kept"))
    return found
