"""The place of an archive, reached by fsspec: objects are put there whole, read back, listed and opened.

An object is written under a temporary name below `incoming/` and then put in place, so that a reader finds it whole or
not at all, and a writer that was killed leaves nothing that looks like an object.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

from station.archive.settings import S3, ArchiveError, ArchiveSettings
from station.atomic_file import sync_folder
from station.documents.archived import ArchiveObject
from station.records.archive_note import SETTINGS
from station.records.seal import fingerprint

INCOMING = "incoming"
INSTALL = "Install with: pip install 'lostmotion[plant]'"
CHUNK_BYTES = 1 << 20
CONNECT_S, READ_S, TRIES = 5, 60, 3

Options = dict[str, Any]
"""What fsspec opens a place with: each kind of place has options of its own."""


class Place:
    """An open archive."""

    def __init__(self, settings: ArchiveSettings) -> None:
        """Open the place; ArchiveError where a library or a credential is missing."""
        self.settings = settings
        try:
            self.fs: Any = _opened(settings)
        except ImportError as error:
            raise ArchiveError(f"{settings.url}: the libraries for archives are not installed. {INSTALL}") from error

    def path(self, name: str) -> str:
        """Return the whole path of an object, as fsspec has it."""
        return f"{self.settings.root}/{name}"

    def names(self, below: str) -> list[str]:
        """Return the names of all objects below a folder, in order; none where it is not there."""
        with self._told(below):
            root = f"{self.fs._strip_protocol(self.settings.root)}/"  # noqa: SLF001 - as fsspec itself prints paths
            found = self.fs.find(self.path(below))
            return sorted(str(one).removeprefix(root) for one in found)

    def exists(self, name: str) -> bool:
        """Whether there is an object of this name."""
        with self._told(name):
            return bool(self.fs.exists(self.path(name)))

    def sha256(self, name: str) -> str:
        """Return the SHA-256 of an object's bytes, read from the archive."""
        digest = hashlib.sha256()
        with self._told(name), self.opened(name) as file:
            while chunk := file.read(CHUNK_BYTES):
                digest.update(chunk)
        return digest.hexdigest()

    @contextmanager
    def opened(self, name: str) -> Iterator[BinaryIO]:
        """Yield an object to read, at any position."""
        with self._told(name), self.fs.open(self.path(name), "rb") as file:
            yield cast("BinaryIO", file)

    def put(self, local: Path, name: str, temporary: str) -> None:
        """Put a file into the archive, under a temporary name first; what is there under the name is replaced."""
        beside, target = self.path(f"{INCOMING}/{temporary}"), self.path(name)
        with self._told(name):
            if self.settings.scheme == S3:  # which has no folders
                self._upload(local, beside)
                self.fs.fs.copy_file(beside, target)
                self.fs.rm_file(beside)
                return
            for path in (beside, target):
                self.fs.makedirs(path.rpartition("/")[0], exist_ok=True)
            self._upload(local, beside)
            _sync(Path(beside))
            Path(beside).replace(target)
            sync_folder(Path(target).parent)

    def _upload(self, local: Path, path: str) -> None:
        with local.open("rb") as source, self.fs.open(path, "wb") as target:
            shutil.copyfileobj(source, target, CHUNK_BYTES)

    def keep(self, local: Path, name: str, owner: str) -> ArchiveObject:
        """Put a file into the archive unless the same bytes are there, and read it back either way.

        owner: below whose folder of `incoming` it is written first.

        Raises:
            ArchiveError: what is read back are other bytes.

        """
        own = fingerprint(local)
        if not (self.exists(name) and self.sha256(name) == own.sha256):
            self.put(local, name, f"{owner}/{own.sha256}")
            if self.sha256(name) != own.sha256:
                raise ArchiveError(
                    f"archive {self.settings.url}: {name}: reads back differently from what was written. The run does "
                    "not count as archived. Check the storage, then run 'lostmotion archive push' again"
                )
        return ArchiveObject(name=name, sha256=own.sha256, bytes=own.bytes)

    def remove_incoming(self, owner: str) -> int:
        """Remove what a writer of this name left half written; return how many objects that were."""
        left = self.names(f"{INCOMING}/{owner}")
        for name in left:
            with self._told(name):
                self.fs.rm_file(self.path(name))
        return len(left)

    @contextmanager
    def _told(self, name: str) -> Iterator[None]:
        try:
            yield
        except ArchiveError:
            raise
        except FileNotFoundError as error:
            raise ArchiveError(
                f"archive {self.settings.url}: {name}: is missing. Check the url in archive.yaml. 'lostmotion archive "
                "verify' lists all that is missing"
            ) from error
        except OSError as error:
            cause = " ".join(str(error).split())[:300] or type(error).__name__
            raise ArchiveError(
                f"archive {self.settings.url}: cannot be used: {cause}. Check network, address and credentials, "
                "then run the command again. Nothing is lost"
            ) from error


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _opened(settings: ArchiveSettings) -> Any:
    """Return a place as fsspec has it; that of S3 is the client that Arrow brings."""
    if settings.scheme != S3:
        from fsspec.implementations.local import LocalFileSystem  # noqa: PLC0415 - of the extra `plant`

        return LocalFileSystem(skip_instance_cache=True)
    from pyarrow.fs import AwsStandardS3RetryStrategy, S3FileSystem  # noqa: PLC0415 - it loads a library of its own

    from station.archive.s3 import Bucket  # noqa: PLC0415 - of the extra `plant`

    found: Options = {"connect_timeout": CONNECT_S, "request_timeout": READ_S}
    found["retry_strategy"] = AwsStandardS3RetryStrategy(max_attempts=TRIES)
    named = {
        "access_key": settings.key_from,
        "secret_key": settings.secret_from,
        "session_token": settings.token_from,
    }
    found |= {option: _from_variable(variable) for option, variable in named.items() if variable is not None}
    if settings.endpoint is not None:
        scheme, _, host = settings.endpoint.partition("://")
        found |= {"scheme": scheme, "endpoint_override": host.rstrip("/")}
    if settings.region is not None or settings.endpoint is not None:
        found["region"] = settings.region or "us-east-1"
    return Bucket(S3FileSystem(**found), skip_instance_cache=True)


def _from_variable(variable: str) -> str:
    value = os.environ.get(variable)
    if not value:
        raise ArchiveError(
            f"{SETTINGS}: the environment variable {variable} is not set. Set it for this command or service"
        )
    return value
