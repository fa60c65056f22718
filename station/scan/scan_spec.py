"""What a process that scans is told: one file with everything that was compiled and checked, read back exactly.

The process reads no recipe, no bench file and no profile. It gets the program as the record holds it, and the bench as
its drivers want it. The SHA-256 of the file stands on its command line, that of the program in the file: what was
changed in between is refused before anything is sent.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

from controller.held_lock import Left
from definitions.plain_data import InexactError, exact, plain
from definitions.program import Program
from drivers.config import WireBenchConfig
from station.atomic_file import document_bytes, open_file
from station.errors import StationError

SpecT = TypeVar("SpecT")
EXIT_REFUSED = 2
"""Exit code of a process that refused its spec or its bench; nothing has moved."""

NEXT_STEP = "Leave the run's folder alone while it starts, then run again."


class SpecError(StationError):
    """A file that a process was started with cannot be read, or is not the one that was written for it."""


class SpecFile(NamedTuple):
    """A spec as it was written."""

    path: Path
    sha256: str


@dataclass(frozen=True)
class Compiled:
    """Program and bench. `alone`: the bench is on its own wires, and has one controller at a time."""

    program: str
    program_sha256: str
    bench: str
    alone: bool
    wires: WireBenchConfig


@dataclass(frozen=True)
class ScanSpec:
    """What the scan process is told.

    ring, report: paths. clock: wall or scan. fast: scan clock without deadlines. supervisor: process id of the
    supervisor. after_end_scans: to go on after the end. left: for a recovery, how the bench was left.
    """

    ring: str
    report: str
    compiled: Compiled
    clock: Literal["wall", "scan"]
    fast: bool
    spin_ns: int
    supervisor: int
    after_end_scans: int
    left: Left | None


@dataclass(frozen=True)
class TimingSpec:
    """What the process is told that measures a machine; periods: how many."""

    ring: str
    report: str
    compiled: Compiled
    spin_ns: int
    periods: int


def write_spec(spec: ScanSpec | TimingSpec, path: Path) -> SpecFile:
    """Write a spec; return its file and what it must still be when it is read."""
    content = json.dumps(plain(spec), ensure_ascii=False, allow_nan=False).encode()
    path.write_bytes(content)
    return SpecFile(path, hashlib.sha256(content).hexdigest())


def told(arguments: list[str], kind: type[SpecT]) -> SpecT:
    """Return the spec that a process was started with: `PROCESS SHA256 SPEC.json`.

    Raises:
        SpecError: the spec cannot be read, is not the one that was written, or is no such spec.

    """
    if len(arguments) != 3:
        raise SpecError(
            f"scan process: found {len(arguments) - 1} arguments; allowed are two: SHA256 SPEC.json. Start runs with "
            "'lostmotion run'"
        )
    return _exact(kind, Path(arguments[2]), arguments[1])


def read_program(compiled: Compiled) -> Program:
    """Return the program of the run as its record holds it.

    Raises:
        SpecError: it cannot be read, or is not the one that was checked.

    """
    return _exact(Program, Path(compiled.program), compiled.program_sha256, unlimited=True)


def _exact(kind: type[SpecT], path: Path, sha256: str, *, unlimited: bool = False) -> SpecT:
    content = _content(path)
    found = hashlib.sha256(content).hexdigest()
    if found != sha256:
        raise SpecError(
            f"file {path} was changed after it was checked: found SHA-256 {found}; allowed is {sha256}. {NEXT_STEP}"
        )
    try:
        data: Any = json.loads(content)
        return exact(kind, data, unlimited=unlimited)
    except InexactError as error:
        texts = "; ".join(error.problems[:3])
        raise SpecError(
            f"file {path} holds no {kind.__name__} of this program version: {texts}. {NEXT_STEP}"
        ) from error
    except ValueError as error:
        raise SpecError(f"file {path} holds no valid JSON: {error}. {NEXT_STEP}") from error


def _content(path: Path) -> bytes:
    try:
        with open_file(path) as file:
            return document_bytes(file)
    except OSError as error:
        raise SpecError(f"file {path} cannot be read: {error.strerror or error}. {NEXT_STEP}") from error
