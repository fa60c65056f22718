"""The history of all revisions of recipes: what became of each, in chained and signed lines of a file.

    <data folder>/recipes.jsonl                            what became of each revision: chained lines, signed
    <data folder>/recipes/NAME/rREVISION.HASH.yaml         every text that was saved, never written over

A text is named by its hash, and a line of the history names the text that it speaks of. So a file that was changed
is no longer the text that was released. A line that was removed or changed can take a release away, and cannot make
one: a release counts only where a key that this computer trusts has signed it, and none is made while
lines are missing.

The recipes that come with the program are released by it. A plant's own releases of the same name come before them.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from pydantic import ValidationError

from recipes import RecipeError, shipped_recipes
from recipes.schema.recipe_schema import Header
from recipes.text.yaml_source import parse_source, read_bytes, refuse_misleading
from station.atomic_file import document_bytes, open_file, refused
from station.errors import RecordError
from station.records.chain.chain_file import Chain
from station.records.chain.entries import (
    RECIPE_ASKED,
    RECIPE_RELEASED,
    RECIPE_SAVED,
    RECIPE_SENT_BACK,
    Entry,
    entry_of,
)
from station.records.chain.walk import trust_of
from station.records.revisions.revision import THE_PROGRAM, Event, Revision, RevisionError, State, after, hash_of

HISTORY = "recipes.jsonl"
KINDS = (RECIPE_SAVED, RECIPE_ASKED, RECIPE_SENT_BACK, RECIPE_RELEASED)


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
    """Return name and revision of a recipe that somebody has written, whatever else is in it.

    Raises RecipeError where it does not say them, or looks other than it is read.
    """
    refuse_misleading(content, shown_as)
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
    what = (entry.kind, said["name"], said["revision"], said["recipe"], said["person"], said["time"])
    return Event(*what, said.get("reason", ""))


def _content(path: Path) -> bytes:
    try:
        with open_file(path) as file:
            return document_bytes(file)
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
