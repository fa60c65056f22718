"""Base of every section of a recipe or bench file: immutable, and no key that it does not know."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A section of a file; keys are the aliases, attributes carry the unit in their name."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        populate_by_name=False,
        allow_inf_nan=False,
        str_max_length=2000,
        strict=True,
    )
