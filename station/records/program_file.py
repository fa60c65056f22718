"""The program of a run as it is stored in program.json: written, read with what older versions left out, compared.

A field that program.json lacks was unknown to the version that wrote it. What it meant then stands in `MEANT`; a field
that is not there has no meaning of its own, and who needs it is told so.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from definitions.plain_data import plain
from definitions.program import Program
from station.errors import RecordError
from station.records.run_record import RunRecord

PROGRAM = "program.json"

MEANT: Mapping[str, Any] = MappingProxyType({"loading_input": True})
"""Field of a program, by its path without indices, and what a program meant that was written before there was one.

loading_input: the first benches had the servo at the input shaft.
"""

NEXT_STEP = "Restore the file from a backup"


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _segments(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, dict) for one in value)


READ: Mapping[str, tuple[str, Callable[[Any], bool]]] = MappingProxyType(
    {
        "period_s": ("a period above 0 s", lambda value: _number(value) and value > 0.0),
        "has_torque_out": ("true or false", lambda value: isinstance(value, bool)),
        "release_torque_nm": ("a torque in N·m", _number),
        "segments": ("a list of segments", _segments),
    }
)
"""Entries of a stored program that are read from it, and what they may hold."""

SEGMENT_FIELDS = ("index", "role", "direction", "cycle")
"""What the analysis needs of each segment."""


class StoredProgram:
    """The program of a run as it was written; fields are asked for by name."""

    def __init__(self, said: Any, place: Path) -> None:
        if not isinstance(said, dict):
            raise RecordError(f"{place}: is damaged: it is not a program")
        for name, (allowed, fits) in READ.items():
            if name in said and not fits(said[name]):
                found = _short(said[name])
                raise RecordError(f"{place}: is damaged: {name}: found {found}; allowed is {allowed}. {NEXT_STEP}")
        self._said, self._place = said, place

    @classmethod
    def of(cls, run: RunRecord) -> StoredProgram:
        """Return the program of a run; RecordError when it cannot be read or an entry is not what it may be."""
        return cls(run.read_json(PROGRAM), run.folder / PROGRAM)

    def __getitem__(self, name: str) -> Any:
        """Return a field, or what it meant where there is none; RecordError for one without such a meaning."""
        if name in self._said:
            return self._said[name]
        if name in MEANT:
            return MEANT[name]
        raise RecordError(
            f"{self._place}: has no entry {name}: the version that wrote it did not know it, or it is damaged"
        )

    @property
    def segments(self) -> list[dict[str, Any]]:
        """The segment table; RecordError when a segment lacks what the analysis needs."""
        segments: list[dict[str, Any]] = self["segments"]
        for number, row in enumerate(segments):
            missing = [name for name in SEGMENT_FIELDS if name not in row]
            if missing:
                raise RecordError(f"{self._place}: is damaged: segments[{number}] has no {', '.join(missing)}")
        return segments


def plain_program(program: Program) -> dict[str, Any]:
    """Return a program as plain data; infinities are None: JSON has no other way to say that there is no limit."""
    entries: dict[str, Any] = plain(program)
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


def _entry(path: str, key: str, before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return where one entry of both differs; one that only this version knows differs by what it meant before."""
    field = re.sub(r"\[\d+\]", "", path).removeprefix("program.")
    if key not in now:
        return [f"{path}: recorded {_short(before[key])}, not known by this version"]
    if key in before or field in MEANT:
        return _walk(path, before.get(key, MEANT.get(field)), now[key])
    return [f"{path}: not recorded, now {_short(now[key])}"]


def _short(value: Any) -> str:
    return f"{len(value)} entries" if isinstance(value, list) else str(value)
