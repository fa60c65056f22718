"""Files that a person names with `--out`, `--page` or `--html`: none is ever written over a record or a data folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import StationError
from station.records.chain.chain_file import CHAIN
from station.records.chain.head import chain_seen_in
from station.records.chain.old_index import INDEX
from station.records.run_folders import is_run, moment_of
from station.records.run_record import MANIFEST
from station.there import is_there

OF_A_RUN = (MANIFEST, "samples.json")
"""Files that a run's folder has from its start."""

RECORDS = ("chain.jsonl", "index.jsonl", "bench-keys.txt", "recipes.jsonl", "archive.jsonl", "archive-id.json")
DATABASES = ("station.sqlite3", "store.sqlite3")
BESIDE_DATABASES = ("-wal", "-shm", "-journal")
LOCKS = (".lock", "station.lock", "opcua.lock", "archive.lock")
LOGS = ("station-run.log", "station-recover.log", "station-jog.log")
SETTINGS = (
    "station.yaml", "labels.yaml", "aqdef.yaml", "mes.yaml", "models.yaml", "opcua.yaml", "retention.yaml",
    "archive.yaml", "certificate.yaml",
)  # fmt: skip
OWN = frozenset((
    *RECORDS, *DATABASES, *(name + end for name in DATABASES for end in BESIDE_DATABASES), *LOCKS, *LOGS, *SETTINGS,
))  # fmt: skip
"""Files of the program in a data folder, by name: to import the modules that write them takes half a second."""

ASIDE = "archive-until-"
"""How the note of an earlier archive begins, as it is kept."""

OWN_FOLDERS = frozenset({"recipes", "recoveries", "jogs", "studies", "reevaluations", "traces", ".fetching", "opcua"})
"""Folders of the program in a data folder, with released recipes, answers and certificates."""


def refuse_records(path: Path, option: str = "--out") -> None:
    """Refuse a file that would lie in a run's folder, or in place of what keeps a data folder; option: what named it.

    Raises:
        StationError: it would.

    """
    there = path.resolve()
    run = next((folder for folder in there.parents if _is_run(folder)), None)
    if run is not None:
        raise StationError(
            f"{option} {path}: lies in the folder of run {run.name}, where no file may be added or changed. "
            "Choose another folder"
        )
    if there.name in (CHAIN, INDEX):
        raise StationError(
            f"{option} {path}: a file of this name protects the runs in this folder against change. Choose another name"
        )
    if _is_own(there):
        raise StationError(
            f"{option} {path}: this name is one of the program's own in a data folder. Choose another name or folder"
        )


def _is_run(folder: Path) -> bool:
    """Whether a folder is a run's, also one that lacks a file."""
    if all(is_there(folder / name) is not False for name in OF_A_RUN):
        return True
    return moment_of(folder.name) is not None and (is_run(folder) or _is_data(folder.parent))


def _is_data(folder: Path) -> bool:
    """Whether runs lie in a folder, or this computer has written some there."""
    chained = any(is_there(folder / name) is not False for name in (CHAIN, INDEX))
    return chained or chain_seen_in(folder) is not None


def _is_own(there: Path) -> bool:
    """Whether a path is what the program keeps in a data folder, or lies in a folder that it keeps there."""
    inside = [below for below in (there, *there.parents) if below.name in OWN_FOLDERS]
    own = there.name in OWN or there.name.startswith(ASIDE)
    return any(_is_data(one.parent) for one in (*inside, *((there,) if own else ())))


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
