"""Lines of a scanner on standard input, and what came while nobody waited for one."""

from __future__ import annotations

import os
import select

READ_BYTES = 4096


class Scans:
    """Lines of a scanner on standard input; what ends them is a carriage return, a line feed or both."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._kept = b""

    def next(self) -> str | None:
        """Wait for a line and return it without its end; None when there will be no more."""
        while not any(end in self._kept for end in (b"\r", b"\n")):
            read = os.read(self._handle, READ_BYTES)
            if not read:
                return None
            self._kept += read
        return self._cut()

    def dropped(self) -> list[str]:
        """Return what has come meanwhile, without waiting, and forget it."""
        while select.select([self._handle], [], [], 0.0)[0]:
            read = os.read(self._handle, READ_BYTES)
            if not read:
                break
            self._kept += read
        kept, self._kept = self._kept, b""
        return [text for text in kept.decode(errors="replace").replace("\r", "\n").split("\n") if text.strip()]

    def _cut(self) -> str:
        at = min(place for place in (self._kept.find(b"\r"), self._kept.find(b"\n")) if place >= 0)
        line, self._kept = self._kept[:at], self._kept[at + 1 :]
        if self._kept[:1] == b"\n":
            self._kept = self._kept[1:]
        return line.decode(errors="replace")
