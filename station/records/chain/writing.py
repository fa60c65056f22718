"""Adding to a chain: by one process at a time, behind the last line that counts.

What counts is a line that a key has signed which this computer trusts. One of another key counts where it follows such
a line as the next one must, as that of a second bench does which nobody has trusted yet: it gives no other number than
the next. Any other line is passed over, as if it were not there: anybody can write it, and `verify` names it.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from errno import ENOSPC
from pathlib import Path
from typing import Any

from definitions.number_formats import LARGEST_COUNT
from station.atomic_file import refused, sync_folder
from station.documents.entries import plain
from station.documents.manifest import MANIFEST, ChainPlace
from station.errors import RecordError
from station.records.chain.blocks import LARGEST_LINES, ROOM_TO_CONCLUDE, refuse_larger
from station.records.chain.chain_file import CHAIN, CREATED_MANIFEST, TAIL_BYTES, Chain, put_created_in_place, tail
from station.records.chain.entries import CREATED, LOST, SEALED, START, Entry, entry_of, signed_entry
from station.records.chain.folder_lock import held
from station.records.chain.head import Head, chain_seen_in, head_of, heads_of, keep_head
from station.records.chain.keys import FOLDER_KEYS, BenchKey, keys_in, leave_in_folder, own_key
from station.records.chain.missing import chain_named_in
from station.records.chain.old_index import before_the_chain
from station.records.chain.walk import follows, trust_of
from station.there import is_there
from station.wall_clock import now_text

CONCLUDES = (SEALED, LOST)
"""Kinds of entries that may take the room at the end of the file: without them a run that was begun has no end."""


class ChainWriter:
    """A chain that this process alone adds to, for as long as it holds the folder's lock."""

    def __init__(self, data: Path, key: BenchKey) -> None:
        self._data, self._key = data, key
        self._place = str(data.resolve())
        self.path = data / CHAIN
        self.chain = Chain(data)
        self.trusted = trust_of(self.chain).keys
        """Keys whose entries count in it."""
        head = head_of(self.chain.id, data)
        self.last = _last_entry(self.path, self.trusted, head)
        self.warnings: list[str] = []
        self._pinned: tuple[str, ...] = ()
        if self.last is None:
            self._begin()
        else:
            self._settle(self.last)
            self._go_on(head)

    @property
    def next_place(self) -> ChainPlace:
        """Chain, counter and previous hash of the entry that is written next, as run.json keeps them.

        Raises:
            RecordError: the counter has come to its end.

        """
        last = self.last
        assert last is not None  # noqa: S101 - for the type checker: a chain has begun
        return ChainPlace(id=self.chain.id, counter=self._counter_behind(last.counter), previous=last.sha256)

    @property
    def newest_run(self) -> str:
        """The run that was created last, as far as the end of the file tells it."""
        entries = (entry_of(line) for line in tail(self.path).split(b"\n"))
        begun = {str(one.fields["run"]): one for one in entries if one is not None and one.kind == CREATED}
        newest_first = (begun[run] for run in sorted(begun, reverse=True))
        return next((str(one.fields["run"]) for one in newest_first if self._counts(one)), "")

    def _counts(self, entry: Entry) -> bool:
        return entry.key in self.trusted and entry.signed

    def _counter_behind(self, last: int) -> int:
        if last >= LARGEST_COUNT:
            raise RecordError(
                f"{self.path}: has {last} entries; allowed are at most {LARGEST_COUNT}. Choose a new data folder with "
                "--data"
            )
        return last + 1

    def append(self, kind: str, **fields: Any) -> Entry:
        """Add one entry and flush it to the disk; return it.

        Raises:
            RecordError: the disk refuses it, and what it took of it is taken back; or the counter or the file has come
                to its end, which for all but `CONCLUDES` is before the room for these.

        """
        counter, previous = (0, "") if self.last is None else (self.last.counter, self.last.sha256)
        counter = self._counter_behind(max(counter, int(fields["last"]) if kind == LOST else 0))
        entry = signed_entry(kind, counter, previous, now_text(), self._key, **fields)
        try:
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            try:
                most = LARGEST_LINES if kind in CONCLUDES else LARGEST_LINES - ROOM_TO_CONCLUDE
                refuse_larger(os.fstat(handle).st_size + len(entry.line) + len(b"\n\n"), self.path, most)
                _append_to(handle, entry.line + b"\n")
            finally:
                os.close(handle)
            if self.last is None:
                sync_folder(self._data)
        except OSError as error:
            raise refused(self.path, error) from error
        self.last = entry
        self._keep_head()
        return entry

    def _begin(self) -> None:
        seen = chain_seen_in(self._data) or chain_named_in(self._data)  # of a folder that was moved, its runs tell
        head = None if seen is None else head_of(seen, self._data)
        replaces = None if head is None else {"chain": head.chain, "counter": head.counter, "sha256": head.sha256}
        self._pinned = (self._key.public,)
        leave_in_folder(self._data, self._key.public)
        before = plain(before_the_chain(self._data))
        self.append(START, chain=secrets.token_hex(16), before=before, replaces=replaces)
        if head is not None:
            self.warnings.append(
                f"{self.path}: was not there, but this computer had seen {head.counter} entries of a chain in this "
                "folder. A new chain is begun, and says so. Put the old folder back if nobody removed it on purpose"
            )

    def _go_on(self, head: Head | None) -> None:
        """Continue a chain; what this computer had seen of it, head, and is gone is said by an entry of its own."""
        assert self.last is not None  # noqa: S101 - for the type checker: the caller has looked
        pinned = [key for one in heads_of(self.chain.id) for key in one.keys]
        known = pinned or keys_in(self._data / FOLDER_KEYS)
        self._pinned = tuple(dict.fromkeys((*known, self._key.public)))
        if self._key.public not in keys_in(self._data / FOLDER_KEYS):
            leave_in_folder(self._data, self._key.public)
        if head is None or head.counter < self.last.counter:
            return
        if (head.counter, head.sha256) != (self.last.counter, self.last.sha256):
            first = min(self.last.counter + 1, head.counter)
            self.append(LOST, first=first, last=head.counter, sha256=head.sha256)
            self.warnings.append(
                f"{self.path}: entries {first} to {head.counter}, which this computer had seen, are gone. "
                "See 'lostmotion verify'"
            )

    def _keep_head(self) -> None:
        assert self.last is not None  # noqa: S101 - as above: it was just written
        head = Head(self.chain.id, self.last.counter, self.last.sha256, self._place, self._pinned)
        keep_head(head, self._key)

    def _settle(self, last: Entry) -> None:
        """Give the run.json of a run its name whose process was killed behind the run's first line."""
        if last.kind == CREATED:
            with suppress(OSError):  # that run cannot be looked at now: it is told by who reads it, and no matter here
                put_created_in_place(self._data / str(last.fields["run"]))


@contextmanager
def writing_to(data: Path) -> Iterator[ChainWriter]:
    """Hold a data folder's lock, and yield its chain to add to.

    Raises:
        RecordError: the folder, its lock, the chain or the key of this computer cannot be used.

    """
    key = own_key()
    with held(data):
        yield ChainWriter(data, key)


def settle_killed(data: Path) -> None:
    """Give the run.json of a run its name whose process was killed behind the run's first line, as the next run does.

    Raises:
        RecordError: the folder or its lock cannot be used.

    """
    chain, folder = Chain(data), None
    with suppress(RecordError):  # a chain that nobody can go on with settles nothing
        last = _last_entry(chain.path, trust_of(chain).keys, head_of(chain.id, data)) if chain.there else None
        folder = None if last is None or last.kind != CREATED else data / str(last.fields["run"])
    if folder is None or is_there(folder / MANIFEST) is not False or is_there(folder / CREATED_MANIFEST) is False:
        return
    with held(data):  # whoever is just beginning it gives it its name himself
        try:
            put_created_in_place(folder)
        except OSError as error:
            raise refused(folder / MANIFEST, error) from error


def _last_entry(path: Path, trusted: frozenset[str], head: Head | None) -> Entry | None:
    """Return the last entry that counts; None where the file has none of any kind.

    Where the file has the entry that this computer wrote last, only what follows that counts: a line from further up,
    or of another folder that the same key signed, was put there.

    Raises:
        RecordError: it has entries, and none that counts.

    """
    behind: list[Entry] = []
    for size in (TAIL_BYTES, 1 << 62):
        behind, newest = [], None
        for line in reversed(tail(path, size).split(b"\n")[:-1]):
            entry = entry_of(line)
            if entry is None:
                continue
            if entry.key in trusted and entry.signed:
                if head is None or (entry.counter, entry.sha256) == (head.counter, head.sha256):
                    return _end_of_row(entry, reversed(behind), trusted)
                newest = newest or (entry, tuple(reversed(behind)))
            behind.append(entry)
    if newest is not None:  # what this computer wrote last is not there any more
        return _end_of_row(*newest, trusted)
    if behind:
        raise RecordError(
            f"{path}: no line is signed by a key that this computer trusts. Restore this file and {FOLDER_KEYS} from a "
            "backup, trust the key of the bench that signed with 'lostmotion key --trust KEY', or choose another data "
            "folder with --data"
        )
    return None


def _end_of_row(last: Entry, behind: Iterable[Entry], trusted: frozenset[str]) -> Entry:
    for entry in behind:
        if (entry.kind != LOST or entry.key in trusted) and follows(entry, last) and entry.signed:
            last = entry
    return last


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
