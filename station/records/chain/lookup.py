"""Single lines of a chain, found without holding the whole file: it grows for years, and a start is to answer at once.

What counts here is signed by a key that counts in the folder: a line that anybody can write says nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from station.records.chain.blocks import blocks, line_at, lines_with
from station.records.chain.chain_file import CHAIN, RUN_BEGINS, RUN_ENDS, Chain, tail
from station.records.chain.entries import CREATED, REMOVED, SEALED, Entry, entry_of, text_in_line
from station.records.chain.walk import trust_of

FIRST_BYTES = 1 << 18
"""Of the end of a chain, which has the lines of about two hundred runs."""

TIMES_LARGER = 16
_BENCH = re.compile(rb',"bench":"([^"]*)"')
_CLOCK = re.compile(rb',"clock_right":|,"time":"([^"]*)"')
"""No text in a line can hold either: there, quotes are escaped."""


class ChainEnd:
    """The newest entries of a chain by run; as far back as somebody asks for."""

    def __init__(self, data: Path) -> None:
        """Look at the chain of a data folder; RecordError where it is there and cannot be read."""
        self._chain = Chain(data)
        self._size = FIRST_BYTES
        self._whole = False
        self._keys: frozenset[str] | None = None
        self._by_run: dict[str, list[Entry]] = {}
        self._oldest = ""
        self._read()

    @property
    def id(self) -> str:
        """Id of the chain, as `Chain.id`."""
        return self._chain.id

    def runs(self) -> list[str]:
        """Return the runs that were begun at the end of the chain, without those whose records a rule has removed."""
        return [run for run in self._by_run if self.created(run) is not None and self._one(run, REMOVED) is None]

    def created(self, run: str) -> Entry | None:
        """Return the line that begins a run; None where none counts."""
        return self._one(run, CREATED)

    def sealed(self, run: str) -> Entry | None:
        """Return the line that concludes a run; None where none counts."""
        return self._one(run, SEALED)

    def _one(self, run: str, kind: str) -> Entry | None:
        while run not in self._by_run and not self._whole and run < self._oldest:
            self._size *= TIMES_LARGER
            self._read()
        found = (one for one in self._by_run.get(run, ()) if one.kind == kind)
        return next((one for one in found if self._counts(one)), None)

    def _counts(self, entry: Entry) -> bool:
        if self._keys is None:
            self._keys = trust_of(self._chain).keys
        return entry.key in self._keys and entry.signed

    def _read(self) -> None:
        content = tail(self._chain.path, self._size)
        self._whole = not self._chain.there or self._size >= self._chain.path.stat().st_size
        self._by_run, self._oldest = {}, ""
        for line in content.split(b"\n")[:-1]:
            entry = entry_of(line)
            if entry is not None and "run" in entry.fields:
                run = str(entry.fields["run"])
                self._by_run.setdefault(run, []).append(entry)
                if entry.kind == CREATED and not self._oldest:
                    self._oldest = run  # runs are begun in the order of their ids
        if not self._oldest:
            self._oldest = "\U0010ffff"


def entries_of_serial(data: Path, serial: str) -> Iterator[Entry]:
    """Yield the entries of a serial number's runs that count, newest first; RecordError where the chain is unreadable.

    Signatures are verified as they are asked for: a master part has thousands of entries.
    """
    token = b',"serial":' + text_in_line(serial) + b',"attempt":'
    lines = list(lines_with(data / CHAIN, token))
    keys = trust_of(Chain(data)).keys if lines else frozenset()
    for line in reversed(lines):
        entry = entry_of(line)
        if entry is not None and entry.fields.get("serial") == serial and entry.key in keys and entry.signed:
            yield entry


def last_attempt(data: Path, serial: str) -> tuple[int, str]:
    """Return the highest attempt of a serial number that counts, and its run; 0 and '' where there is none.

    RecordError as above.
    """
    begun = (one.fields for one in entries_of_serial(data, serial) if one.kind == CREATED)
    return max(((int(one["attempt"]), str(one["run"])) for one in begun), default=(0, ""))


def entries_of_run(data: Path, run: str) -> list[Entry]:
    """Return the entries of a run, oldest first, that count; RecordError as above."""
    return _counting(data, RUN_BEGINS + text_in_line(run) + RUN_ENDS)


def removals_of_serial(data: Path, serial: str) -> dict[str, Entry]:
    """Return the lines that count by which a rule removed records of a serial number, by run; RecordError as above."""
    found = _counting(data, b',"serial":' + text_in_line(serial) + b',"sha256":')
    return {str(one.fields["run"]): one for one in found if one.kind == REMOVED}


def last_begun_on_each_bench(data: Path) -> dict[str, str]:
    """Return the run that was begun last with each text of a bench file, by its SHA-256; RecordError as above."""
    last: dict[bytes, bytes] = {}
    for block, length in blocks(data / CHAIN):
        places = {found[1]: found.start() for found in _BENCH.finditer(block, 0, length)}
        last |= {sha256: line_at(block, at) for sha256, at in places.items()}
    keys = trust_of(Chain(data)).keys if last else frozenset()
    found = {}
    for sha256, line in last.items():
        entry = entry_of(line)
        if entry is not None and entry.kind == CREATED and _counts(entry, keys):
            found[sha256.decode()] = str(entry.fields["run"])
        elif begun := begun_on_bench(data, sha256.decode()):  # before a line that says nothing
            found[sha256.decode()] = begun[-1]
    return found


def latest_after(data: Path, moment: datetime) -> Entry | None:
    """Return the entry with the latest time that counts, where it is later than a moment; RecordError as above.

    Only entries behind the last one that was written with the word that the clock is right.
    """
    limit, later = moment.astimezone(UTC).isoformat(timespec="milliseconds").encode(), list[bytes]()
    keys: frozenset[str] | None = None
    for block, length in blocks(data / CHAIN):
        for found in _CLOCK.finditer(block, 0, length):
            if found[1] is None and later:
                keys = trust_of(Chain(data)).keys if keys is None else keys
                entry = entry_of(line_at(block, found.start()))
                later = [] if entry is not None and _counts(entry, keys) else later
            elif found[1] is not None and found[1] > limit:
                later.append(line_at(block, found.start()))
    entries = sorted((one for line in later if (one := entry_of(line)) is not None), key=lambda one: one.at)
    keys = trust_of(Chain(data)).keys if entries and keys is None else keys or frozenset()
    return next((one for one in reversed(entries) if one.at > moment and _counts(one, keys)), None)


def begun_on_bench(data: Path, sha256: str) -> list[str]:
    """Return the runs that were begun with a text of a bench file, oldest first; RecordError as above."""
    found = _counting(data, b',"bench":' + text_in_line(sha256))
    return [str(one.fields["run"]) for one in found if one.kind == CREATED]


def _counting(data: Path, token: bytes) -> list[Entry]:
    found = [entry for line in lines_with(data / CHAIN, token) if (entry := entry_of(line)) is not None]
    keys = trust_of(Chain(data)).keys if found else frozenset()
    return [one for one in found if _counts(one, keys)]


def _counts(entry: Entry, keys: frozenset[str]) -> bool:
    return entry.key in keys and entry.signed
