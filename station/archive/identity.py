"""Which archive it is: a marker object with the archive's id, and the id that a data folder has noted.

An archive on a share that is not mounted looks like an empty folder, in which whatever is archived would be lost. So
the first push makes the marker and notes its id in the data folder, and everybody looks for this marker before the
archive is used. Data folders of several benches may share an archive, and so its marker.
"""

from __future__ import annotations

import json
import os
import tempfile
import uuid
from pathlib import Path

from station.archive.place import Place
from station.archive.settings import ArchiveError, load_settings
from station.atomic_file import refused, write_atomic
from station.documents.archived import ArchiveId
from station.documents.entries import plain
from station.documents.reading import document_in, read_document
from station.errors import RecordError
from station.records.archive_note import NOTE, read_note
from station.records.chain.chain_file import Chain
from station.wall_clock import WALL_CLOCK, now_text

MARKER = "archive-id.json"
"""Name of the marker in the archive, and of the note of it in the data folder."""

LONGEST_BYTES = 4096
NEW = "lostmotion archive push --new-archive"
WHAT_TO_DO = (
    "Nothing is lost. If the archive is on a network drive or another disk, mount it; check the url in archive.yaml. "
    f"Then run the command again. Only if this place is to be a new archive: '{NEW}'"
)


def archive_of(data: Path) -> Place:
    """Open the archive of a data folder, and make sure that it is the one that it was.

    Raises:
        ArchiveError: no settings, the archive cannot be used, or it is not the one of this data folder.
        RecipeError: the settings are wrong. RecordError: the data folder cannot be read.

    """
    place = Place(load_settings(data))
    recognise(data, place)
    return place


def recognise(data: Path, place: Place) -> ArchiveId | None:
    """Return the marker of an archive, None where it has none yet; nothing is written.

    Raises:
        ArchiveError: this data folder has archived something, and this is not where; or the archive cannot be used.
        RecordError: the data folder cannot be read.

    """
    _mounted(place)
    found, known = _marker(place), _known(data)
    if known is not None:
        _same(data, place, found, known)
        return found
    lines = read_note(data).lines
    # From before archives had markers. The oldest object: a later one may have been written to a wrong place.
    if lines and not place.exists(lines[0].full.name):
        raise ArchiveError(
            f"archive {place.settings.url}: this is not the archive that {data} has written to: {lines[0].full.name}, "
            f"its oldest object by {NOTE}, is not there. {WHAT_TO_DO}"
        )
    return found


def claim(data: Path, place: Place, *, new: bool) -> tuple[ArchiveId, str]:
    """Make sure of the archive before a push; the first one makes the marker and notes it.

    new: a person says that the place is another archive than before. Then the note of the earlier one is set aside, and
    every run that is in the data folder is archived anew.

    Returns: the marker, and the name of the note that was set aside, '' for none.

    Raises: as `recognise`; ArchiveError where `new` is said of the archive that is known already.

    """
    if not new:
        marker = recognise(data, place) or _made(data, place)
        if _known(data) is None:
            _note(data, marker)
        return marker, ""
    _mounted(place)
    found, known = _marker(place), _known(data)
    if found is not None and known is not None and found.id == known.id:
        raise ArchiveError(
            f"--new-archive: {place.settings.url} is the archive of this data folder already. Leave the option out"
        )
    taken = found or _made(data, place)
    aside = _set_aside(data)  # first: whoever is killed behind it is refused, and says it once more
    _note(data, taken)
    return taken, aside


def still(data: Path, place: Place, claimed: ArchiveId) -> None:
    """Refuse where the archive is no more the one that a push began with: a share that went away meanwhile."""
    _mounted(place)
    _same(data, place, _marker(place), claimed)


def _same(data: Path, place: Place, found: ArchiveId | None, known: ArchiveId) -> None:
    if found is not None and found.id == known.id:
        return
    there = f"its {MARKER} has the id {found.id}" if found is not None else f"it has no {MARKER}"
    raise ArchiveError(
        f"archive {place.settings.url}: this is not the archive of {data}: {there}; expected is the id {known.id}. "
        f"{WHAT_TO_DO}"
    )


def _mounted(place: Place) -> None:
    mount_point = place.settings.mount_point
    if mount_point is not None and not os.path.ismount(mount_point):
        raise ArchiveError(f"{mount_point}: nothing is mounted there (mount_point of archive.yaml). Mount it")


def _marker(place: Place) -> ArchiveId | None:
    if not place.exists(MARKER):
        return None
    with place.opened(MARKER) as file:
        content = file.read(LONGEST_BYTES)
    try:
        return document_in(ArchiveId, content, Path(MARKER))
    except RecordError as error:
        raise ArchiveError(
            f"archive {place.settings.url}: {MARKER} is damaged. Restore it from a copy of the archive, or copy the "
            "file of this name from the data folder"
        ) from error


def _known(data: Path) -> ArchiveId | None:
    """Return the marker that a data folder has noted; None where it has noted none."""
    path = data / MARKER
    return read_document(ArchiveId, path) if path.exists() else None


def _made(data: Path, place: Place) -> ArchiveId:
    """Put a marker into an archive that has none; return what is read back, which another bench may have put."""
    marker = ArchiveId(id=uuid.uuid4().hex, made=now_text())
    with tempfile.TemporaryDirectory(prefix=".archiving-", dir=data) as scratch:
        local = Path(scratch) / MARKER
        local.write_bytes(_content(marker))
        place.put(local, MARKER, f"{Chain(data).id}/{MARKER}")
    found = _marker(place)
    if found is None:
        raise ArchiveError(f"archive {place.settings.url}: {MARKER} was written and is not there. Check the storage")
    return found


def _note(data: Path, marker: ArchiveId) -> None:
    write_atomic(data / MARKER, _content(marker))


def _content(marker: ArchiveId) -> bytes:
    return json.dumps(plain(marker)).encode() + b"\n"


def _set_aside(data: Path) -> str:
    """Give the note of an earlier archive another name, by which it is kept; return it, '' where there is no note."""
    if not (data / NOTE).exists():
        return ""
    aside = f"archive-until-{WALL_CLOCK.now().strftime('%Y%m%dT%H%M%S.%fZ')}.jsonl"
    try:
        (data / NOTE).rename(data / aside)
    except OSError as error:
        raise refused(data / NOTE, error) from error
    return aside
