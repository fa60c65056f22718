"""The file `station.yaml`: what a site decides about its station. Without the file everything is as it comes."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import Literal
from zoneinfo import available_timezones

from pydantic import BaseModel, ConfigDict, Field, field_validator

from recipes import load_document
from recipes.text.section import refusal

FILE = "station.yaml"


class ScannerTest(BaseModel):
    """The code by which a scanner shows that its keyboard layout is that of the computer, and how long that holds.

    `code`: what is printed on the card at the bench. It has to hold what other layouts and Caps Lock change.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    code: str = "yz-YZ_019/?+=;"
    hours: float = Field(default=8.0, ge=0.5, le=24.0)

    @field_validator("code")
    @classmethod
    def _shows_what_changes(cls, text: str) -> str:
        needed = {"y", "z", "Y", "Z", "-", "/"}
        if not text.isascii() or not text.isprintable() or needed - set(text) or text != text.strip():
            raise refusal(text, f"printable ASCII characters with {' '.join(sorted(needed))} among them")
        return text


class Settings(BaseModel):
    """The file.

    `operator_by_badge_alone`: whether an operator logs in with a badge and no PIN; nobody else ever does. `badge`:
    syntax of badge numbers, by which the bench page knows a badge from a unit; without it badges are read on the page
    for logging in only. `scanner_test`: asked for once a shift where it is given. `language`: of the pages, for who has
    chosen none. `time_zone`: of the plant, as in Europe/Berlin; without it that of the computer.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    operator_by_badge_alone: bool = False
    badge: str | None = None
    scanner_test: ScannerTest | None = None
    language: Literal["en", "de", "zh"] = "en"
    time_zone: str | None = None

    @field_validator("time_zone")
    @classmethod
    def _is_zone(cls, text: str | None) -> str | None:
        if text is not None and text not in available_timezones():
            raise refusal(text, "a name of the time zone database, such as Europe/Berlin")
        return text

    @field_validator("badge")
    @classmethod
    def _is_expression(cls, text: str | None) -> str | None:
        if text is None:
            return None
        try:
            re.compile(text)
        except re.error as error:
            raise refusal(text, f"a regular expression: {error}") from error
        return text

    def use_time_zone(self) -> None:
        """Make local time that of the plant in this process: on every page, in every search, at the terminal."""
        if self.time_zone is not None:
            os.environ["TZ"] = self.time_zone
            time.tzset()


def load_settings(data: Path) -> Settings:
    """Return the settings of a data folder; those that it comes with where it has no `station.yaml`.

    Raises:
        RecipeError: with all problems of the file.

    """
    file = data / FILE
    return load_document(file, Settings) if file.exists() else Settings()
