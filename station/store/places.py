"""Where the store of a data folder is: a URL that was named, else a SQLite file beside the runs.

SQLite keeps its writers apart by locks and a file that all of them map into memory: on a network mount neither can be
relied on, so there the file lies in the service's own place.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from station.errors import StationError
from station.own_place import own_folder
from station.wall_clock import WALL_CLOCK

STORE_URL = "LOSTMOTION_STORE"
"""Environment variable that names the database; `--store` sets it for one command."""

FILE = "store.sqlite3"
BESIDE = ("-wal", "-shm", "")
"""Endings of what SQLite keeps beside a file, and of the file itself: it goes last, the others are of no use alone."""

OWN_STORES = "stores"
SQLITE, POSTGRESQL = "sqlite:///", "postgresql"
MOUNTS = Path("/proc/self/mountinfo")

NETWORK = frozenset({
    "nfs", "nfs4", "cifs", "smb3", "smbfs", "9p", "afs", "ceph", "coda", "glusterfs", "gpfs", "lustre", "ncpfs",
    "ocfs2",
    "orangefs", "virtiofs", "fuse.sshfs", "fuse.glusterfs", "fuse.ceph", "fuse.rclone", "fuse.s3fs", "davfs",
})  # fmt: skip
"""Types of file system of other computers, as the kernel names them."""


@dataclass(frozen=True)
class StorePlace:
    """URL of the database, and what is to be said about it ('' where it is where everybody expects it).

    own: a file that this program alone made, for one data folder.
    """

    url: str
    note: str = ""
    own: bool = False

    @property
    def shown(self) -> str:
        """The URL without a password."""
        head, at, tail = self.url.rpartition("@")
        scheme, _, who = head.partition("://")
        return f"{scheme}://{who.partition(':')[0]}@{tail}" if at and "://" in head else self.url


def store_place(data: Path) -> StorePlace:
    """Return where the store of a data folder is.

    Raises:
        StationError: the URL that was named cannot be used.

    """
    named = os.environ.get(STORE_URL)
    if named:
        return StorePlace(_checked(named))
    kind = network_type(data)
    if not kind and os.access(data, os.W_OK):
        return StorePlace(f"{SQLITE}{data.resolve() / FILE}", own=True)
    name = hashlib.sha256(str(data.resolve()).encode()).hexdigest()[:32]
    own = own_folder(OWN_STORES) / f"{name}.sqlite3"
    why = f"is on a network mount ({kind})" if kind else "cannot be written"
    return StorePlace(f"{SQLITE}{own}", f"{data}: {why}, so its store is {own}", own=True)


def set_aside(place: StorePlace) -> Path:
    """Give a store's own file, with what SQLite keeps beside it, another name; return it. OSError where refused."""
    file = Path(place.url.removeprefix(SQLITE))
    aside = file.with_name(f"{file.name}.damaged-{WALL_CLOCK.now().strftime('%Y%m%dT%H%M%S.%fZ')}")
    for end in BESIDE:
        with suppress(FileNotFoundError):
            os.rename(f"{file}{end}", f"{aside}{end}")  # noqa: PTH104 - an ending is no part of a path
    return aside


def store_is_there(data: Path) -> bool:
    """Whether a data folder has a store: a file that is there, or a database that was named.

    Raises:
        StationError: the URL that was named cannot be used.

    """
    url = store_place(data).url
    return not url.startswith(SQLITE) or Path(url.removeprefix(SQLITE)).is_file()


def network_type(path: Path, mounts: Path = MOUNTS) -> str:
    """Return the type of the network mount that a path lies on; '' for a local disk, or where nobody says it."""
    try:
        text = os.fsdecode(mounts.read_bytes())
    except OSError:
        return ""
    there = path.resolve().parts
    kind = next((kind for point, kind in _mounted(text) if there[: len(point)] == point), "")
    return kind if kind in NETWORK else ""


@lru_cache(maxsize=4)
def _mounted(text: str) -> list[tuple[tuple[str, ...], str]]:
    """Return the parts of the path, and the type, of every mount; of two, the one that covers the other stands first.

    On one point the later one covers. Mounts are asked for at every look, and seldom change.
    """
    halves = (line.partition(" - ") for line in reversed(text.splitlines()))
    found = [(_point(left.split()[4]).parts, right.split()[0]) for left, _, right in halves if right]
    return sorted(found, key=lambda one: len(one[0]), reverse=True)


def _point(written: str) -> Path:
    # Escaped are blanks and the like alone: all other bytes of a name stand as they are.
    return Path(os.fsdecode(os.fsencode(written).decode("unicode_escape").encode("latin-1")))


def _checked(url: str) -> str:
    if url.startswith(SQLITE):
        name = url.removeprefix(SQLITE)
        if name in {"", ":memory:"}:
            raise StationError(f"--store {url}: names no file. Write {SQLITE}FILE, or leave the option out")
        file = Path(name).absolute()
        kind = network_type(file.parent)
        if kind:
            raise StationError(
                f"--store {url}: this file is on a network drive ({kind}), where SQLite cannot lock it safely. Name a "
                "file on a local disk, or a PostgreSQL database: postgresql://USER@HOST/NAME"
            )
        return f"{SQLITE}{file}"
    scheme, found, rest = url.partition("://")
    if not found or scheme not in (POSTGRESQL, f"{POSTGRESQL}+psycopg"):
        raise StationError(
            f"--store: found {StorePlace(url).shown!r}; allowed are sqlite:///FILE and postgresql://USER@HOST/NAME"
        )
    return f"{POSTGRESQL}+psycopg://{rest}"
