"""Files that a person names: opened only where they are regular files.

A pipe or a device would be waited for, or read without an end. Only what a shell hands over as an open file may be one:
`/dev/stdin`, and the `/dev/fd/63` of a process substitution.
"""

from __future__ import annotations

import os
import stat
from errno import EINVAL, EISDIR
from pathlib import Path
from typing import BinaryIO

HANDED_OVER = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")
KINDS: dict[int, str] = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a disk",
}


def open_regular(path: str | Path) -> BinaryIO:
    """Open a file to read its bytes.

    Raises:
        OSError: it is not there, cannot be read, or is a folder, a pipe or a device; `strerror` says which.
        ValueError: no file can have this name.

    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    kind = stat.S_IFMT(os.fstat(handle).st_mode)
    if kind == stat.S_IFREG or (kind != stat.S_IFDIR and str(path).startswith(HANDED_OVER)):
        os.set_blocking(handle, True)
        return os.fdopen(handle, "rb")
    os.close(handle)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR), str(path))
    raise OSError(EINVAL, f"this is {KINDS.get(kind, 'no file')}, but a file is needed", str(path))
