"""Which folders of a data folder are runs, also where nobody can look into one of them."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

from station.documents.manifest import MANIFEST
from station.there import is_there

STAMP = "%Y%m%dT%H%M%S.%f"


def moment_of(name: str) -> datetime | None:
    """Return the moment that a run's folder is named by; None for a folder that is named in another way."""
    try:
        return datetime.strptime(name.partition("Z-")[0], STAMP).replace(tzinfo=UTC)
    except ValueError:
        return None


def is_text(name: str) -> bool:
    """Whether the name of a folder is text, which a line can hold and a terminal shows as it is.

    On the disk it may be any bytes: some would end the line, turn its direction, or write over what stands above.
    """
    return name.isprintable()  # bytes that are no UTF-8 are halves of characters, which are not


def is_run(folder: Path) -> bool:
    """Say whether a folder is a run: it has a run.json; where nobody can look into it, its name says it.

    What cannot be read is then named by who reads it. It is not passed over: the unit in it may have failed.
    """
    there = is_there(folder / MANIFEST)
    return moment_of(folder.name) is not None if there is None else there


def runs_there(data: Path) -> list[str]:
    """Return the names of all folders that are runs, in order; none where the data folder cannot be listed."""
    try:
        names = sorted(os.listdir(data))  # noqa: PTH208 - names are wanted
    except OSError:
        return []
    return [name for name in names if is_run(data / name)]
