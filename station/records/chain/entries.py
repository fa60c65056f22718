"""The entries of a chain: one line of JSON each, with the hash of the line before, signed.

| kind | says |
|---|---|
| `start` | a chain begins: its id, and what was in the folder before it |
| `created` | an attempt exists: run, serial number, attempt; nothing is measured yet |
| `sealed` | a run was concluded: SHA-256 of its run.json, state and verdict |
| `lost` | entries that this computer had seen are gone: their counters are never used again |

Entries of the same form tell what became of the revisions of recipes, in a file of their own (`revisions.history`):

| kind | says |
|---|---|
| `recipe_saved` | a person saved this text as a draft of a revision |
| `recipe_asked` | a person asked that the draft be released |
| `recipe_sent_back` | a person sent the draft back to its authors, and says why |
| `recipe_released` | a person who is none of its authors released it |

And so do those of a guided study, in a file for each (`studies`):

| kind | says |
|---|---|
| `study_begun` | a person began a study by this plan |
| `study_taken` | a run, by the hash of its run.json, is the measurement of a step |

The signature covers the line up to the signature itself. The order of the first fields is part of the format: runs and
serial numbers are found by it without reading every line.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property, lru_cache
from typing import Any

from definitions.number_formats import LARGEST, LARGEST_COUNT
from station.records.chain.keys import BenchKey, signed_by

START, CREATED, SEALED, LOST, REMOVED = "start", "created", "sealed", "lost", "removed"
RECIPE_SAVED, RECIPE_ASKED, RECIPE_RELEASED = "recipe_saved", "recipe_asked", "recipe_released"
RECIPE_SENT_BACK = "recipe_sent_back"
STUDY_BEGUN, STUDY_TAKEN = "study_begun", "study_taken"
FIELDS: dict[str, tuple[str, ...]] = {
    START: ("chain", "before", "replaces"),
    CREATED: ("run", "serial", "attempt", "recipe", "bench"),
    SEALED: ("run", "serial", "attempt", "created", "sha256", "state", "verdict"),
    LOST: ("first", "last", "sha256"),
    REMOVED: ("run", "serial", "sha256", "rule", "person", "trace"),
    RECIPE_SAVED: ("name", "revision", "recipe", "person"),
    RECIPE_ASKED: ("name", "revision", "recipe", "person"),
    RECIPE_SENT_BACK: ("name", "revision", "recipe", "person", "reason"),
    RECIPE_RELEASED: ("name", "revision", "recipe", "person"),
    STUDY_BEGUN: ("name", "plan", "person"),
    STUDY_TAKEN: ("name", "step", "run", "sha256", "person"),
}
"""What an entry of each kind has, beside what every entry has."""

LEFT_OUT: dict[str, tuple[str, ...]] = {
    CREATED: ("files", "clock_right"),
    REMOVED: ("attempt", "state", "verdict", "aside"),
}
"""What an entry of a kind has where there is something to say.

files: SHA-256 of the run's program and of each of its device profiles, by name. Older lines do not have it.
clock_right: why the clock is right, though entries before this one are later. Of them none counts as later behind it.
attempt, state, verdict: of a run from before the chain whose record a rule has removed: no other line tells them.
aside: why the run that was removed is no attempt at a real unit: only its record told it.
"""

_TEXTS = (
    "kind",
    "time",
    "previous",
    "key",
    "signature",
    "chain",
    "run",
    "serial",
    "recipe",
    "bench",
    "sha256",
    "state",
    "name",
    "person",
    "reason",
    "clock_right",
    "rule",
    "trace",
    "aside",
)
_NUMBERS = ("counter", "attempt", "first", "last", "revision", "step")
_BEFORE: dict[str, type] = {"bytes": int, "sha256": str, "unconcluded": list}
_REPLACES: dict[str, type] = {"chain": str, "counter": int, "sha256": str}

LONGEST_NAME = 255
"""Bytes of the name of a folder: what a file system takes."""

NO_TIME = datetime.min.replace(tzinfo=UTC)

Fields = dict[str, Any]
"""An entry's fields as they stand in its line: what a later version wrote is signed and hashed as it was."""

SIGNATURE = b',"signature":"'
BEGINS, ENDS = b'{"kind":"', b'"}'
"""How the line of every entry begins and ends."""

ESCAPED = b"\\u"
"""What stands in a line before the number of a character that is not written as itself."""


@dataclass(frozen=True)
class Entry:
    """One line of a chain, as it stands in the file, and what it says."""

    line: bytes
    fields: Fields

    @property
    def kind(self) -> str:
        """Kind of the entry, a key of `FIELDS`."""
        return str(self.fields["kind"])

    @property
    def counter(self) -> int:
        """Number of the entry, from 1."""
        return int(self.fields["counter"])

    @property
    def key(self) -> str:
        """Public key that it names as that of its signature."""
        return str(self.fields["key"])

    @property
    def at(self) -> datetime:
        """When it was written; the first moment of all where its time is none."""
        try:
            found = datetime.fromisoformat(str(self.fields["time"]))
            return NO_TIME if found.tzinfo is None else found.astimezone(UTC)
        except (ValueError, OverflowError):
            return NO_TIME

    @cached_property
    def sha256(self) -> str:
        """Hash of the line, which the next entry holds."""
        return hashlib.sha256(self.line).hexdigest()

    @cached_property
    def signed(self) -> bool:
        """Whether the key that it names has signed this line."""
        content, _, signature = self.line.rpartition(SIGNATURE)
        return signed_by(self.key, content + b"}", signature[:-2].decode("ascii", "replace"))


def signed_entry(kind: str, counter: int, previous: str, time: str, key: BenchKey, **fields: Any) -> Entry:
    """Return a new entry, signed; `fields` are those of its kind."""
    row = {"kind": kind, "counter": counter} | {name: fields[name] for name in FIELDS[kind]}
    row |= {name: fields[name] for name in LEFT_OUT.get(kind, ()) if fields.get(name)}
    row |= {"time": time, "previous": previous, "key": key.public}
    content = json.dumps(row, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
    signature = key.sign(content)
    line = content[:-1] + SIGNATURE + signature.encode() + b'"}'
    return Entry(line, row | {"signature": signature})


@lru_cache(maxsize=512)
def entry_of(line: bytes) -> Entry | None:
    """Return the entry that a line is; None for a line that is none: torn, or of another hand.

    Those of the newest lines are kept: whoever writes a line, or looks at a run, asks for the end of the same chain.
    """
    fields = object_in(line)
    if fields is None:
        return None
    own = FIELDS.get(str(fields.get("kind")), ("kind of an entry",))
    needed = (*own, "counter", "time", "previous", "key", "signature")
    return Entry(line, fields) if all(name in fields for name in needed) and _sound(line, fields) else None


def object_in(line: bytes) -> Fields | None:
    """Return the object of JSON that a line is; None for a line that is none, as one that a power failure has torn."""
    try:
        fields = json.loads(line.decode())  # as text: of bytes, lone surrogates would be taken too
    except (ValueError, RecursionError):
        return None
    return fields if isinstance(fields, dict) else None


def is_torn(line: bytes) -> bool:
    """Whether a line that is no object of JSON is the beginning of an entry, as far as a power failure left it.

    Of what did not come to the disk some file systems leave zeros, or nothing but them.
    """
    kept = line.rstrip(b"\0")
    return kept[: len(BEGINS)] == BEGINS[: len(kept)] and not kept.endswith(ENDS)


def _sound(line: bytes, fields: Fields) -> bool:
    """Whether what stands in an entry is of its kind and within its bounds, so that nobody stumbles over it."""
    return (
        all(isinstance(fields[name], str) for name in _TEXTS if name in fields)
        and all(_number(fields[name]) for name in _NUMBERS if name in fields)
        and (fields.get("created") is None or _number(fields["created"]))
        and isinstance(fields.get("verdict"), str | None)
        and isinstance(fields.get("plan"), dict | None)
        and isinstance(fields.get("files"), dict | None)
        and all(isinstance(sha256, str) for sha256 in (fields.get("files") or {}).values())
        and _block(fields.get("before"), _BEFORE)
        and 0 <= (fields.get("before") or {}).get("bytes", 0) <= LARGEST
        and all(isinstance(run, str) and _name(run) for run in (fields.get("before") or {}).get("unconcluded", ()))
        and _block(fields.get("replaces"), _REPLACES)
        and _number((fields.get("replaces") or {}).get("counter", 1))
        and ("run" not in fields or _name(fields["run"]))
        and (ESCAPED not in line or _writable(fields))
    )


def _number(found: object) -> bool:
    return type(found) is int and 1 <= found <= LARGEST_COUNT


def _name(run: str) -> bool:
    """Whether a text can name a folder beside the chain, and none elsewhere."""
    return run not in ("", ".", "..") and "/" not in run and len(run.encode("utf-8", "replace")) <= LONGEST_NAME


def _writable(found: object) -> bool:
    """Whether the texts in something can be written to every file and database: no NUL, no half of a character."""
    if isinstance(found, str):
        return "\0" not in found and not any("\ud800" <= sign <= "\udfff" for sign in found)
    if isinstance(found, dict):
        return all(_writable(name) and _writable(value) for name, value in found.items())
    return not isinstance(found, list) or all(map(_writable, found))


def _block(found: object, kinds: dict[str, type]) -> bool:
    return found is None or (
        isinstance(found, dict) and all(isinstance(found.get(name), kind) for name, kind in kinds.items())
    )


def text_in_line(value: object) -> bytes:
    """Return how a value stands in a line, to look for it without reading the line."""
    # The name of a folder need not be text: such a name stands in no line, and is no error.
    return json.dumps(value, ensure_ascii=False).encode("utf-8", "surrogatepass")
