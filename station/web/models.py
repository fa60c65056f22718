"""The table of models: by its serial number a unit has a model, a recipe and a bench. A file that Git can keep."""

from __future__ import annotations

import re
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, field_validator

from recipes import RecipeError, load_document
from recipes.text.section import refusal
from station.errors import StationError

FILE = "models.yaml"
SHIPPED = Path(__file__).parent / FILE


class Model(BaseModel):
    """A model of unit: syntax of its serial numbers, recipe, bench (None: the one of the recipe), allowed attempts.

    `unit`: which unit the virtual bench has in place of it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: str = Field(min_length=1, max_length=64)
    serial: str
    recipe: str
    bench: str | None = None
    unit: str | None = None
    attempts: int = Field(default=3, ge=1, le=100)

    @field_validator("serial")
    @classmethod
    def _is_expression(cls, text: str) -> str:
        try:
            re.compile(text)
        except re.error as error:
            raise refusal(text, f"a regular expression: {error}") from error
        return text

    def fits(self, serial: str) -> bool:
        """Say whether a serial number is one of this model."""
        return re.fullmatch(self.serial, serial) is not None


class Models(BaseModel):
    """The file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    models: tuple[Model, ...] = Field(min_length=1)

    def of(self, serial: str) -> Model | None:
        """Return the model of a serial number; None where no row fits."""
        return next((one for one in self.models if one.fits(serial)), None)


def load_models(data: Path, named: Path | None) -> Models:
    """Return the table: the file that was named, the one in the data folder, or the shipped one.

    Raises:
        RecipeError: with all problems of the file.

    """
    there = data / FILE
    return load_document(named or (there if there.is_file() else SHIPPED), Models)


class ModelsFile:
    """The file of the table while a station is served: it is read again when it has changed."""

    def __init__(self, data: Path, named: Path | None) -> None:
        """Keep what the file is now; data, named: as `load_models`."""
        self._data, self._named = data, named
        self._path = named or data / FILE
        self._seen = self._stamp()

    def changed(self) -> Models | None:
        """Return the table where its file has changed since it was read; None where it has not.

        Raises:
            StationError: the file is gone or wrong. It stays refused until it is right: the table of before names
            perhaps another recipe than whoever changed it means.

        """
        now = self._stamp()
        if now == self._seen:
            return None
        if now is None:
            raise StationError(f"{self._path}: the table of models was read at the start and is gone. Put it back.")
        try:
            found = load_models(self._data, self._named)
        except RecipeError as error:
            problems = " ".join(line.strip() for line in str(error).splitlines())
            raise StationError(
                f"{self._path}: the table of models has changed and is wrong. {problems} Correct it, then scan again."
            ) from error
        self._seen = now
        return found

    def _stamp(self) -> tuple[int, int, int] | None:
        """Return what changes with the file; None where there is none."""
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size, found.st_ino
