"""The index of data folders from before the chain: one unsigned line for each concluded run. It is only read.

`index.jsonl` holds run id, SHA-256 of run.json, verdict and time. A chain that starts behind it keeps its hash.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

INDEX = "index.jsonl"
"""Name of the file, beside the folders of the runs."""

MANIFEST = "run.json"


def index_lines(content: bytes, run_id: str) -> list[dict[str, Any]]:
    """Return the lines of an index that name a run."""
    return [line for line in _lines(content) if line.get("run") == run_id]


def before_the_chain(data: Path) -> dict[str, Any] | None:
    """Return what a chain keeps of the runs that were there before it; None for a folder without any.

    `bytes` and `sha256` of the index, and in `unconcluded` the runs that no line of it names.
    """
    content = index_content(data)
    named = {str(line.get("run")) for line in _lines(content)}
    there = sorted(path.parent.name for path in data.glob(f"*/{MANIFEST}"))
    if not content and not there:
        return None
    return {
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
        "unconcluded": [name for name in there if name not in named],
    }


def index_kept(data: Path, before: dict[str, Any] | None) -> bytes | None:
    """Return the index as the chain keeps it; None where it is not that any more."""
    if before is None:
        return None
    content = index_content(data)[: int(before["bytes"])]
    return content if hashlib.sha256(content).hexdigest() == before["sha256"] else None


def runs_in(content: bytes) -> set[str]:
    """Return the runs that an index names."""
    return {str(line.get("run")) for line in _lines(content)}


def index_content(data: Path) -> bytes:
    """Return the bytes of a folder's index; none where it has none."""
    try:
        return (data / INDEX).read_bytes()
    except OSError:
        return b""


def _lines(content: bytes) -> list[dict[str, Any]]:
    found = []
    for text in content.splitlines():
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if isinstance(line, dict):
            found.append(line)
    return found
