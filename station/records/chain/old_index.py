"""The index of data folders from before the chain: one unsigned line for each concluded run. It is only read.

`index.jsonl` holds run id, SHA-256 of run.json, verdict and time. A chain that starts behind it keeps its hash.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from station.atomic_file import read_file
from station.errors import RecordError
from station.records.run_folders import is_text, runs_there
from station.there import is_there

INDEX = "index.jsonl"
"""Name of the file, beside the folders of the runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexLine:
    """One line of an index: run, SHA-256 of its run.json, verdict."""

    run: str | None = None
    sha256: str | None = None
    verdict: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BeforeChain:
    """What a chain keeps of the runs that were there before it.

    Size and SHA-256 of the index, and the runs that no line of it names.
    """

    bytes: int
    sha256: str
    unconcluded: tuple[str, ...]


def index_lines(content: bytes, run_id: str) -> list[IndexLine]:
    """Return the lines of an index that name a run."""
    return [line for line in _lines(content) if line.run == run_id]


def before_the_chain(data: Path) -> BeforeChain | None:
    """Return what a chain keeps of the runs that were there before it; None for a folder without any.

    Raises:
        RecordError: the index is there and cannot be read: a chain without it would disown all these runs.

    """
    content = index_content(data)
    named = {line.run for line in _lines(content)}
    there = [name for name in runs_there(data) if is_text(name)]
    if not content and not there:
        return None
    return BeforeChain(
        bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        unconcluded=tuple(name for name in there if name not in named),
    )


def index_kept(data: Path, before: BeforeChain | None) -> bytes | None:
    """Return the index as the chain keeps it; None where it is not that any more, or cannot be read."""
    if before is None:
        return None
    try:
        content = index_content(data)[: before.bytes]
    except RecordError:
        return None
    return content if hashlib.sha256(content).hexdigest() == before.sha256 else None


def runs_in(content: bytes) -> set[str]:
    """Return the runs that an index names."""
    return {line.run for line in _lines(content) if line.run is not None}


def index_content(data: Path) -> bytes:
    """Return the bytes of a folder's index, none where it has none; RecordError where it cannot be read."""
    return b"" if is_there(data / INDEX) is False else read_file(data / INDEX)


def _lines(content: bytes) -> list[IndexLine]:
    found = []
    for text in content.splitlines():
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if isinstance(line, dict):
            texts = {name: value for name, value in line.items() if isinstance(value, str)}
            found.append(IndexLine(run=texts.get("run"), sha256=texts.get("sha256"), verdict=texts.get("verdict")))
    return found
