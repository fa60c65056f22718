"""The file `archive.yaml`: where the archive of a data folder is, and how it is reached.

url: s3://plant-archive/lostmotion        # or a folder: /mnt/archive
endpoint: https://s3.plant.example:9000   # only where it is not Amazon's
key_from: LOSTMOTION_ARCHIVE_KEY          # environment variables that hold the credentials; never these themselves
secret_from: LOSTMOTION_ARCHIVE_SECRET
"""

from __future__ import annotations

import ipaddress
import os
import re
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from recipes import load_document
from recipes.text.section import refusal
from station.errors import StationError
from station.records.archive_note import SETTINGS

S3 = "s3"
VARIABLE = re.compile(r"[A-Z][A-Z0-9_]{0,99}")
ACCESS_KEY = re.compile(r"(AKIA|ASIA)[A-Z0-9]{12,}")
"""How Amazon's access keys look, which would pass for the name of a variable."""

EXAMPLE = "'url: s3://BUCKET/FOLDER' or 'url: /FOLDER'"


class ArchiveError(StationError):
    """The archive cannot be used, or an object in it is not what it should be. No run and no verdict depends on it."""


class ArchiveSettings(BaseModel):
    """The file.

    `url`: s3://BUCKET/FOLDER, or the path of a folder. `endpoint`, `region`: of an S3 service. `key_from`,
    `secret_from`, `token_from`: names of environment variables; without them the service's own ways count (a role, the
    files of its client). `mount_point`: a folder is not used while nothing is mounted there. `runs_per_object`: most
    runs in one object.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str
    endpoint: str | None = None
    region: str | None = None
    key_from: str | None = None
    secret_from: str | None = None
    token_from: str | None = None
    mount_point: Annotated[str | None, Field(min_length=2, max_length=4096, pattern="^/[^\0]*$")] = None
    runs_per_object: Annotated[int, Field(ge=1, le=500)] = 60

    @property
    def scheme(self) -> str:
        """`s3`, or `file` for a folder."""
        return S3 if self.url.startswith(f"{S3}://") else "file"

    @property
    def root(self) -> str:
        """Bucket and folder, or the path of the folder, without a slash at its end."""
        return self.url.removeprefix(f"{S3}://").removeprefix("file://").rstrip("/")

    @field_validator("url")
    @classmethod
    def _is_place(cls, text: str) -> str:
        parts = urlsplit(text)
        allowed = "s3://BUCKET/FOLDER, or the whole path of a folder, such as /mnt/archive"
        if "@" in parts.netloc:
            raise refusal(
                "a URL with credentials",
                allowed,
                "Name the environment variables that hold them with key_from and secret_from.",
            )
        is_folder = text.startswith(("/", "file:///")) and len(text.rstrip("/")) > 1
        if not is_folder and not (parts.scheme == S3 and parts.netloc and not parts.query):
            raise refusal(f"the url '{text}'", allowed)
        return text

    @field_validator("endpoint")
    @classmethod
    def _is_safe(cls, text: str | None) -> str | None:
        if text is None:
            return None
        parts = urlsplit(text)
        if parts.username is not None or parts.scheme not in ("http", "https") or not parts.hostname:
            raise refusal(
                "an endpoint that is not a URL, or that contains credentials", "https://HOST or https://HOST:PORT"
            )
        if parts.scheme == "http" and not _loopback(parts.hostname):
            raise refusal(
                f"'{text}'",
                "https, and http on this computer alone",
                "Without https, others on the network can read records and keys.",
            )
        return text

    @field_validator("key_from", "secret_from", "token_from")
    @classmethod
    def _is_variable(cls, text: str | None) -> str | None:
        if text is not None and (VARIABLE.fullmatch(text) is None or ACCESS_KEY.fullmatch(text)):
            raise refusal(
                "a text that is not the name of an environment variable",
                "such as LOSTMOTION_ARCHIVE_SECRET",
                "The file holds no secret: set the variable for the service, and name it here.",
            )
        return text

    @model_validator(mode="after")
    def _fits(self) -> ArchiveSettings:
        of_s3 = ("endpoint", "region", "key_from", "secret_from", "token_from")
        there = [name for name in of_s3 if getattr(self, name) is not None]
        if self.scheme != S3 and there:
            raise refusal(
                f"{there[0]} with a url that is a folder",
                "only with a url that begins with s3://",
                "Remove the entry.",
                at=there[0],
            )
        if self.mount_point is not None:
            if self.scheme == S3:
                raise refusal(
                    "mount_point with a url that begins with s3://",
                    "only with a url that is a folder",
                    "Remove the entry.",
                    at="mount_point",
                )
            if not Path(os.path.normpath(self.root)).is_relative_to(os.path.normpath(self.mount_point)):
                raise refusal(
                    f"mount_point {self.mount_point}, and the url {self.url} is not inside it",
                    "the folder where the network drive is mounted",
                    "Name that folder, or delete mount_point.",
                    at="mount_point",
                )
        if (self.key_from is None) != (self.secret_from is None):
            raise refusal("one of key_from and secret_from", "both or none", "Add the other one.", at="key_from")
        return self


def _loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def load_settings(data: Path) -> ArchiveSettings:
    """Return where the archive of a data folder is.

    Raises:
        ArchiveError: the folder has no such file, or the archive lies in the data folder itself.
        RecipeError: with all problems of the file.

    """
    file = data / SETTINGS
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    if not file.is_file():
        raise ArchiveError(f"{file}: does not exist. Make this file with one line, where the archive is: {EXAMPLE}")
    settings = load_document(file, ArchiveSettings)
    if settings.scheme != S3 and Path(settings.root).resolve().is_relative_to(data.resolve()):
        raise ArchiveError(f"{file}: the url {settings.url} is inside the data folder. Choose a place on another disk")
    return settings
