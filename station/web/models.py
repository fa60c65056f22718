"""The table of models: by its serial number a unit has a model, a recipe and a bench. A file that Git can keep."""

from __future__ import annotations

import re
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, field_validator

from recipes import load_document
from recipes.text.section import refusal

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
