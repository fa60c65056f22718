"""The index of a data folder: one line for each concluded run, which vouches for its run.json.

`index.jsonl` holds run id, SHA-256 of run.json, verdict and time. Lines are only added: none is ever changed.
"""

from __future__ import annotations

import fcntl
import json
import os
from contextlib import suppress
from errno import ENOSPC
from pathlib import Path
from typing import Any

from station.durable import refused, sync_folder
from station.record.run_record import RunRecord

INDEX = "index.jsonl"
"""Name of the file, beside the folders of the runs."""


def index_of(record: RunRecord) -> Path:
    """Return the index of the data folder that a run lies in."""
    return record.folder.resolve().parent / INDEX


def has_index(record: RunRecord) -> bool:
    """Whether there is an index beside the run; a run that was copied elsewhere has none to vouch for its run.json."""
    return index_of(record).is_file()


def index_lines(index: Path, run_id: str) -> list[dict[str, Any]] | None:
    """Return the lines of an index that name a run; None when there is no index."""
    try:
        texts = index.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    found = []
    for text in texts:
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if isinstance(line, dict) and line.get("run") == run_id:
            found.append(line)
    return found


def append_line(index: Path, line: dict[str, Any]) -> None:
    """Append one line; runs that end at the same time, a full disk and a power failure cannot tear another one's.

    Raises:
        RecordError: the disk refuses it; what it took of it is taken back.

    """
    try:
        handle = os.open(index, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            _append_to(handle, (json.dumps(line, ensure_ascii=False) + "\n").encode())
        finally:
            os.close(handle)
        sync_folder(index.parent)
    except OSError as error:
        raise refused(index, error) from error


def _append_to(handle: int, line: bytes) -> None:
    size = os.fstat(handle).st_size
    # The end of a line that a power failure has torn is no part of this one.
    torn = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
    whole = b"\n" + line if torn else line
    if os.write(handle, whole) != len(whole):
        with suppress(OSError):  # where lines can only be added, the next one begins behind it
            os.ftruncate(handle, size)
        raise OSError(ENOSPC, os.strerror(ENOSPC))
    os.fsync(handle)
