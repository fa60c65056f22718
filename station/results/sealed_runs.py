"""Runs that were sealed since a reader's last look at the chain, for whoever tells others of them: each once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from station.atomic_file import open_file
from station.documents.result import Result
from station.errors import StationError
from station.records.chain.blocks import lines_bytes
from station.records.chain.chain_file import CHAIN
from station.records.chain.entries import SEALED, Fields, entry_of, is_torn, object_in
from station.records.run_record import RESULT, RunRecord
from station.records.seal import alterations


def chain_end(data: Path) -> int:
    """Return where the last whole entry of the chain ends, in bytes; StationError where it cannot be read."""
    return _content(data, 0).rfind(b"\n") + 1


def sealed_since(data: Path, offset: int, until: int | None = None) -> tuple[list[Fields], int]:
    """Return the entries that seal a run behind a place in the chain, and the place from which to read on.

    A line that a power failure has torn is passed over, as everywhere: its run is concluded by a line behind it. So is
    one of another hand that is no entry, which `lostmotion verify` names.

    until: a place behind which nothing is read, in bytes; None for the end.

    Raises:
        StationError: the chain cannot be read, or is shorter than it was.

    """
    content = _content(data, offset)[: None if until is None else until - offset]
    found = [(line, entry_of(line)) for line in content.split(b"\n")[:-1]]
    if any(entry is None and object_in(line) is None and not is_torn(line) for line, entry in found):
        raise StationError(
            f"{data / CHAIN}: a line after byte {offset} is damaged. Restore this file from a backup: no results are "
            "sent until then"
        )
    sealed = [entry.fields for _, entry in found if entry is not None and entry.kind == SEALED]
    return sealed, offset + content.rfind(b"\n") + 1


def result_of(data: Path, name: str, *, samples: bool = False) -> tuple[Sequence[str], Result | None]:
    """Return what was altered of a sealed run, and its result where nothing was. samples: not by their size alone."""
    run = RunRecord(data / name)
    try:
        # twice: the first look may fall into the moment in which the sealed run.json gets its name
        altered = alterations(run, samples=samples) and alterations(run, samples=samples)
        return altered, run.read(Result, RESULT) if run.has(RESULT) and not altered else None
    except StationError as error:
        return (str(error),), None


def _content(data: Path, offset: int) -> bytes:
    try:
        with open_file(data / CHAIN) as file:
            if lines_bytes(file, data / CHAIN) < offset:
                raise StationError(
                    f"{data / CHAIN}: this file is shorter than before. Restore it from a backup: no results are sent "
                    "until then"
                )
            file.seek(offset)
            return file.read()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise StationError(f"{data / CHAIN}: cannot be read: {error.strerror}") from error
