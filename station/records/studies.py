"""The files of guided studies, one for each: its plan, and which sealed run is the measurement of which step.

    <data folder>/studies/NAME.jsonl       chained lines, signed, only added to

The first line is the plan with who began it and when. Each further line names a step of its order, the run that
measured it and the hash of that run's run.json. Where a step has several, the last one counts: what was measured again
replaces what was altered since. A line that was removed or changed shows, and nothing is measured or evaluated by such
a file.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from station.atomic_file import append_line, document_bytes, open_file, refused, sync_folder
from station.documents.entries import plain
from station.documents.manifest import StudyPlace
from station.documents.reading import of_plain
from station.documents.study import StudyPlan
from station.errors import RecordError, StationError
from station.records.chain.chain_file import Chain
from station.records.chain.entries import STUDY_BEGUN, STUDY_TAKEN, Entry, entry_of, signed_entry
from station.records.chain.keys import leave_in_folder, own_key
from station.records.chain.walk import trust_of
from station.wall_clock import now_text

FOLDER = "studies"
ENDING = ".jsonl"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


class StudyError(StationError):
    """A study that is not there, is there already, or whose file was changed."""


class Taken(NamedTuple):
    """A run that was taken as the measurement of a step: hash of its run.json, by whom it was taken and when."""

    step: int
    run: str
    sha256: str
    person: str
    time: str


@dataclass(frozen=True)
class Study:
    """A study as its file has it; plan_sha256: hash of the plan's line, which its runs name. Times in UTC."""

    name: str
    path: Path
    plan: StudyPlan
    plan_sha256: str
    person: str
    begun: str
    taken: dict[int, Taken]

    def place(self, step: int) -> StudyPlace:
        """Return a step as a run names it."""
        return StudyPlace(name=self.name, plan=self.plan_sha256, step=step, steps=len(self.plan.order))


def check_name(name: str) -> str:
    """Return the name of a study as it may be one; StudyError otherwise."""
    if not NAME.fullmatch(name):
        raise StudyError(
            f"name of the study: found {name[:60]!r}; allowed are 1 to 40 letters, digits, - and _, a letter or digit "
            "first"
        )
    return name


def study_names(data: Path) -> list[str]:
    """Return the studies of a data folder by name; a file without a plan is that of none.

    Its beginning was cut off, as where the disk was full, and whoever asks for all studies still gets the others.
    """
    names = sorted(path.name.removesuffix(ENDING) for path in (data / FOLDER).glob(f"*{ENDING}"))
    return [name for name in names if NAME.fullmatch(name) and _is_begun(_path(data, name))]


def _is_begun(path: Path) -> bool:
    """Say whether a file has a plan, or something else in its place: that is told by whoever reads the study."""
    try:
        return bool(_entries(path))
    except (StudyError, RecordError):
        return True


def read_study(data: Path, name: str) -> Study:
    """Return a study.

    Raises:
        StudyError: there is none of that name, or lines of its file were removed or changed.
        RecordError: the file cannot be read.

    """
    path = _path(data, name)
    entries = _entries(path)
    if not entries:
        there = ", ".join(study_names(data)) or "none"
        raise StudyError(
            f"{path}: there is no such study. Studies here: {there}. Begin one with 'lostmotion quality study begin'"
        )
    return _study(data, name, entries)


def study_problems(data: Path, trusted: frozenset[str]) -> list[str]:
    """Return what is wrong with the files of studies, one text for each; trusted: keys whose signatures count.

    One without a line says nothing: whoever began it was killed before its plan was written.
    """
    found = []
    for name in study_names(data):
        try:
            entries = _entries(_path(data, name))
            if entries:
                _study(data, name, entries, trusted)
        except (StudyError, RecordError) as error:
            found.append(str(error))
    return found


def begin_study(data: Path, name: str, plan: StudyPlan, person: str) -> Study:
    """Write the plan of a new study, and return it.

    Raises:
        StudyError: there is one of that name. RecordError: it cannot be written.

    """
    path = _path(data, check_name(name))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        sync_folder(data)
    except OSError as error:
        raise refused(path.parent, error) from error
    with _writing(path):
        if _entries(path):
            raise StudyError(f"{path}: this study was begun already. Choose another name, or go on with that one")
        _add(data, path, None, STUDY_BEGUN, name=name, plan=plain(plan), person=person)
    return read_study(data, name)


def add_taken(data: Path, study: Study, step: int, run: str, sha256: str, person: str) -> None:  # noqa: PLR0917 - a line
    """Write that a run is the measurement of a step, if that does not stand there already.

    Raises:
        StudyError: the file was changed. RecordError: it cannot be written.

    """
    with _writing(study.path):
        entries = _entries(study.path)
        now = _study(data, study.name, entries).taken.get(step)
        if now is None or (now.run, now.sha256) != (run, sha256):
            said = {"step": step, "run": run, "sha256": sha256, "person": person}
            _add(data, study.path, entries[-1], STUDY_TAKEN, name=study.name, **said)


def _path(data: Path, name: str) -> Path:
    return data / FOLDER / f"{check_name(name)}{ENDING}"


def _study(data: Path, name: str, entries: list[Entry], trusted: frozenset[str] | None = None) -> Study:
    """Return a study by its lines; trusted: None for the keys that this computer knows."""
    path, trusted = _path(data, name), trust_of(Chain(data)).keys if trusted is None else trusted
    before: Entry | None = None
    for number, entry in enumerate(entries, start=1):
        follows = entry.counter == number and entry.fields["previous"] == ("" if before is None else before.sha256)
        kind = STUDY_BEGUN if number == 1 else STUDY_TAKEN
        why = (
            "does not follow the line before it: lines were removed or changed" if not follows or entry.kind != kind
            else "is of another study" if entry.fields["name"] != name
            else "is not signed by a key that this computer trusts" if entry.key not in trusted or not entry.signed
            else ""
        )  # fmt: skip
        if why:
            raise _damaged(path, f"line {number} {why}")
        before = entry
    first, *others = entries
    plan = of_plain(StudyPlan, first.fields["plan"], path)
    found = [Taken(*(one.fields[name] for name in Taken._fields)) for one in others]
    known = {one.step: one for one in found if 1 <= one.step <= len(plan.order)}
    return Study(name, path, plan, first.sha256, first.fields["person"], first.fields["time"], known)


def _damaged(path: Path, why: str) -> StudyError:
    return StudyError(f"{path}: this study is damaged: {why}. Restore the file from a backup, or begin a new study")


def _add(data: Path, path: Path, last: Entry | None, kind: str, **fields: object) -> None:
    key = own_key()
    counter, previous = (1, "") if last is None else (last.counter + 1, last.sha256)
    leave_in_folder(data, key.public)
    append_line(path, signed_entry(kind, counter, previous, now_text(), key, **fields).line)


def _entries(path: Path) -> list[Entry]:
    """Return the whole lines of a file; a torn one is none, and has no end.

    Raises:
        StudyError: its last line was changed. RecordError: it cannot be read.

    """
    try:
        with open_file(path) as file:
            content = document_bytes(file)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise refused(path, error, "read") from error
    lines = [entry_of(line) for line in content.split(b"\n") if line]
    if lines and lines[-1] is None and content.endswith(b"\n"):
        raise _damaged(path, "its last line is none of a study: it was changed")
    return [one for one in lines if one is not None and one.kind in (STUDY_BEGUN, STUDY_TAKEN)]


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Hold the file of a study against other writers."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise refused(path, error) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
