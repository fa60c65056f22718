"""What people do to a revision of a recipe: save a draft, ask for its release, release it or send it back."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ENOSPC
from pathlib import Path

from station.atomic_file import refused, sync_folder, write_atomic
from station.records.chain.entries import (
    RECIPE_ASKED,
    RECIPE_RELEASED,
    RECIPE_SAVED,
    RECIPE_SENT_BACK,
    signed_entry,
)
from station.records.chain.keys import leave_in_folder, own_key
from station.records.revisions.history import HISTORY, History, header_of
from station.records.revisions.revision import Event, Revision, RevisionError, State, after, hash_of
from station.wall_clock import now_text


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


def send_back(data: Path, name: str, revision: int, sha256: str, person: str, reason: str) -> Revision:  # noqa: PLR0917 - a line of the history
    """Send a draft back to its authors, by the hash of the text that the person has read, and say why.

    Raises:
        RevisionError: nobody has asked for its release, or it was changed.
        RecordError: it cannot be written.

    """
    return _done(data, Event(RECIPE_SENT_BACK, name, revision, sha256, person, now_text(), reason))


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
        fields |= {"reason": event.reason}  # taken by the kind that has one
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
