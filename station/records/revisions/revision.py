"""The life of one revision of a recipe: a draft of its authors until another person has released it, and then it stays.

A text is named by its hash, and is never written over.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from recipes import open_regular
from recipes.text.yaml_source import LARGEST_FILE
from station.errors import RecordError, StationError
from station.records.chain.entries import (
    RECIPE_ASKED,
    RECIPE_SAVED,
    RECIPE_SENT_BACK,
)

TEXTS = "recipes"
THE_PROGRAM = "lostmotion"
"""Who has released the recipes that come with the program."""
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
    """One revision of a recipe: its text by hash and file, who wrote it, and who has released it; times in UTC.

    sent_back_by, reason: of a draft whose release was asked for and not given; a new text has neither.
    """

    name: str
    revision: int
    sha256: str
    path: Path
    state: State = State.DRAFT
    authors: tuple[str, ...] = ()
    saved: str = ""
    asked_by: str = ""
    sent_back_by: str = ""
    reason: str = ""
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
    """One thing that a person did to a revision; reason: why it was sent back."""

    kind: str
    name: str
    revision: int
    sha256: str
    person: str
    time: str
    reason: str = ""


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
        return replace(before, state=State.ASKED, asked_by=event.person, sent_back_by="", reason="")
    if before.state is not State.ASKED:
        raise RevisionError(f"{title} is a draft. Its author has to ask for the release first")
    if event.kind == RECIPE_SENT_BACK:
        return replace(before, state=State.DRAFT, sent_back_by=event.person, reason=event.reason)
    if event.person in before.authors:
        raise RevisionError(f"{title} was written by {event.person}. Another person has to release it")
    return replace(before, state=State.RELEASED, released_by=event.person, released=event.time)


def text_path(data: Path, name: str, revision: int, sha256: str) -> Path:
    """Return the file of a text."""
    return data / TEXTS / name / f"r{revision}.{sha256[:HASH_IN_NAME]}.yaml"


def hash_of(content: bytes) -> str:
    """Return the SHA-256 of a text, as hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()
