"""The service's own place on this computer: a folder that no other user can read, write or lock anything in.

Here stands what must not be in reach of whoever may write to a data folder, as the lock of a bench. The first that
applies: `$LOSTMOTION_STATE`, `$STATE_DIRECTORY` (systemd gives it to a service with `StateDirectory=lostmotion`),
`$XDG_STATE_HOME/lostmotion`, `/var/lib/lostmotion` for root, `~/.local/state/lostmotion`.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from station.errors import StationError

PLACE = "LOSTMOTION_STATE"
"""Environment variable that names the folder; for tests, and for services without a home."""

SERVICE = Path("/var/lib/lostmotion")
OWN_FOLDER = 0o700
OF_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def own_place() -> Path:
    """Return the folder; it may not be there yet. StationError where this user has no home to have it in."""
    named = os.environ.get(PLACE) or os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if named:
        return Path(named)
    home = os.environ.get("XDG_STATE_HOME")
    if home:
        return Path(home) / "lostmotion"
    if os.geteuid() == 0:
        return SERVICE
    try:
        return Path.home() / ".local" / "state" / "lostmotion"
    except RuntimeError as error:
        raise StationError(
            f"user {os.geteuid()} has no home folder. Name a folder for this service with the environment variable "
            f"{PLACE}"
        ) from error


def own_folder(name: str) -> Path:
    """Return a folder of the place, made with mode 0700 where it is missing.

    Raises:
        StationError: it cannot be made, belongs to another user, or others may enter it.

    """
    folder = own_place() / name
    try:
        if not folder.is_dir():
            folder.parent.mkdir(mode=OWN_FOLDER, parents=True, exist_ok=True)
            folder.mkdir(mode=OWN_FOLDER, exist_ok=True)
        found = folder.stat()
    except OSError as error:
        raise StationError(
            f"{folder}: this folder cannot be made: {error.strerror}. Give this user write permission, or name another "
            f"folder with the environment variable {PLACE}"
        ) from error
    user, mode = os.geteuid(), stat.S_IMODE(found.st_mode)
    if found.st_uid != user:
        what = f"this folder belongs to user {found.st_uid}, and the program runs as user {user}"
        raise StationError(f"{folder}: {what}. Run the program as the owner of the folder")
    if mode & OF_OTHERS:
        raise StationError(
            f"{folder}: other users can enter this folder (mode {mode:04o}; allowed is {OWN_FOLDER:04o}). "
            f"Run: chmod 700 {folder}"
        )
    return folder
