"""A data folder as one file, and back: runs, recoveries, jogs, and the station's own database, each with its hash.

The store is left out, for it is made again from the runs, and so is the private key by which the bench signs: it stays
where it is. Other keys and secrets of the folder are in it, such as that of the OPC UA server, so nobody but its owner
may read the file. It is a tar archive with `backup.json` as its last member, which lists all others; one without it
was cut short.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import secrets
import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from station.atomic_file import read_file, refused, sync_folder
from station.documents.entries import plain
from station.documents.reading import document_in
from station.documents.signs import in_signs
from station.errors import RecordError, StationError
from station.records.chain.chain_file import CHAIN, Chain
from station.records.chain.entries import CREATED, entry_of
from station.records.data_folder import Store
from station.records.run_record import NOT_CONCLUDED, RECORDING, RunRecord
from station.there import is_file, is_there
from station.wall_clock import now_text

LIST = "backup.json"
FORMAT = 1
DATABASES = ("station.sqlite3",)
"""Databases that cannot be made again: copied as they are between two changes."""

LEFT_OUT = ("store.sqlite3",)
MADE_AGAIN = (".lock", "-wal", "-shm")
"""Files of the folder that are made again: the store, locks, and what SQLite keeps beside its databases."""

COPY_BYTES = 1 << 20
EVERYBODY, PRIVATE, READABLE = 0o004, 0o600, 0o644
"""Modes: that everybody may read; a file for its owner alone; one that everybody reads."""


@dataclass(frozen=True)
class Kept:
    """What a backup holds: number of files, their bytes, and when it was made.

    reaches: the newest run that the chain in it begins, '' where it begins none; a run that was begun later is not in
    it.
    """

    files: int
    bytes: int
    made: str
    reaches: str


@dataclass(frozen=True, kw_only=True)
class KeptFile:
    """A file of a data folder in a backup; private: not everybody could read it, so its owner alone shall.

    A backup of an older version does not say it: any of its files may hold a secret.
    """

    path: str
    bytes: int
    sha256: str
    private: bool = True


@dataclass(frozen=True, kw_only=True)
class FileList:
    """The end of a backup: which files it holds, by which it is known to be whole."""

    format: int
    made: str
    files: tuple[KeptFile, ...] = ()


def back_up(data: Path, file: Path, told: Callable[[int], None] = lambda _: None) -> Kept:
    """Write a data folder into a file that is not there yet; `told` hears the number of files so far.

    Raises:
        StationError: there is no such folder, a run, recovery or jog is on, or the file is there already.
        RecordError: something cannot be read or written; then no file is left behind.

    """
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    if file.exists():
        raise StationError(f"{file}: this file exists already and is never overwritten. Choose another name")
    if file.resolve().is_relative_to(data.resolve()):
        raise StationError(f"{file}: the backup would be inside the data folder. Choose a place on another disk")
    _refuse_while_on(data)
    part = file.with_name(f".{file.name}.{secrets.token_hex(4)}.part")  # two that begin at once have one each
    made = False
    try:
        with _for_the_owner_alone(part) as stream:
            made = True
            kept = _written(data, stream, told)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(file)
        sync_folder(file.parent)
    except OSError as error:
        raise refused(file, error) from error
    finally:
        if made:
            part.unlink(missing_ok=True)
    return kept


def below(data: Path) -> list[Path]:
    """Return the folders below a data folder that have a chain of their own: recoveries and jogs."""
    names = sorted(os.listdir(data))  # noqa: PTH208 - names are wanted
    return [data / name for name in names if is_there(data / name / CHAIN)]


def not_concluded(data: Path) -> list[str]:
    """Return the runs that were left behind and that nobody has concluded, oldest first.

    Every run is asked: one that was left behind may be of last year, and all of its files are read in a moment anyway.
    """
    return [run.id for run in Store(data).runs() if _state(run) == NOT_CONCLUDED]


def _refuse_while_on(data: Path) -> None:
    """Refuse while a run, a recovery or a jog is on; what was left behind is kept as it is.

    A run that cannot be concluded, as one whose samples are gone, must not keep all others out of a backup.
    """
    for run in Store(data).newest_first():
        if _state(run) == RECORDING:
            raise StationError(f"run {run.id} is in progress. End it, or wait for its end")
    for folder in below(data):
        for record in Store(folder).newest_first():
            if _state(record) == RECORDING:
                raise StationError(
                    f"{folder.name}/{record.id}: this recovery or jog is in progress. End it, or wait for its end"
                )


def _state(record: RunRecord) -> str:
    """Return the state of a record, '' of one that cannot be read: it is kept as it is, and `verify` names it."""
    try:
        return record.state()
    except StationError:
        return ""


def _written(data: Path, stream: Any, told: Callable[[int], None]) -> Kept:
    made, rows = now_text(), []
    # First of all: what is added behind a chain meanwhile is of records that are not in the list below.
    chains = {
        folder / CHAIN: Chain(folder).content
        for folder in (data, *below(data))
        if is_there(folder / CHAIN) is not False
    }
    paths = list(_files(data))
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as archive:
        rows += [_add(archive, data, path, content) for path, content in chains.items()]
        for path in paths:
            name = path.relative_to(data).as_posix()
            if path not in chains:
                rows.append(_add(archive, data, path, _database(path) if name in DATABASES else read_file(path, None)))
                told(len(rows))
        listed = FileList(format=FORMAT, made=made, files=tuple(rows))
        content = json.dumps(plain(listed), ensure_ascii=False).encode()
        _put(archive, LIST, content)
    return Kept(len(rows), sum(row.bytes for row in rows), made, _newest_in(chains.get(data / CHAIN, b"")))


def _newest_in(content: bytes) -> str:
    """Return the run that the bytes of a chain begin last."""
    entries = (entry_of(line) for line in reversed(content.split(b"\n")[:-1]))
    begun = (one for one in entries if one is not None and one.kind == CREATED and one.signed)
    return next((str(one.fields["run"]) for one in begun), "")


def _unread(error: OSError) -> None:
    """Refuse a folder that cannot be listed: a backup without it would be none."""
    raise refused(Path(error.filename), error, "read") from error


def _files(data: Path) -> Iterator[Path]:
    for folder, folders, names in os.walk(data, onerror=_unread):
        folders.sort()
        for name in folders:  # a linked one is not walked into, and would be left out without a word
            if _is_link(Path(folder) / name):
                raise _no_file(Path(folder) / name)
        for name in sorted(names):
            path = Path(folder) / name
            at_top = Path(folder) == data
            shown = os.fsencode(path).decode("utf-8", "backslashreplace")
            if shown != str(path):
                raise RecordError(f"{in_signs(shown)}: this name is no UTF-8 text. Give the file another name")
            if at_top and (name in LEFT_OUT or name.endswith(MADE_AGAIN)):
                continue
            if _is_link(path) or is_file(path) is False:
                raise _no_file(path)
            yield path


def _is_link(path: Path) -> bool:
    try:
        return path.is_symlink()
    except OSError as error:
        raise refused(path, error, "read") from error


def _no_file(path: Path) -> RecordError:
    return RecordError(
        f"{path}: this is a link or a device. A backup has only files and folders. Put the folder or file in the place "
        "of the link, or move it out of the data folder"
    )


def _database(path: Path) -> bytes:
    """Return a database as it is between two changes, whoever has it open."""
    try:
        with (
            closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as there,
            closing(sqlite3.connect(":memory:")) as copy,
        ):
            there.backup(copy)
            return bytes(copy.serialize())
    except sqlite3.DatabaseError as error:
        raise RecordError(
            f"{path}: cannot be read as a database: {error}. Restore this file from an earlier backup, or move it out "
            "of the data folder"
        ) from error


def _for_the_owner_alone(path: Path) -> Any:
    """Open a new file that nobody else may read: keys and secrets of the data folder are in a backup."""
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, PRIVATE), "wb")


def _add(archive: tarfile.TarFile, data: Path, path: Path, content: bytes) -> KeptFile:
    name = path.relative_to(data).as_posix()
    _put(archive, name, content)
    private = name in DATABASES or not path.stat().st_mode & EVERYBODY
    return KeptFile(path=name, bytes=len(content), sha256=hashlib.sha256(content).hexdigest(), private=private)


def _put(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = len(content), PRIVATE
    archive.addfile(entry, io.BytesIO(content))


def restore(file: Path, data: Path) -> Kept:
    """Make a data folder of a backup, all of it or nothing; the folder must not be there, or be empty.

    Raises:
        StationError: the folder holds something.
        RecordError: the file is no backup, was cut short or changed, or the folder cannot be written.

    """
    if data.exists() and (not data.is_dir() or any(data.iterdir())):
        raise StationError(f"--data {data}: this folder is not empty, and nothing is overwritten. Name a new folder")
    data.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{data.name}.", dir=data.parent))
    try:
        kept = _read(file, part)
        if data.exists():
            data.rmdir()
        part.chmod(0o755)
        part.replace(data)
        sync_folder(data.parent)
    except OSError as error:
        raise refused(data, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return kept


def backed_up(file: Path) -> dict[str, str]:
    """Return the SHA-256 of every file in a backup by its path in the data folder, each computed from its content.

    Raises:
        RecordError: as `restore`.

    """
    return {name: sha256 for name, (_, sha256) in _looked_through(file, None)[0].items()}


def _read(file: Path, into: Path) -> Kept:
    found, made = _looked_through(file, into)
    chain = Chain(into).content if CHAIN in found else b""
    return Kept(len(found), sum(size for size, _ in found.values()), made, _newest_in(chain))


def _looked_through(file: Path, into: Path | None) -> tuple[dict[str, tuple[int, str]], str]:
    """Return size and SHA-256 of every file of a whole backup, and when it was made; into: where they are written."""
    found: dict[str, tuple[int, str]] = {}
    listed: FileList | None = None
    try:
        with tarfile.open(file, mode="r:") as archive:
            for entry in archive:
                content = archive.extractfile(entry)
                if content is None or listed is not None:
                    raise RecordError(
                        f"{file}: this file is not a backup: it has the strange entry {entry.name}. Name a file that "
                        "'lostmotion backup' wrote"
                    )
                if entry.name == LIST:
                    listed = document_in(FileList, content.read(), file / LIST)
                    continue
                found[entry.name] = _extracted(file, entry.name, content, into)
    except (tarfile.TarError, EOFError, ValueError) as error:
        raise RecordError(f"{file}: cannot be read as a backup: {error}. Name another backup file") from error
    except OSError as error:
        raise refused(file, error, "read") from error
    if listed is None:
        raise RecordError(f"{file}: this backup was cut short: it has no {LIST} at its end. Name another backup file")
    if listed.format != FORMAT:
        raise RecordError(
            f"{file}: this backup has format {listed.format}; this program reads format {FORMAT}. Use a newer "
            "lostmotion"
        )
    wanted = {row.path: (row.bytes, row.sha256) for row in listed.files}
    wrong = sorted(name for name in {*wanted, *found} if wanted.get(name) != found.get(name))
    if wrong:
        raise RecordError(
            f"{file}: {len(wrong)} files in this backup have changed since it was made, such as {wrong[0]}. Name "
            "another backup file"
        )
    if into is not None:
        _open_to_others(into, listed)
    return found, listed.made


def _open_to_others(into: Path, listed: FileList) -> None:
    """Let everybody read what was not private."""
    for row in listed.files:
        (into / row.path).chmod(PRIVATE if row.private or row.path in DATABASES else READABLE)


def _extracted(file: Path, name: str, content: Any, into: Path | None) -> tuple[int, str]:
    pure = PurePosixPath(name)
    if pure.is_absolute() or ".." in pure.parts or not pure.parts:
        raise RecordError(
            f"{file}: this file is not a backup of this program: {name!r} would be written outside the data folder. "
            "Name a file that 'lostmotion backup' wrote"
        )
    size, digest = 0, hashlib.sha256()
    with ExitStack() as opened:
        out = None if into is None else opened.enter_context(_made(into.joinpath(*pure.parts)))
        while block := content.read(COPY_BYTES):
            digest.update(block)
            size += len(block)
            if out is not None:
                out.write(block)
        if out is not None:
            out.flush()
            os.fsync(out.fileno())
    if into is not None:
        into.joinpath(*pure.parts).chmod(PRIVATE)
    return size, digest.hexdigest()


def _made(path: Path) -> Any:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("xb")
