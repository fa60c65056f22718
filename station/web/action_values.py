"""What each action is asked with: the values of its request, with their types and ranges."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from recipes.text.section import Name
from recipes.text.section import Revision as RevisionNumber
from recipes.text.yaml_source import LARGEST_FILE
from station.web.bypasses import LONGEST_HOURS


class Values(BaseModel):
    """Values of a request, read strictly: a name that is not among them is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Nothing(Values):
    """An action that needs nothing."""


class Start(Values):
    """What was scanned, and why the unit is measured again where it was before."""

    scanned: str = Field(max_length=512)
    retest_reason: str = Field(default="", max_length=200)


class Confirm(Values):
    """The run whose bad unit is in the NOK box."""

    run: str = Field(max_length=200)


class Announced(Values):
    """A unit that comes to the bench, and what became of it in the process step before."""

    serial: str = Field(max_length=512)
    previous_step: Literal["passed", "failed"]


class NewBypass(Values):
    """A start condition to set aside, why, and for how many hours."""

    condition: str = Field(max_length=40)
    reason: str = Field(min_length=1, max_length=120)
    hours: float = Field(gt=0.0, le=LONGEST_HOURS)


class EndedBypass(Values):
    """A start condition that counts again."""

    condition: str = Field(max_length=40)


class NewPerson(Values):
    """A new account."""

    name: str
    role: str
    password: str


class Named(Values):
    """An account."""

    name: str


class FreshPassword(Values):
    """An account and a first password for it."""

    name: str
    password: str


class NewPassword(Values):
    """The old password and the new one."""

    old_password: str
    new_password: str


class RecipeText(Values):
    """The text of a recipe; `replaces`: SHA-256 of the draft of the same revision that was read before, if any."""

    text: str = Field(min_length=1, max_length=LARGEST_FILE)
    replaces: str = Field(default="", max_length=64)


class RecipeTried(Values):
    """The text of a recipe."""

    text: str = Field(min_length=1, max_length=LARGEST_FILE)


class RecipeRevision(Values):
    """A revision of a recipe, and the SHA-256 of its text as it was read."""

    name: Name
    revision: RevisionNumber
    sha256: str = Field(pattern="^[0-9a-f]{64}$")
