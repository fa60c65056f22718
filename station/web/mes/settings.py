"""The file `mes.yaml`: where the MES of a plant is, and what is done with a unit while it is away."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator

from recipes import load_document
from recipes.text.section import refusal
from station.errors import StationError

FILE = "mes.yaml"
LEAST_SECRET_BYTES, LONGEST_SECRET_BYTES = 16, 1024
HOLD, UNVERIFIED = "hold", "unverified"


class MesSettings(BaseModel):
    """The file: address and secret of the webhooks, and the plant's choice for the time when the MES is away.

    `secret_file`: key of the signatures; a path beside the file, or a whole one. `when_away`: `hold` measures no unit
    of which the MES has not said that the process step before is passed; `unverified` measures it, and says so in its
    record. `away_after_s`: silence after which the MES is away [s]. `timeout_s`: longest wait for an answer [s].
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str
    secret_file: str
    when_away: Literal["hold", "unverified"]
    away_after_s: float = Field(default=60.0, ge=1.0, le=3600.0)
    timeout_s: float = Field(default=5.0, ge=0.1, le=60.0)

    @field_validator("url")
    @classmethod
    def _is_address(cls, text: str) -> str:
        import httpx  # noqa: PLC0415 - only where there is a MES: it loads a command line of its own

        parts = urlsplit(text)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.username is not None:
            raise refusal(text, "an address that begins with http:// or https://, without a password")
        try:
            httpx.URL(text)
            parts.hostname.encode("idna")
        except (httpx.InvalidURL, UnicodeError) as error:
            raise refusal(text, f"a valid address: {error}") from error
        return text


def load_mes(data: Path) -> MesSettings | None:
    """Return the settings of a data folder, None where it has no `mes.yaml`: then no MES is asked or told.

    Raises:
        RecipeError: with all problems of the file.

    """
    file = data / FILE
    return load_document(file, MesSettings) if file.exists() else None


def read_secret(data: Path, settings: MesSettings) -> bytes:
    """Return the key of the signatures, without blanks around it.

    Raises:
        StationError: the file cannot be read, others than its owner may read it, or it is too short.

    """
    file = data / settings.secret_file
    try:
        with file.open("rb") as opened:
            mode = os.fstat(opened.fileno()).st_mode
            secret = opened.read(LONGEST_SECRET_BYTES + 1).strip()
    except OSError as error:
        raise StationError(
            f"{FILE}: secret_file: {file} cannot be read: {error.strerror}. Make this file, readable for this user only"
        ) from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise StationError(f"{FILE}: secret_file: other users can read {file}. Run: chmod 600 {file}")
    if not LEAST_SECRET_BYTES <= len(secret) <= LONGEST_SECRET_BYTES:
        allowed = f"{LEAST_SECRET_BYTES} to {LONGEST_SECRET_BYTES} bytes"
        raise StationError(f"{FILE}: secret_file: {file} has {len(secret)} bytes; allowed are {allowed}")
    return secret
