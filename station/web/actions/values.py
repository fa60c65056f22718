"""What each action is asked with, with types and ranges, and what it answers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from recipes.text.section import Name
from recipes.text.section import Revision as RevisionNumber
from recipes.text.yaml_source import LARGEST_FILE
from station.web.bypasses import LONGEST_HOURS

ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff]*$"
"""No sign that would make another line of it, or turn it round, wherever it is shown."""
ReasonText = Annotated[str, StringConstraints(strip_whitespace=True, min_length=3, max_length=200, pattern=ONE_LINE)]
"""Why somebody lets something pass, or does not: some words, for blanks give no reason."""


class Values(BaseModel):
    """Values of a request, read strictly: a name that is not among them is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Nothing(Values):
    """An action that needs nothing."""


class Start(Values):
    """What was scanned, and why the unit is measured again where it was before; study: whose next step it is."""

    scanned: str = Field(max_length=512)
    retest_reason: str = Field(default="", max_length=200)
    study: str = Field(default="", max_length=40)


class Scanned(Values):
    """What was scanned."""

    scanned: str = Field(max_length=512)


class Confirm(Values):
    """The run whose bad unit is in the NOK box."""

    run: str = Field(max_length=200)


class LabelOfRun(Values):
    """The run whose label is meant."""

    run: str = Field(max_length=200)


class NoLabel(LabelOfRun):
    """Why a unit goes without a label that was read."""

    reason: ReasonText


class RunInNoFile(Values):
    """A run that is in no AQDEF file, and why that is all right."""

    run: str = Field(max_length=200)
    reason: ReasonText


class Announced(Values):
    """A unit that comes to the bench, and what became of it in the process step before."""

    serial: str = Field(max_length=512)
    previous_step: Literal["passed", "failed"]


class Recovery(Values):
    """The recovery that is on, by its id."""

    recovery: str = Field(max_length=200)


class NewJog(Values):
    """The model of the unit on the bench, and the share of the largest speed of a jog."""

    model: str = Field(max_length=64)
    speed: float = Field(default=1.0, gt=0.0, le=1.0)


class KeyHeld(Values):
    """The direction of a key that is held: 1 or -1."""

    direction: Literal[1, -1]


class KeyReleased(Values):
    """Why a key is held no more."""

    why: Literal["released", "left", "blurred", "hidden"] = "released"


class DevicePressed(Values):
    """Whether the enabling device is pressed."""

    down: bool


class NewBypass(Values):
    """A start condition to set aside, why, and for how many hours."""

    condition: str = Field(max_length=40)
    reason: str = Field(min_length=1, max_length=120)
    hours: float = Field(gt=0.0, le=LONGEST_HOURS)


class EndedBypass(Values):
    """A start condition that counts again."""

    condition: str = Field(max_length=40)


class NamedStudy(Values):
    """A guided study by its name."""

    study: str = Field(max_length=40)


class NewStudy(NamedStudy):
    """A study to begin: serial numbers, operators, metrics by id; references and tolerances one for each, or none."""

    kind: Literal["type1", "gage"]
    parts: list[str] = Field(min_length=1, max_length=50)
    operators: list[str] = Field(default=[], max_length=20)
    metrics: list[str] = Field(min_length=1, max_length=20)
    references: list[float] = Field(default=[], max_length=20)
    tolerances: list[float] = Field(default=[], max_length=20)
    trials: int | None = Field(default=None, ge=1, le=1000)


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


class NewBadge(Values):
    """An account, the number of its badge, and a PIN of 4 to 12 digits."""

    name: str
    badge: str = Field(max_length=512)
    pin: str = Field(max_length=64)


class NewPin(Values):
    """One's own password, and a new PIN for the badge."""

    password: str
    pin: str = Field(max_length=64)


class ChosenLanguage(Values):
    """A language of the pages."""

    language: Literal["en", "de", "zh"]


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


class RecipeSentBack(RecipeRevision):
    """A revision of a recipe that is not released as it is, and why."""

    reason: ReasonText


class Outcome(BaseModel):
    """What an action answers when it was done; `done`: its id."""

    model_config = ConfigDict(frozen=True)

    done: str = ""


class Reason(BaseModel):
    """One reason of a refusal."""

    model_config = ConfigDict(frozen=True)

    id: str
    text: str


class Refused(BaseModel):
    """Why a request was refused."""

    model_config = ConfigDict(frozen=True)

    refused: tuple[Reason, ...]

    @classmethod
    def because(cls, reasons: Iterable[tuple[str, str]]) -> Self:
        """Return the refusal for these reasons: id and words of each."""
        return cls(refused=tuple(Reason(id=name, text=words) for name, words in reasons))


def refusal(name: str, words: str) -> Refused:
    """Return the refusal for one reason."""
    return Refused.because([(name, words)])


class RunStarted(Outcome):
    """The unit that is measured, its model, and the file of its recipe."""

    serial: str
    model: str
    recipe: str


class Permission(Outcome):
    """Whether a unit may be measured now, and every reason why not."""

    serial: str
    allowed: bool
    reasons: tuple[Reason, ...]


class UnitAnnounced(Outcome):
    """The unit that comes to the bench."""

    serial: str
    previous_step: Literal["passed", "failed"]


class RunConfirmed(Outcome):
    """The run whose bad unit was put away."""

    run: str


class LabelTold(Outcome):
    """The run whose label was read, is printed again or is not asked for any more."""

    run: str
    serial: str = ""
    copy_number: int = 0


class AqdefTold(Outcome):
    """The run that is known to be in no AQDEF file, and how many others are in none."""

    run: str
    refused: int


class RecoveryBegun(Outcome):
    """The run that left the bench in a fault, and in which one."""

    run: str
    cause: str


class RecoveryTold(Outcome):
    """The recovery that was told."""

    recovery: str


class JogBegun(Outcome):
    """The model of the unit that is on the bench, and the bench."""

    model: str
    bench: str


class StudyTold(Outcome):
    """A study, and how many of its steps are measured."""

    study: str
    measured: int
    steps: int


class BypassAdded(Outcome):
    """The start condition that is set aside, and until when, as people read it."""

    condition: str
    text: str


class BypassEnded(Outcome):
    """The start condition that counts again."""

    condition: str


class RecipeChanged(Outcome):
    """A revision of a recipe, the SHA-256 of its text, and its state."""

    name: str
    revision: int
    sha256: str
    state: str


class DryRunStarted(Outcome):
    """The revision that is tried, and the SHA-256 of its text."""

    name: str
    revision: int
    sha256: str


class AccountAdded(Outcome):
    """The new account."""

    name: str
    role: str


class AccountChanged(Outcome):
    """The account that was changed."""

    name: str
