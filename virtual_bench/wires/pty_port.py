"""A serial port of the virtual bench: one end of a pseudo-terminal, whose other end a controller opens like any port.

There is no cable: bytes arrive at once, whatever the baud rate. The port exists for as long as the bench; a controller
may leave and come back.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from collections.abc import Callable
from pathlib import Path

READ_SIZE = 4096
BACKLOG_BYTES = 64 * 1024  # a controller that reads nothing loses bytes beyond this, as on a real line


class PtyPort:
    """A pseudo-terminal; `on_bytes` gets what the controller writes. `link` is another name for it, if wanted."""

    def __init__(self, on_bytes: Callable[[bytes], None], link: str = "") -> None:
        self._on_bytes = on_bytes
        self._link = Path(link) if link else None
        self._ours = self._theirs = -1
        self._waiting = bytearray()
        self.path = ""

    def open(self) -> str:
        """Make the port and return its path; raises `OSError` when it or its other name cannot be had."""
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.path = os.ttyname(self._theirs)
        if self._link is not None:
            self._make_link(self._link)
            self.path = str(self._link)
        asyncio.get_running_loop().add_reader(self._ours, self._read)
        return self.path

    def _make_link(self, link: Path) -> None:
        if link.parts[:2] == ("/", "dev"):
            self.close(keep_link=True)
            raise OSError(f"serial port {link}: names in /dev are for real devices; choose a path elsewhere")
        if link.is_symlink() and not link.exists():
            link.unlink()  # left behind by a bench that was killed
        try:
            link.symlink_to(self.path)
        except OSError as error:
            self.close(keep_link=True)
            raise OSError(f"serial port {link}: {error.strerror}; choose a path that does not exist yet") from error

    def close(self, *, keep_link: bool = False) -> None:
        """Pull the cable: the controller's port is hung up. Safe to call twice."""
        if self._ours < 0:
            return
        with contextlib.suppress(RuntimeError):
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._ours)
            loop.remove_writer(self._ours)
        os.close(self._ours)
        os.close(self._theirs)
        self._ours = self._theirs = -1
        if self._link is not None and not keep_link:
            self._link.unlink(missing_ok=True)

    def write(self, data: bytes) -> bool:
        """Send to the controller, later where it is slow to read; False when bytes were lost."""
        if self._ours < 0:
            return False
        if self._waiting:
            if len(self._waiting) > BACKLOG_BYTES:
                return False
            self._waiting += data
            return True
        sent = self._write_some(data)
        if sent < len(data):
            self._waiting += data[sent:]
            asyncio.get_running_loop().add_writer(self._ours, self._write_rest)
        return True

    def _write_some(self, data: bytes | bytearray) -> int:
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0

    def _write_rest(self) -> None:
        del self._waiting[: self._write_some(self._waiting)]
        if not self._waiting:
            asyncio.get_running_loop().remove_writer(self._ours)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._on_bytes(os.read(self._ours, READ_SIZE))
