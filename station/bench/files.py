"""Files as they were read once, and files that are read when they are asked for: profiles come from either."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from recipes import read_bytes


class File(Protocol):
    """A file that was read: where it is, and its bytes."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def content(self) -> bytes:
        """Its bytes."""


@dataclass(frozen=True)
class FileAt:
    """A file that is read when it is asked for; RecipeError when it cannot be."""

    path: Path

    @property
    def content(self) -> bytes:
        """Its bytes, as they are now."""
        return read_bytes(self.path)
