"""Whether something is in a place: yes, no, or nobody can tell, because the disk or the rights of this user refuse it.

`Path.is_file` and its like raise where nobody can tell, so that one unreadable folder would end what looks at all of
them; and a plain `False` would pass a run over that is there.
"""

from __future__ import annotations

import os
import stat
from errno import EBADF, ELOOP, ENAMETOOLONG, ENOENT, ENOTDIR
from pathlib import Path

NOT_THERE = frozenset({ENOENT, ENOTDIR, EBADF, ELOOP, ENAMETOOLONG})
"""What a file system answers of a place with nothing in it, or of a name that nothing can have."""


def is_there(path: Path) -> bool | None:
    """Return whether something is in a place, of whatever kind; None where nobody can tell."""
    kind = _kind(path)
    return None if kind is None else kind > 0


def is_folder(path: Path) -> bool | None:
    """Return whether a folder is in a place; None where nobody can tell."""
    kind = _kind(path)
    return None if kind is None else kind == stat.S_IFDIR


def is_file(path: Path) -> bool | None:
    """Return whether a file is in a place, and no pipe or device; None where nobody can tell."""
    kind = _kind(path)
    return None if kind is None else kind == stat.S_IFREG


def _kind(path: Path) -> int | None:
    """Return the kind of what is in a place, 0 for nothing; None where nobody can tell."""
    try:
        return stat.S_IFMT(os.stat(path).st_mode)  # noqa: PTH116 - the one place that asks, and tests refuse it there
    except ValueError:
        return 0  # no file can have this name
    except OSError as error:
        return 0 if error.errno in NOT_THERE else None
