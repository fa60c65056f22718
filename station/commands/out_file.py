"""Files that a person names with `--out`: none of them is ever written over a record."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import StationError
from station.record.run_index import INDEX
from station.record.run_record import MANIFEST

OF_A_RUN = (MANIFEST, "samples.json")
"""Files that a run's folder has from its start."""


def refuse_records(path: Path) -> None:
    """Refuse a file that would lie in a run's folder, or in place of the index.

    Raises:
        StationError: it would.

    """
    there = path.resolve()
    run = next((folder for folder in there.parents if all((folder / name).is_file() for name in OF_A_RUN)), None)
    if run is not None:
        raise StationError(f"--out {path}: lies in the folder of run {run.name}, which stays as it is. Choose another")
    if there.name == INDEX:
        raise StationError(f"--out {path}: {INDEX} is what vouches for the runs beside it. Choose another name")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Tell what a file or folder of this name was refused for.

    Raises:
        StationError: the folder is not there or read-only, or the disk is full.

    """
    try:
        yield
    except OSError as error:
        raise StationError(f"{path}: cannot be written: {error.strerror or error}. Choose another --out") from error
