"""The file `aqdef.yaml`: the folder that takes AQDEF files, and what one file holds."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from recipes import load_document
from station.errors import StationError

FILE = "aqdef.yaml"
UNIT, HOUR, LOT = "unit", "hour", "lot"


class AqdefSettings(BaseModel):
    """The file.

    `folder`: that takes the files, a whole path, often on a mounted share; it is never made. `mount_point`: nothing is
    written while no share is mounted there, as the files would lie below it. `per`: what a file holds. `lot_units`,
    `lot_silence_h`: units, and hours without one, after which a lot ends that no other unit has ended. `virtual`:
    whether units of the virtual bench are written too, in files of their own.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    folder: str = Field(min_length=1, max_length=4096, pattern="^/[^\0]*$")
    mount_point: str | None = Field(default=None, min_length=2, max_length=4096, pattern="^/[^\0]*$")
    per: Literal["unit", "hour", "lot"]
    lot_units: int = Field(default=100, ge=1, le=10000)
    lot_silence_h: float = Field(default=8.0, ge=0.1, le=720.0)
    virtual: bool = False


def load_aqdef(data: Path) -> AqdefSettings | None:
    """Return the settings of a data folder, None where it has no `aqdef.yaml`: then no files are written.

    Raises:
        RecipeError: with all problems of the file.
        StationError: the folder is the data folder or lies in it, or is not below its mount point.

    """
    file = data / FILE
    if not file.exists():
        return None
    settings = load_document(file, AqdefSettings)
    # by name alone: a share that hangs would keep the server from starting
    folder, runs = (Path(os.path.normpath(one)) for one in (settings.folder, data.absolute()))
    if folder.is_relative_to(runs):
        raise StationError(f"{file}: folder: found {folder}, which is in the data folder. Name a folder outside {runs}")
    if settings.mount_point is not None and not folder.is_relative_to(os.path.normpath(settings.mount_point)):
        raise StationError(
            f"{file}: mount_point: found {settings.mount_point}, but the folder {folder} is not inside it. Name the "
            "folder where the network drive is mounted, or delete mount_point"
        )
    return settings
