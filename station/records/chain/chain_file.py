"""The file of a chain, `chain.jsonl` beside the runs, looked into by bytes.

Lines are only added (`writing`). One that a power failure has torn is no entry, and no part of the next one. A process
that was killed behind its line leaves the next one only a file to give its name: the line decides.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from station.atomic_file import open_file, refused, seen_text, sync_folder
from station.documents.manifest import MANIFEST
from station.records.chain.blocks import lines_bytes, lines_in, lines_with
from station.records.chain.entries import REMOVED, START, Entry, entry_of, text_in_line
from station.records.chain.head import chain_seen_in, counting_keys
from station.records.chain.keys import own_public_key
from station.records.chain.old_index import BeforeChain
from station.there import is_there

CHAIN = "chain.jsonl"
"""Name of the file, beside the folders of the runs."""

CREATED_MANIFEST = ".run.json.created"
"""The run.json of a run whose first line is being written to the chain."""

TAIL_BYTES = 1 << 16
FIRST_LINES = 4
"""Among them stands the first entry, where only power failures have torn lines before it (`walk` names more)."""

START_BEGINS = b'{"kind":"start",'
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
        self._without_start = ""
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
            RecordError: it is there and cannot be read, or is larger than any that is read.

        """
        if self._content is None:
            try:
                with open_file(self.path) as file:
                    lines_bytes(file, self.path)
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
        """The first entry, however many lines of another hand are before it; None where none is there that is signed.

        Anybody can write lines there, and sign them with a key of his own: no run loses its verdict by them. So it is
        the first one of a key that counts, and only where there is none the first of any key.
        """
        if self._start is None:
            self._start = self._of_counting_key(_starts_in(self._first_lines()))
        if self._start is None and self._without_start != (seen := self.seen_now()):
            starts = _starts_in(lines_with(self.path, START_BEGINS))
            self._start = self._of_counting_key(starts) or next(iter(starts), None)
            self._without_start = seen  # who looks at many runs does not look through the whole file for each
        return self._start

    def _of_counting_key(self, starts: Iterable[Entry]) -> Entry | None:
        own = own_public_key()
        return next((one for one in starts if one.key == own or self._counts_by_its_key(one)), None)

    def _counts_by_its_key(self, start: Entry) -> bool:
        known, of_folder = counting_keys(self.data, str(start.fields["chain"]))
        return start.key in known | of_folder

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
        """Return where the start usually stands: behind lines that a power failure has torn, in the first line else."""
        try:
            with open_file(self.path) as file:
                lines_bytes(file, self.path)
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

    def _with(self, token: bytes) -> Iterator[Entry]:
        # Not by the whole file, unless somebody has asked for it: a server looks at every run that it shows.
        content = self._content
        whole = 0 if content is None else content.rfind(b"\n") + 1
        lines = lines_with(self.path, token) if content is None else lines_in(content, token, whole)
        return (entry for line in lines if (entry := entry_of(line)) is not None)


def _starts_in(lines: Iterable[bytes]) -> list[Entry]:
    entries = map(entry_of, lines)
    return [one for one in entries if one is not None and one.kind == START and one.signed]


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
            end = lines_bytes(file, path)
            file.seek(max(end - size, 0))
            content = file.read()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise refused(path, error, "read") from error
    return content if end <= size else content.partition(b"\n")[2]
