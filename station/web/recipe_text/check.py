"""What is said of the text of a recipe while somebody writes it: the messages of `check`, and the load it plans."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from recipes import Problem, RecipeError
from recipes.text.yaml_source import LARGEST_FILE
from station.bench.request import Job, Source, load_job
from station.errors import StationError
from station.records.revisions.history import header_of
from station.web.models import Models

SHOWN_AS = "recipe.yaml"
"""What messages call a text whose name nobody can read."""


class BadRecipeError(StationError):
    """A text that is no recipe, or one that cannot be run."""


@dataclass(frozen=True)
class Message:
    """One message with its place in the text, counted from 1; line 0: it speaks of another file."""

    line: int
    column: int
    text: str
    is_warning: bool = False

    @property
    def where(self) -> str:
        """Place in words; '' where it is in another file."""
        return f"line {self.line}, column {self.column}" if self.line else ""


@dataclass(frozen=True)
class LookedAt:
    """What a text says: messages by their places and, where it can be run, the load that the compiler made of it.

    load_profile: corners, time [s] from the first ramp and output torque [N·m]. peak_nm: largest torque. rated_nm: of
    the unit. duration_s: of the whole run.
    """

    messages: tuple[Message, ...]
    job: Job | None = None
    load_profile: tuple[tuple[float, float], ...] = ()
    peak_nm: float = 0.0
    rated_nm: float = 0.0
    duration_s: float = 0.0


def bench_of(models: Models, name: str) -> str | None:
    """Return the bench that the table of models gives a recipe; None: the one that fits the recipe."""
    return next((one.bench for one in models.models if one.recipe == name), None)


def look_at(content: bytes, models: Models) -> LookedAt:
    """Check the text of a recipe on the bench that it is for, as `lostmotion check` does."""
    shown, bench = SHOWN_AS, None
    try:
        header = header_of(content)
        shown, bench = f"{header.name}.yaml", bench_of(models, header.name)
    except RecipeError:
        pass  # it is said below, with its place
    try:
        job = load_job(Source(Path(shown), content), bench)
        program = job.program
    except RecipeError as error:
        return LookedAt(tuple(_message(one, shown) for one in error.problems))
    except StationError as error:
        return LookedAt((Message(0, 0, str(error)),))
    return LookedAt(
        tuple(Message(0, 0, text, is_warning=True) for text in job.warnings),
        job,
        tuple((round(t_s, 3), torque_nm) for t_s, torque_nm in program.load_profile()),
        program.peak_torque_nm,
        job.recipe.unit_under_test.rated_torque_nm,
        program.planned_scans * program.period_s,
    )


def refuse_unfit(content: bytes, models: Models) -> Job:
    """Return what a text plans; BadRecipeError with its first problems where it cannot be run."""
    found = look_at(content, models)
    if found.job is None:
        words = [f"{one.where}: {one.text}" if one.where else one.text for one in found.messages[:3]]
        raise BadRecipeError(" ".join(words))
    return found.job


def encoded(text: str) -> bytes:
    """Return the bytes of a text that was sent, with U+000A at line ends and without a mark of its encoding.

    A U+000D that stands alone stays, and is refused where the text is read: not every editor ends a line there.

    Raises:
        BadRecipeError: a recipe cannot be that long.

    """
    content = text.removeprefix("\ufeff").replace("\r\n", "\n").encode()
    if len(content) > LARGEST_FILE:
        raise BadRecipeError(f"The text has {len(content)} bytes; a recipe has at most {LARGEST_FILE}. Shorten it.")
    return content


def _message(one: Problem, shown: str) -> Message:
    """Return a problem as a message: the place beside it, where it is in this text."""
    text = str(one)
    if one.path != shown or not one.line:
        return Message(0, 0, text)
    return Message(one.line, one.column, text.removeprefix(f"{one.path}:{one.line}:{one.column}:").strip())
