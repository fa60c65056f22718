"""Which ring belongs to which run: the ring that a run names, and rings of killed runs that nobody needs any more."""

from __future__ import annotations

import os
import struct
import sys
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from station.atomic_file import refused
from station.documents.reading import NEXT_STEP
from station.errors import RecordError
from station.records.process_birth import process_birth
from station.records.ring import ring
from station.records.ring.ring import (
    FILE_PREFIX,
    HEADER_BYTES,
    MAGIC,
    RUN_AT,
    W_GONE_SINCE,
    W_MAGIC,
    W_PID,
    W_READ,
    W_RUN_DEVICE,
    W_WRITTEN,
    WORD_BYTES,
)
from station.records.run_record import MANIFEST, RunRecord
from station.records.seal import is_sealed
from station.there import NOT_THERE
from station.wall_clock import WALL_CLOCK

HEADER = struct.Struct(f"={RUN_AT // 8}Q")
GONE_FOR_S = 3600
"""A folder that is missed may have been moved, and its run needs the records in the ring: they stay for so long."""


class RingHead(NamedTuple):
    """What the header of a ring says: folder of its run ('' where it names none), scan process, records."""

    run: str
    device: int
    pid: int
    written: int
    taken: int
    gone_since: int

    @property
    def waiting(self) -> int:
        """Records that are in the ring alone."""
        return max(self.written - self.taken, 0)


def ring_head(path: Path) -> RingHead | None:
    """Read the header of a ring without touching it; None where no ring can be read."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            content = os.pread(handle, HEADER_BYTES, 0)
        finally:
            os.close(handle)
    except OSError:
        return None
    if len(content) < HEADER_BYTES:
        return None
    words = HEADER.unpack_from(content)
    if words[W_MAGIC] != MAGIC:
        return None
    run = os.fsdecode(content[RUN_AT:].rstrip(b"\0"))
    return RingHead(run, words[W_RUN_DEVICE], words[W_PID], words[W_WRITTEN], words[W_READ], words[W_GONE_SINCE])


def ring_of(run: RunRecord) -> Path | None:
    """Return the file of the ring that a run names; None where it names none, or the ring is gone.

    Raises:
        RecordError: what it names is no ring, or that of another run, or cannot be looked at now.

    """
    name = run.manifest().ring
    if name is None:
        return None
    path, place = Path(name), run.folder / MANIFEST
    if not path.name.startswith(FILE_PREFIX):
        raise RecordError(
            f"{place}: is damaged: entry 'ring': found {name!r}; allowed: the path of a file whose name begins with "
            f"{FILE_PREFIX}. {NEXT_STEP}"
        )
    try:
        path.stat()
    except OSError as error:
        if error.errno in NOT_THERE:
            return None
        raise refused(path, error, "read") from error
    head = ring_head(path)
    if head is not None and head.run and Path(head.run).name != run.id:
        raise RecordError(
            f"{place}: is damaged: entry 'ring': found the record buffer of another run, {Path(head.run).name}. "
            f"{NEXT_STEP}"
        )
    return path


def records_waiting(run: RunRecord) -> int:
    """Return how many records of a run are in its ring alone, without touching either; 0 where that cannot be said."""
    with suppress(RecordError):
        path = ring_of(run)
        head = None if path is None else ring_head(path)
        return 0 if head is None else head.waiting
    return 0


def collect_rings(needed: Collection[str] = ()) -> list[Path]:
    """Remove the rings of killed runs that nobody needs any more; return those that are gone now.

    needed: rings that runs name which may have been moved since; they stay.
    """
    gone = []
    for path in sorted(ring.SHARED_MEMORY.glob(f"{FILE_PREFIX}*")):
        if str(path) not in needed and _left_over(path):
            with suppress(OSError):  # of another user
                path.unlink()
                gone.append(path)
    return gone


def _left_over(path: Path) -> bool:
    """Whether the owners of a ring are dead, and its run was concluded, has no use for it, or is gone."""
    head = ring_head(path)
    if head is None or not head.run or (head.pid and process_birth(head.pid)):
        return False
    run = RunRecord(Path(head.run))
    try:
        manifest = run.manifest()
    except RecordError:
        return _gone(run.folder, head.device) and (not head.waiting or _missed_long_enough(path, head))
    if run.lock.taken():
        return False
    return is_sealed(manifest) or manifest.ring != str(path)


def _missed_long_enough(path: Path, head: RingHead) -> bool:
    """Whether the folder of a ring's run was missed long ago; the first time that it is, that is noted in the ring."""
    now = round(WALL_CLOCK.now().timestamp())
    if 0 < head.gone_since <= now:
        return now - head.gone_since >= GONE_FOR_S
    with suppress(OSError):  # of another user
        handle = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.pwrite(handle, now.to_bytes(WORD_BYTES, sys.byteorder), W_GONE_SINCE * WORD_BYTES)
        finally:
            os.close(handle)
    return False


def _gone(folder: Path, device: int) -> bool:
    """Whether a folder was removed; not where only its disk is not mounted now."""
    place = folder
    while place != place.parent:
        try:
            on = place.stat().st_dev
        except OSError as error:
            if error.errno not in NOT_THERE:
                return False
            place = place.parent
        else:
            return place != folder and on == device
    return False
