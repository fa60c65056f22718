"""The manifest of a run, `run.json`: every entry with what it must hold, and the one place where it is read as sound.

A reader gets a manifest in which every entry of the table is there and of its kind, or a RecordError that names the
file, the entry, what was found and what is allowed. An entry that the table does not know is kept as it is.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from datetime import date, datetime
from pathlib import Path
from typing import Any, NamedTuple

from station.durable import open_file, refused
from station.errors import RecordError
from station.records.clocks import CLOCK_NAMES

MANIFEST = "run.json"
RECORDING = "recording"
INTERRUPTED = "interrupted"
STATES = (RECORDING, "complete", "stopped", "fault", INTERRUPTED)
VERDICTS = ("PASS", "FAIL", "NOT DECIDABLE")
LARGEST_PERIOD_NS = 1_000_000_000
LARGEST_PID = 1 << 22
LONGEST_SHOWN = 40

NEXT_STEP = "Restore the file from a backup, or move the run's folder out of the data folder"


class Kind(NamedTuple):
    """What an entry may hold: the words for it, and the test."""

    allowed: str
    fits: Callable[[Any], bool]


class Entry(NamedTuple):
    """One entry: its place in the file, what it may hold, and whether it is always there (in a block that is)."""

    place: str
    kind: Kind
    always: bool = True


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _moment(value: Any) -> bool:
    try:
        moment = datetime.fromisoformat(value)
        return moment.tzinfo is not None and date.fromisoformat(value[:10]) == moment.date()
    except (TypeError, ValueError):
        return False


def _one_of(*allowed: str) -> Kind:
    return Kind(f"one of {', '.join(allowed)}", lambda value: isinstance(value, str) and value in allowed)


def _or_null(kind: Kind) -> Kind:
    return Kind(f"{kind.allowed}, or null", lambda value: value is None or kind.fits(value))


def _whole_from(least: int, most: int | None = None) -> Kind:
    words = f"a whole number of at least {least}" if most is None else f"a whole number from {least} to {most}"
    return Kind(words, lambda value: _whole(value) and least <= value and (most is None or value <= most))


TEXT = Kind("a text", lambda value: isinstance(value, str))
NAME = Kind("a text that is not empty", lambda value: isinstance(value, str) and bool(value.strip()))
PATH = Kind("a path", lambda value: isinstance(value, str) and bool(value) and "\0" not in value)
FLAG = Kind("true or false", lambda value: isinstance(value, bool))
BLOCK = Kind("a block of entries", lambda value: isinstance(value, dict))
TEXTS = Kind("a list of texts", lambda value: isinstance(value, list) and all(isinstance(one, str) for one in value))
MOMENT = Kind("a moment with its time zone, as 2026-01-05T08:00:00.000+00:00", _moment)
NUMBER = Kind(
    "a number", lambda value: isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
)
CHECKSUMS = Kind(
    "SHA-256 and size of each file",
    lambda value: (
        isinstance(value, dict)
        and all(
            PATH.fits(name)
            and isinstance(one, dict)
            and isinstance(one.get("sha256"), str)
            and _whole(one.get("bytes"))
            for name, one in value.items()
        )
    ),
)

ENTRIES: tuple[Entry, ...] = (
    Entry("id", NAME),
    Entry("serial", NAME),
    Entry("attempt", _whole_from(1)),
    Entry("state", _one_of(*STATES)),
    Entry("verdict", _or_null(_one_of(*VERDICTS))),
    Entry("started", MOMENT),
    Entry("ended", _or_null(TEXT)),
    Entry("format", _whole_from(1)),
    Entry("desk", BLOCK),
    Entry("desk.pid", _whole_from(0, LARGEST_PID)),
    Entry("desk.birth", TEXT),
    Entry("recipe", BLOCK),
    Entry("recipe.name", NAME),
    Entry("recipe.revision", _whole_from(0)),
    Entry("recipe.sha256", TEXT),
    Entry("recipe.file", TEXT, always=False),
    Entry("bench", BLOCK),
    Entry("bench.name", NAME),
    Entry("bench.revision", _whole_from(0)),
    Entry("bench.sha256", TEXT),
    Entry("bench.file", TEXT, always=False),
    Entry("bench.embedded", FLAG),
    Entry("software", BLOCK),
    Entry("unit", BLOCK),
    Entry("unit.model", NAME),
    Entry("unit.virtual", _or_null(TEXT)),
    Entry("clock", _one_of(*CLOCK_NAMES)),
    Entry("period_ns", _whole_from(1, LARGEST_PERIOD_NS)),
    Entry("notes", TEXTS),
    Entry("ring", _or_null(PATH)),
    Entry("scenario", _or_null(TEXT), always=False),
    Entry("operator", _or_null(TEXT), always=False),
    Entry("trouble", _or_null(TEXT), always=False),
    Entry("records", _whole_from(0), always=False),
    Entry("files", _or_null(CHECKSUMS), always=False),
    Entry("samples", BLOCK, always=False),
    Entry("samples.file", PATH),
    Entry("samples.sha256", TEXT),
    Entry("samples.bytes", _whole_from(0)),
    Entry("unit.noise_seed", _or_null(_whole_from(0)), always=False),
    Entry("recovery_of", NAME, always=False),
    Entry("left", BLOCK, always=False),
    Entry("left.fault", _whole_from(0)),
    Entry("left.torque_in_tare_nm", NUMBER),
    Entry("left.torque_out_tare_nm", NUMBER),
)
"""Every entry that this program reads. `left` is that of a recovery: how the bench was left before it."""

_MISSING = object()


def read_manifest(path: Path) -> dict[str, Any]:
    """Return a run's manifest, sound in every entry.

    Raises:
        RecordError: it cannot be read, is no JSON, or an entry is missing or of another kind.

    """
    try:
        with open_file(path) as file:
            content = file.read()
    except OSError as error:
        raise refused(path, error, "read") from error
    return sound_manifest(content, path)


def sound_manifest(content: bytes, path: Path) -> dict[str, Any]:
    """Return the manifest in these bytes, sound in every entry; RecordError as `read_manifest`."""
    try:
        found = json.loads(content)
    except (ValueError, RecursionError) as error:
        what = " ".join(str(error).split())
        raise RecordError(f"{path}: is damaged: it is no JSON ({what}). {NEXT_STEP}") from error
    if not isinstance(found, dict):
        raise RecordError(f"{path}: is damaged: found {_shown(found)}; allowed is a run's manifest. {NEXT_STEP}")
    if wrong := list(_wrong(found)):
        raise RecordError(f"{path}: is damaged: {'; '.join(wrong)}. {NEXT_STEP}")
    return found


def _wrong(manifest: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with each entry; a block that is none has an entry of its own, and none inside."""
    for entry in ENTRIES:
        block, _, name = entry.place.rpartition(".")
        holder = manifest.get(block) if block else manifest
        if not isinstance(holder, dict):
            continue
        value = holder.get(name, _MISSING)
        if value is _MISSING and not entry.always:
            continue
        if value is _MISSING or not entry.kind.fits(value):
            yield _difference(entry.place, value, entry.kind)


def _difference(place: str, value: Any, kind: Kind) -> str:
    found = "is missing" if value is _MISSING else f"found {_shown(value)}"
    return f"{place}: {found}; allowed is {kind.allowed}"


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
