"""Which lostmotion this is: what `--version` prints, what a run keeps, and what a stored verdict is compared with."""

from __future__ import annotations

import importlib.metadata


def version() -> str:
    """Return the version that is installed; words where the program runs from its source folder."""
    try:
        return importlib.metadata.version("lostmotion")
    except importlib.metadata.PackageNotFoundError:
        return "from its source folder"
