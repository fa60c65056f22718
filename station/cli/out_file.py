"""Files that a person names with `--out`, `--page` or `--html`: none of them is ever written over a record."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import StationError
from station.records.chain.chain_file import CHAIN
from station.records.chain.old_index import INDEX
from station.records.run_record import MANIFEST

OF_A_RUN = (MANIFEST, "samples.json")
"""Files that a run's folder has from its start."""


def refuse_records(path: Path, option: str = "--out") -> None:
    """Refuse a file that would lie in a run's folder, or in place of the index; option: what named it.

    Raises:
        StationError: it would.

    """
    there = path.resolve()
    run = next((folder for folder in there.parents if all((folder / name).is_file() for name in OF_A_RUN)), None)
    if run is not None:
        raise StationError(
            f"{option} {path}: lies in the folder of run {run.name}, where no file may be added or changed. "
            "Choose another folder"
        )
    if there.name in (CHAIN, INDEX):
        raise StationError(
            f"{option} {path}: a file of this name protects the runs in this folder against change. Choose another name"
        )


def refuse_early(path: Path | None, option: str) -> None:
    """Refuse a file that could not be written at the end, before what takes minutes begins; None is no file.

    Raises:
        StationError: it would lie in a record, or its folder is not there.

    """
    if path is None:
        return
    refuse_records(path, option)
    if not path.parent.is_dir():
        raise StationError(
            f"{option} {path}: there is no folder {path.parent}. Make this folder, or choose another one"
        )


@contextmanager
def writing(path: Path, option: str = "--out") -> Iterator[None]:
    """Tell what a file or folder of this name was refused for.

    Raises:
        StationError: the folder is not there or read-only, or the disk is full.

    """
    try:
        yield
    except OSError as error:
        raise StationError(
            f"file {path} cannot be written: {error.strerror or error}. Choose another place with {option}"
        ) from error
