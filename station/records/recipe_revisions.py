"""Revisions of recipes: each is a draft of its authors until another person has released it, and then it stays.

    <data folder>/recipes.jsonl                            what became of each revision: chained lines, signed
    <data folder>/recipes/NAME/rREVISION.HASH.yaml         every text that was saved, never written over

A text is named by its hash, and a line of the history names the text that it speaks of. So a file that was changed
is no longer the text that was released. A line that was removed or changed can take a release away, and cannot make
one: a release counts only where a key that this computer trusts has signed it, and none is made while
lines are missing.

The recipes that come with the program are released by it. A plant's own releases of the same name come before them.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from errno import ENOSPC
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from recipes import RecipeError, open_regular, shipped_recipes
from recipes.schema.recipe_schema import Header
from recipes.text.yaml_source import LARGEST_FILE, parse_source, read_bytes
from station.atomic_file import open_file, refused, sync_folder, write_atomic
from station.errors import RecordError, StationError
from station.records.chain.chain_file import Chain
from station.records.chain.entries import (
    RECIPE_ASKED,
    RECIPE_RELEASED,
    RECIPE_SAVED,
    Entry,
    entry_of,
    signed_entry,
)
from station.records.chain.keys import leave_in_folder, own_key
from station.records.chain.walk import trust_of
from station.wall_clock import now_text

HISTORY = "recipes.jsonl"
TEXTS = "recipes"
THE_PROGRAM = "lostmotion"
"""Who has released the recipes that come with the program."""

KINDS = (RECIPE_SAVED, RECIPE_ASKED, RECIPE_RELEASED)
HASH_IN_NAME = 12
"""Digits of the hash in the name of a text's file."""


class RevisionError(StationError):
    """The life of a revision does not allow it: one that is released, an author who releases, a text that changed."""


class State(StrEnum):
    """Where a revision is in its life."""

    DRAFT = "draft"
    ASKED = "release asked"
    RELEASED = "released"


@dataclass(frozen=True)
class Revision:
    """One revision of a recipe: its text by hash and file, who wrote it, and who has released it; times in UTC."""

    name: str
    revision: int
    sha256: str
    path: Path
    state: State = State.DRAFT
    authors: tuple[str, ...] = ()
    saved: str = ""
    asked_by: str = ""
    released_by: str = ""
    released: str = ""

    @property
    def title(self) -> str:
        """Name and revision as people say them."""
        return f"{self.name} revision {self.revision}"

    @property
    def shipped(self) -> bool:
        """Whether it came with the program."""
        return self.released_by == THE_PROGRAM and not self.authors

    def text(self) -> bytes:
        """Return its text; RecordError where the file is gone, or is not the one that was saved."""
        try:
            with open_regular(self.path) as file:
                content = file.read(LARGEST_FILE + 1)
        except (OSError, ValueError) as error:
            raise RecordError(
                f"{self.path}: this stored recipe cannot be read: {error}. Restore the file from a backup"
            ) from error
        if hash_of(content) != self.sha256:
            raise RecordError(
                f"{self.path}: this stored recipe was changed after it was saved. Restore the file from a backup"
            )
        return content


class Event(NamedTuple):
    """One thing that a person did to a revision."""

    kind: str
    name: str
    revision: int
    sha256: str
    person: str
    time: str


def after(before: Revision | None, event: Event, data: Path) -> Revision:
    """Return what a revision is after an event; None before: there was none.

    Raises:
        RevisionError: its life does not allow that.

    """
    title = f"{event.name} revision {event.revision}"
    if before is not None and before.state is State.RELEASED:
        raise RevisionError(f"{title} is released and cannot be changed. Save the change as a new revision")
    if event.kind == RECIPE_SAVED:
        path = text_path(data, event.name, event.revision, event.sha256)
        authors = tuple(dict.fromkeys([*(() if before is None else before.authors), event.person]))
        return Revision(event.name, event.revision, event.sha256, path, State.DRAFT, authors, event.time)
    if before is None:
        raise RevisionError(f"There is no {title}. Save it first")
    if before.sha256 != event.sha256:
        raise RevisionError(f"{title} was changed by somebody else. Load the new text and read it")
    if event.kind == RECIPE_ASKED:
        return replace(before, state=State.ASKED, asked_by=event.person)
    if before.state is not State.ASKED:
        raise RevisionError(f"{title} is a draft. Its author has to ask for the release first")
    if event.person in before.authors:
        raise RevisionError(f"{title} was written by {event.person}. Another person has to release it")
    return replace(before, state=State.RELEASED, released_by=event.person, released=event.time)


def text_path(data: Path, name: str, revision: int, sha256: str) -> Path:
    """Return the file of a text."""
    return data / TEXTS / name / f"r{revision}.{sha256[:HASH_IN_NAME]}.yaml"


def hash_of(content: bytes) -> str:
    """Return the SHA-256 of a text, as hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


@lru_cache(maxsize=1)
def shipped_revisions() -> dict[tuple[str, int], Revision]:
    """Return the recipes that come with the program, by name and revision."""
    found = {}
    for path in shipped_recipes().values():
        content = read_bytes(path)
        header = header_of(content)
        found[header.name, header.revision] = Revision(
            header.name, header.revision, hash_of(content), path, State.RELEASED, released_by=THE_PROGRAM
        )
    return found


def header_of(content: bytes, shown_as: str = "recipe") -> Header:
    """Return name and revision of a recipe, whatever else is in it; RecipeError where it does not say them."""
    source = parse_source(content, shown_as)
    section = source.data.get("recipe") if isinstance(source.data, dict) else None
    given = section if isinstance(section, dict) else {}
    try:
        return Header.model_validate({key: given.get(key) for key in ("name", "revision")}, strict=True)
    except ValidationError as error:
        raise RecipeError(
            source.problem(("recipe", *one["loc"]), f"{one['input']!r:.60}", "name and revision of the recipe")
            for one in error.errors(include_url=False)
        ) from error


class History:
    """The revisions of a data folder as they are now, and what is wrong with the lines that tell of them."""

    def __init__(self, data: Path, trusted: frozenset[str] | None = None) -> None:
        """Read it; trusted: public keys whose signatures count, None for those that this computer knows.

        Raises:
            RecordError: the file is there and cannot be read.

        """
        self.data = data
        self.entries, broken = _entries(_content(data / HISTORY))
        self.problems = list(broken)
        self.own: dict[tuple[str, int], Revision] = {}
        """Revisions that were saved here, by name and revision."""
        if trusted is None:
            trusted = trust_of(Chain(data)).keys if self.entries else frozenset()
        for entry in self.entries:
            if entry.key not in trusted or not entry.signed:
                self.problems.append(
                    f"{HISTORY}: line {entry.counter} is not signed by a key that this computer trusts"
                )
                continue
            event = event_of(entry)
            try:
                self.own[event.name, event.revision] = after(self.own.get(event[1:3]), event, data)
            except RevisionError as error:
                self.problems.append(f"{HISTORY}: line {entry.counter}: {error}")

    def all(self) -> list[Revision]:
        """Return every revision, the shipped ones too, by name and newest first."""
        return sorted((shipped_revisions() | self.own).values(), key=lambda one: (one.name, -one.revision))

    def find(self, name: str, revision: int) -> Revision | None:
        """Return a revision; None where there is none."""
        return self.own.get((name, revision)) or shipped_revisions().get((name, revision))

    def newest_released(self, name: str) -> Revision | None:
        """Return the newest revision of a name that is released: by the plant, and where it has none by the program."""
        for there in (self.own, shipped_revisions()):
            released = [one for one in there.values() if one.name == name and one.state is State.RELEASED]
            if released:
                return max(released, key=lambda one: one.revision)
        return None

    def released_with(self, sha256: str) -> Revision | None:
        """Return the released revision whose text has this hash; None where no such text is released."""
        there = (*self.own.values(), *shipped_revisions().values())
        return next((one for one in there if one.sha256 == sha256 and one.state is State.RELEASED), None)

    def next_revision(self, name: str) -> int:
        """Return the number that a new revision of a name has at least: one above all that are released."""
        numbers = [one.revision for one in self.all() if one.name == name and one.state is State.RELEASED]
        return max(numbers, default=0) + 1

    def text_problems(self) -> list[str]:
        """Return which texts are gone, or are not what was saved."""
        problems = []
        for one in self.own.values():
            try:
                one.text()
            except RecordError as error:
                problems.append(f"{one.title}: {error}")
        return problems

    def events(self, name: str) -> list[Event]:
        """Return what was done to the revisions of a name, oldest first."""
        return [event for event in map(event_of, self.entries) if event.name == name]


def event_of(entry: Entry) -> Event:
    """Return what a line of the history says."""
    said = entry.fields
    return Event(entry.kind, said["name"], said["revision"], said["recipe"], said["person"], said["time"])


def save_draft(data: Path, content: bytes, person: str, replaces: str = "") -> Revision:
    """Save a text as the draft of the revision that it names; replaces: hash of the draft that is there, if any.

    Raises:
        RecipeError: it is no YAML, or does not say its name and revision.
        RevisionError: the revision is released, or is not above those that are; somebody has changed the draft.
        RecordError: it cannot be written.

    """
    header = header_of(content)
    sha256, name, revision = hash_of(content), header.name, header.revision
    with _writing(data) as writer:
        history = writer.history
        there, least = history.find(name, revision), history.next_revision(name)
        if there is not None and there.state is not State.RELEASED and there.sha256 not in (replaces, sha256):
            raise RevisionError(
                f"{there.title} was saved by {there.authors[-1]}. Load it again, or choose another revision number"
            )
        if there is None and revision < least:
            raise RevisionError(
                f"{name} revision {revision}: a higher revision is released already. Write revision {least} or higher"
            )
        event = Event(RECIPE_SAVED, name, revision, sha256, person, now_text())
        found = after(there, event, data)
        if there is not None and there.sha256 == sha256 and person in there.authors:
            return there
        if not found.path.is_file():
            _keep(found.path, content)
        writer.add(event)
    return found


def _keep(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refused(path, error) from error
    write_atomic(path, content)


def ask_release(data: Path, name: str, revision: int, sha256: str, person: str) -> Revision:
    """Ask that a draft be released, by the hash of the text that the person has read.

    Raises:
        RevisionError: there is no such draft.
        RecordError: it cannot be written.

    """
    return _done(data, Event(RECIPE_ASKED, name, revision, sha256, person, now_text()))


def release(data: Path, name: str, revision: int, sha256: str, person: str) -> Revision:
    """Release a revision, by the hash of the text that the person has read.

    Raises:
        RevisionError: nobody has asked for it, it was changed, or the person is one of its authors.
        RecordError: it cannot be written, or its text is gone.

    """
    return _done(data, Event(RECIPE_RELEASED, name, revision, sha256, person, now_text()))


def _done(data: Path, event: Event) -> Revision:
    with _writing(data) as writer:
        history = writer.history
        found = after(history.find(event.name, event.revision), event, data)
        if history.problems and event.kind == RECIPE_RELEASED:
            raise RevisionError(f"{history.problems[0]}. Nothing is released until {HISTORY} is restored from a backup")
        found.text()
        writer.add(event)
    return found


class _Writer:
    """The history while this process alone may add to it."""

    def __init__(self, history: History, handle: int) -> None:
        self.history = history
        self._handle = handle

    def add(self, event: Event) -> None:
        """Add the line of an event, and see it on the disk."""
        data, entries, key = self.history.data, self.history.entries, own_key()
        last = entries[-1] if entries else None
        fields = {"name": event.name, "revision": event.revision, "recipe": event.sha256, "person": event.person}
        counter, previous = (1, "") if last is None else (last.counter + 1, last.sha256)
        entry = signed_entry(event.kind, counter, previous, event.time, key, **fields)
        path = data / HISTORY
        try:
            leave_in_folder(data, key.public)
            _append(self._handle, entry.line)
            sync_folder(data)
        except OSError as error:
            raise refused(path, error) from error


def _append(handle: int, line: bytes) -> None:
    """Add a line to a file, behind one that a power failure has torn; OSError where not all of it goes in."""
    size = os.fstat(handle).st_size
    torn = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
    whole = (b"\n" if torn else b"") + line + b"\n"
    if os.write(handle, whole) != len(whole):
        os.ftruncate(handle, size)
        raise OSError(ENOSPC, os.strerror(ENOSPC))
    os.fsync(handle)


@contextmanager
def _writing(data: Path) -> Iterator[_Writer]:
    """Hold the history against other writers, and read it."""
    path = data / HISTORY
    try:
        data.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise refused(path, error) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield _Writer(History(data), handle)
    finally:
        os.close(handle)


def _content(path: Path) -> bytes:
    try:
        with open_file(path) as file:
            return file.read()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise refused(path, error, "read") from error


@lru_cache(maxsize=8)
def _entries(content: bytes) -> tuple[tuple[Entry, ...], tuple[str, ...]]:
    """Return the lines of a history, and what is wrong between them."""
    entries = [one for line in content.split(b"\n") if line and (one := entry_of(line)) is not None]
    entries = [one for one in entries if one.kind in KINDS]
    return tuple(entries), tuple(_broken(entries))


def _broken(entries: Iterable[Entry]) -> Iterable[str]:
    counter, sha256 = 0, ""
    for entry in entries:
        if entry.counter != counter + 1 or entry.fields["previous"] != sha256:
            yield f"{HISTORY}: lines before line {entry.counter} were removed or changed"
        counter, sha256 = entry.counter, entry.sha256
