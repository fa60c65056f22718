"""What is asked of many runs, known by a hash: another recipe, other definitions of metrics, or other limits.

| question | reads of each run | costs |
|---|---|---|
| limits | value and U, from the store | a statement of SQL for all |
| metrics | the trace: eight channels | an evaluation |
| a change of one metric in each run's own recipe | the trace: eight channels | an evaluation |
| recipe | the whole record, every scan of which is checked | reading it, and an evaluation |
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from recipes import OWN, PRESETS, Recipe, RecipeError, Selection, check_alone, find_recipe, parse_recipe
from recipes.text.yaml_source import read_bytes, refuse_misleading
from station.errors import StationError
from station.quality.recipe_change import RecipeChange

LIMIT_OPTIONS = ("branch", "min", "max", "guard")


class ReevaluationError(StationError):
    """What is asked cannot be asked, or not of these runs. Nothing that is stored was changed."""


@dataclass(frozen=True)
class Question:
    """What every run is evaluated by.

    recipe: bytes of another recipe, b'' for the run's own; recipe_file: where it stands. selection: metrics that are
    reported instead of the recipe's. change: what is changed in the run's own recipe.
    """

    recipe: bytes = b""
    recipe_file: str = ""
    selection: Selection = OWN
    change: RecipeChange | None = None

    @property
    def whole_record(self) -> bool:
        """Whether the whole record is read, and not the trace alone."""
        return bool(self.recipe)

    @property
    def text(self) -> str:
        """The question for a person."""
        parts = [f"recipe {Path(self.recipe_file).name}"] if self.recipe else []
        parts += [] if self.change is None else [self.change.text]
        return ", ".join([*parts, *self.selection.parts])

    @property
    def hash(self) -> str:
        """Hash of what decides, wherever the file stands."""
        recipe = hashlib.sha256(self.recipe).hexdigest() if self.recipe else None
        said = {"recipe": recipe, "preset": self.selection.preset, "metrics": list(self.selection.metrics)}
        return _hash(said if self.change is None else said | {"change": self.change._asdict()})


class LimitsQuestion(NamedTuple):
    """Other limits of one metric; None keeps what is; guard: guard band as a multiple of U, 0 for none."""

    metric: str
    branch: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    guard: float | None = None

    @property
    def text(self) -> str:
        """The question for a person."""
        named = {"branch": self.branch, "min": self.minimum, "max": self.maximum, "guard": self.guard}
        return f"limits {self.metric} " + " ".join(
            f"{name}={value}" for name, value in named.items() if value is not None
        )

    def hash_with(self, decides: Sequence[Sequence[object]]) -> str:
        """Return the hash of what decides; decides: what the question leaves open, as the runs have it."""
        return _hash([self, *decides])


def _hash(said: Any) -> str:
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def question_of(recipe: str | None, preset: str | None, metrics: tuple[str, ...]) -> Question:
    """Return the question of a command line; a recipe is a file, or the name of a shipped one.

    Raises:
        ReevaluationError: nothing is asked, or there is no such preset. RecipeError: the recipe is refused.

    """
    if recipe is None and preset is None and not metrics:
        raise ReevaluationError("nothing to evaluate: give --recipe, --metric, --preset or --limits")
    if preset is not None and preset not in PRESETS:
        raise ReevaluationError(f"--preset: found {preset!r}; allowed are {', '.join(PRESETS)}")
    selection = Selection(preset, tuple(" ".join(one.split()) for one in metrics))
    if recipe is None:
        return Question(selection=selection)
    file = find_recipe(recipe)
    content = read_bytes(file)
    refuse_misleading(content, str(file))
    idle = check_alone(parse_recipe(content, str(file)), file)
    if idle:
        raise RecipeError(idle)
    return Question(content, str(file), selection)


def limits_of(text: str) -> LimitsQuestion:
    """Return the limits of a command line, as in "lost_motion max=0.9" or "stiffness_at branch=mean min=10 guard=0.5".

    Raises:
        ReevaluationError: the text is none.

    """
    allowed = 'a metric and its new limits (min, max, guard, branch), as in "lost_motion max=0.9"'
    metric, *options = text.split() or [""]
    found: dict[str, str] = {}
    for option in options:
        name, _, value = option.partition("=")
        if name not in LIMIT_OPTIONS or not value or name in found:
            raise ReevaluationError(f"--limits: found {option!r}; allowed is {allowed}")
        found[name] = value
    if not metric or "=" in metric or not set(found) - {"branch"}:
        raise ReevaluationError(f"--limits: found {text!r}; allowed is {allowed}")
    figures = {}
    for name in ("min", "max", "guard"):
        try:
            figures[name] = float(found[name]) if name in found else None
        except ValueError:
            raise ReevaluationError(f"--limits: found {name}={found[name]!r}; allowed is a number") from None
    return LimitsQuestion(metric, found.get("branch"), figures["min"], figures["max"], figures["guard"])


def recipe_in(question: Question) -> Recipe:
    """Return the recipe that is asked by."""
    return parse_recipe(question.recipe, question.recipe_file)
