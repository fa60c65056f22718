"""The program of a run as it is stored in program.json: written, read with what older versions left out, compared.

A field that program.json lacks was unknown to the version that wrote it. What it meant then stands in `MEANT`; a field
that is not there has no meaning of its own, and who needs it is told so.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, TypeVar

from pydantic import Field

from definitions.plain_data import plain
from definitions.program import Program
from station.documents.entries import Number, Plain
from station.errors import RecordError
from station.records.run_record import RunRecord

PROGRAM = "program.json"

Entry = TypeVar("Entry")

MEANT: Mapping[str, bool] = MappingProxyType({"loading_input": True})
"""Field of a program, by its path without indices, and what a program meant that was written before there was one.

loading_input: the first benches had the servo at the input shaft.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentRow:
    """What the analysis needs of a segment."""

    index: int
    role: str
    direction: int
    cycle: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramEntries:
    """Entries of program.json that are read from it; None where the version that wrote it did not know one."""

    period_s: Annotated[Number, Field(gt=0.0, allow_inf_nan=False, description="a period above 0 s")] | None = None
    has_torque_out: bool | None = None
    release_torque_nm: Annotated[Number, Field(allow_inf_nan=False, description="a torque in N·m")] | None = None
    loading_input: bool = MEANT["loading_input"]
    segments: tuple[SegmentRow, ...] | None = None


class StoredProgram:
    """The program of a run as it was written; RecordError for an entry that the version did not know."""

    def __init__(self, entries: ProgramEntries, place: Path) -> None:
        self._entries, self._place = entries, place

    @classmethod
    def of(cls, run: RunRecord) -> StoredProgram:
        """Return the program of a run; RecordError when it cannot be read or an entry is not what it may be."""
        return cls(run.read(ProgramEntries, PROGRAM), run.folder / PROGRAM)

    def _known(self, name: str, value: Entry | None) -> Entry:
        if value is None:
            raise RecordError(
                f"{self._place}: the entry '{name}' is missing: an older version wrote this file, or it is damaged. "
                "Restore the file from a backup"
            )
        return value

    @property
    def period_s(self) -> float:
        """Scan period."""
        return self._known("period_s", self._entries.period_s)

    @property
    def has_torque_out(self) -> bool:
        """Whether there is a torque sensor at the output."""
        return self._known("has_torque_out", self._entries.has_torque_out)

    @property
    def release_torque_nm(self) -> float:
        """Largest torque at which the lock may open."""
        return self._known("release_torque_nm", self._entries.release_torque_nm)

    @property
    def loading_input(self) -> bool:
        """Whether the torque is applied at the input shaft, with the output locked."""
        return self._entries.loading_input

    @property
    def segments(self) -> Sequence[SegmentRow]:
        """The segment table."""
        return self._known("segments", self._entries.segments)


def plain_program(program: Program) -> Plain:
    """Return a program as plain data; infinities are None: JSON has no other way to say that there is no limit."""
    entries: Plain = plain(program)
    return entries


def program_differences(recorded: Any, program: Program) -> list[str]:
    """Return where a program differs from a recorded one, one text for each place."""
    return list(_walk("program", recorded, plain_program(program)))


def _walk(path: str, before: Any, now: Any) -> list[str]:
    if isinstance(before, dict) and isinstance(now, dict):
        keys = dict.fromkeys((*before, *now))
        return [text for key in keys for text in _entry(f"{path}.{key}", key, before, now)]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = enumerate(zip(before, now, strict=True))
        return [text for index, (a, b) in pairs for text in _walk(f"{path}[{index}]", a, b)]
    return [] if before == now else [f"{path}: recorded {_short(before)}, now {_short(now)}"]


def _entry(path: str, key: str, before: Plain, now: Plain) -> list[str]:
    """Return where one entry of both differs; one that only this version knows differs by what it meant before."""
    field = re.sub(r"\[\d+\]", "", path).removeprefix("program.")
    if key not in now:
        return [f"{path}: recorded {_short(before[key])}, not known by this version"]
    if key in before or field in MEANT:
        return _walk(path, before.get(key, MEANT.get(field)), now[key])
    return [f"{path}: not recorded, now {_short(now[key])}"]


def _short(value: Any) -> str:
    return f"{len(value)} entries" if isinstance(value, list) else str(value)
