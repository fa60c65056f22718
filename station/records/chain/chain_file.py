"""The file of a chain, `chain.jsonl` beside the runs: looked into by bytes, and added to by one process at a time.

Lines are only added. One that a power failure has torn is no entry, and no part of the next one. A process that was
killed behind its line leaves the next one only a file to give its name: the line decides.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import ENOSPC
from pathlib import Path
from typing import Any

from station.atomic_file import open_file, refused, seen_text, sync_folder
from station.documents.entries import plain
from station.documents.manifest import ChainPlace
from station.errors import RecordError
from station.records.chain.blocks import lines_in, lines_with
from station.records.chain.entries import CREATED, LOST, REMOVED, START, Entry, entry_of, signed_entry, text_in_line
from station.records.chain.head import Head, chain_seen_in, head_of, heads_of, keep_head
from station.records.chain.keys import FOLDER_KEYS, BenchKey, keys_in, leave_in_folder, own_key
from station.records.chain.old_index import MANIFEST, BeforeChain, before_the_chain
from station.there import is_there
from station.wall_clock import now_text

CHAIN = "chain.jsonl"
"""Name of the file, beside the folders of the runs."""

LOCK = ".lock"
CREATED_MANIFEST = ".run.json.created"
"""The run.json of a run whose first line is being written to the chain."""

TAIL_BYTES = 1 << 16
FIRST_LINES = 4
REMOVED_BEGINS = b'{"kind":"removed",'
RUN_BEGINS, RUN_ENDS = b',"run":', b',"serial":'
"""What stands in a line around its run. No text in a line can hold it: there, quotes are escaped."""


def folder_id(data: Path) -> str:
    """Return what stands for the id of a chain in a data folder that has none."""
    return f"folder:{data.resolve()}"


class Chain:
    """The chain of a data folder, as it is on disk when it is first asked."""

    def __init__(self, data: Path) -> None:
        self.data = data
        self.path = data / CHAIN
        self._content: bytes | None = None
        self._seen = ""
        self._start: Entry | None = None
        self._lines: dict[bytes, list[bytes]] | None = None
        self._entries: dict[str, list[Entry]] = {}

    @property
    def there(self) -> bool:
        """Whether the folder has a chain; one that nobody can look at is there, and cannot be read."""
        return is_there(self.path) is not False

    @property
    def content(self) -> bytes:
        """The whole file, as it was when it was first asked for; nothing where it is not there.

        Raises:
            RecordError: it is there and cannot be read.

        """
        if self._content is None:
            try:
                with open_file(self.path) as file:
                    before = os.fstat(file.fileno())
                    self._content = file.read()
                    # One that grew while it was read is not as it was seen.
                    self._seen = seen_text(before) if len(self._content) == before.st_size else ""
            except FileNotFoundError:
                return b""
            except OSError as error:
                raise refused(self.path, error, "read") from error
        return self._content

    @property
    def seen(self) -> str:
        """What was seen of the file when its content was read, as `seen_text`; '' where that cannot be told."""
        return self._seen if self.content else ""

    def seen_now(self) -> str:
        """Return what is seen of the file now; '' where it is not there."""
        try:
            return seen_text(self.path.stat())
        except OSError:
            return ""

    @property
    def start(self) -> Entry | None:
        """The first entry; None where the file has none, or one that nobody has signed."""
        if self._start is None:
            entries = (entry_of(line) for line in self._first_lines())
            starts = (entry for entry in entries if entry is not None and entry.kind == START)
            self._start = next((entry for entry in starts if entry.signed), None)
        return self._start

    @property
    def id(self) -> str:
        """Id of the chain; where its first entry is gone, of the one that this computer had seen here.

        A folder that never had a chain is named by its path.
        """
        if self.start is not None:
            return str(self.start.fields["chain"])
        return chain_seen_in(self.data) or folder_id(self.data)

    @property
    def before(self) -> BeforeChain | None:
        """What the chain keeps of the runs before it."""
        said = None if self.start is None else self.start.fields["before"]
        if said is None:
            return None
        return BeforeChain(bytes=said["bytes"], sha256=said["sha256"], unconcluded=tuple(said["unconcluded"]))

    def _first_lines(self) -> list[bytes]:
        """Return where the start may stand: behind lines that a power failure has torn, in the first line else."""
        try:
            with open_file(self.path) as file:
                return [file.readline().rstrip(b"\n") for _ in range(FIRST_LINES)]
        except OSError:
            return []

    def entries_of(self, run: str) -> list[Entry]:
        """Return the entries of a run, oldest first, signed or not."""
        if self._lines is None:
            return list(self._with(RUN_BEGINS + text_in_line(run) + RUN_ENDS))
        if run not in self._entries:
            lines = self._lines.get(text_in_line(run), ())
            self._entries[run] = [entry for line in lines if (entry := entry_of(line)) is not None]
        return self._entries[run]

    def removed(self) -> dict[str, Entry]:
        """Return the signed lines by which the records of runs were removed by a rule, by run."""
        lines = (one for one in self._with(REMOVED_BEGINS) if one.kind == REMOVED and one.signed)
        return {str(one.fields["run"]): one for one in lines}

    def take(self, content: bytes) -> None:
        """Take these lines for the whole file."""
        self._content = content

    def index(self) -> None:
        """Note the lines of every run, for who looks at many runs."""
        if self._lines is not None:
            return
        self._lines = {}
        for line in self.content.split(b"\n")[:-1]:
            begin, end = line.find(RUN_BEGINS), line.find(RUN_ENDS)
            if 0 < begin < end:
                self._lines.setdefault(line[begin + len(RUN_BEGINS) : end], []).append(line)

    def runs(self) -> list[str]:
        """Return every run that the chain names, in the order in which they were created."""
        self.index()
        return [text for run in self._lines or {} if (text := _text_of(run)) is not None]

    def last_attempt(self, serial: str) -> int:
        """Return the highest attempt of a serial number among its signed entries; 0 where there is none."""
        token = b',"serial":' + text_in_line(serial) + b',"attempt":'
        created = (entry for entry in self._with(token) if entry.kind == CREATED and entry.signed)
        return max((int(entry.fields["attempt"]) for entry in created), default=0)

    def _with(self, token: bytes) -> Iterator[Entry]:
        # Not by the whole file, unless somebody has asked for it: a server looks at every run that it shows.
        content = self._content
        whole = 0 if content is None else content.rfind(b"\n") + 1
        lines = lines_with(self.path, token) if content is None else lines_in(content, token, whole)
        return (entry for line in lines if (entry := entry_of(line)) is not None)


class ChainWriter:
    """A chain that this process alone adds to, for as long as it holds the folder's lock."""

    def __init__(self, data: Path, key: BenchKey) -> None:
        self._data, self._key = data, key
        self.path = data / CHAIN
        self.last = _last_entry(self.path)
        self.warnings: list[str] = []
        self._pinned: tuple[str, ...] = ()
        self.chain = Chain(data)
        if self.last is None:
            self._begin()
        else:
            self._settle(self.last)
            self._go_on()

    @property
    def next_place(self) -> ChainPlace:
        """Chain, counter and previous hash of the entry that is written next, as run.json keeps them."""
        last = self.last
        assert last is not None  # noqa: S101 - for the type checker: a chain has begun
        return ChainPlace(id=self.chain.id, counter=last.counter + 1, previous=last.sha256)

    @property
    def newest_run(self) -> str:
        """The run that was created last, as far as the end of the file tells it."""
        last = Chain(self._data)
        last.take(tail(self.path))
        return max(last.runs(), default="")

    def append(self, kind: str, **fields: Any) -> Entry:
        """Add one entry and flush it to the disk; return it.

        Raises:
            RecordError: the disk refuses it; what it took of it is taken back.

        """
        counter, previous = (0, "") if self.last is None else (self.last.counter, self.last.sha256)
        counter = max(counter, int(fields["last"]) if kind == LOST else 0) + 1
        entry = signed_entry(kind, counter, previous, now_text(), self._key, **fields)
        try:
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            try:
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
        seen = chain_seen_in(self._data)
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

    def _go_on(self) -> None:
        """Continue a chain; what this computer had seen of it and is gone is said by an entry of its own."""
        assert self.last is not None  # noqa: S101 - for the type checker: the caller has looked
        head = head_of(self.chain.id, self._data)
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
        path = str(self._data.resolve())
        head = Head(self.chain.id, self.last.counter, self.last.sha256, path, self._pinned)
        keep_head(head, self._data, self._key)

    def _settle(self, last: Entry) -> None:
        """Give the run.json of a run its name whose process was killed behind the run's first line."""
        if last.kind == CREATED:
            with suppress(OSError):  # that run cannot be looked at now: it is told by who reads it, and no matter here
                put_created_in_place(self._data / str(last.fields["run"]))


@contextmanager
def writing_to(data: Path) -> Iterator[ChainWriter]:
    """Hold a data folder's lock, and yield its chain to add to.

    Raises:
        RecordError: the folder, the chain or the key of this computer cannot be used.

    """
    key = own_key()
    try:
        handle = os.open(data / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise RecordError(
            f"the data folder cannot be used: {refused(data / LOCK, error)}. Or choose another data folder with --data"
        ) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield ChainWriter(data, key)
    finally:
        os.close(handle)


def put_created_in_place(folder: Path) -> None:
    """Give the run.json of a run that was just created its name; a run that has one already keeps it.

    Raises:
        OSError: nobody can look into the folder, or the disk refuses it.

    """
    with suppress(FileNotFoundError):
        (folder / MANIFEST).stat()
        return
    with suppress(FileNotFoundError):
        (folder / CREATED_MANIFEST).replace(folder / MANIFEST)
        sync_folder(folder)


def _text_of(token: bytes) -> str | None:
    """Return the text that stands in a line; None where a damaged line has none there."""
    try:
        text = json.loads(token)
    except (ValueError, RecursionError):
        return None
    return text if isinstance(text, str) else None


def tail(path: Path, size: int = TAIL_BYTES) -> bytes:
    """Return the whole lines at the end of a file; nothing where there is none."""
    try:
        with open_file(path) as file:
            end = file.seek(0, os.SEEK_END)
            file.seek(max(end - size, 0))
            content = file.read()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise refused(path, error, "read") from error
    return content if end <= size else content.partition(b"\n")[2]


def _last_entry(path: Path) -> Entry | None:
    for size in (TAIL_BYTES, 1 << 62):
        for line in reversed(tail(path, size).split(b"\n")[:-1]):
            entry = entry_of(line)
            if entry is not None:
                return entry
    return None


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
