"""Another definition, other limits or another rule for one metric of a recipe, as a change of the recipe's text.

The same function makes the recipe that runs are evaluated by on trial and the draft that is saved of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from definitions.metrics import METRICS
from recipes import MetricWanted, Recipe, parse_recipe
from recipes.editing import all_changed
from recipes.schema.metric_schema import LIMIT_OPTIONS
from recipes.selection import CHOICES, read_alone, written_options
from recipes.text.problems import OptionPath
from station.errors import StationError
from station.store.quality.trial import Rule

PLACE = "--definition"
NAMED = "recipe.yaml"
QUOTE = "'"


class RecipeChange(NamedTuple):
    """Options of the entry of a metric, and of the decision rule, each with its new text; '' takes an option out."""

    metric: str
    entry: tuple[tuple[str, str], ...] = ()
    decision: tuple[tuple[str, str], ...] = ()

    @property
    def text(self) -> str:
        """The change for a person."""
        options = (*self.entry, *self.decision)
        parts = [
            f"{name} {value.strip(QUOTE) or 'none'}"
            for name, value in options
            if (value or name not in CHOICES) and (name, value) != ("id", self.metric)
        ]
        return f"{self.metric} with {', '.join(parts)}"


def whole_change(
    metric: str, after: Rule, max_standard_deviation: float | None, definition: Sequence[tuple[str, str]] = ()
) -> RecipeChange:
    """Return what makes every recipe judge the metric by a rule, whatever limits and rule it has itself.

    The runs of a lot may have recipes of several revisions. max_standard_deviation: over cycles, of the recipe that a
    draft is made of. definition: as `change_of`.
    """
    limits = {"min": after.limit_min, "max": after.limit_max, "max_standard_deviation": max_standard_deviation}
    entry = [(name, "" if limit is None else _with_unit(metric, limit)) for name, limit in limits.items()]
    return RecipeChange(metric, (*definition, *entry), _decision(after.guard_factor))


def change_of(metric: str, before: Rule, after: Rule, definition: Sequence[tuple[str, str]] = ()) -> RecipeChange:
    """Return what makes one rule of the other, in the recipe that has the first one.

    definition: options of the other definition, as `definition_of`.
    """
    entry = list(definition)
    for name in ("limit_min", "limit_max"):
        now, new = getattr(before, name), getattr(after, name)
        if now != new:
            entry.append((name.removeprefix("limit_"), "" if new is None else _with_unit(metric, new)))
    same = after.guard_factor == before.guard_factor
    return RecipeChange(metric, tuple(entry), () if same else _decision(after.guard_factor))


def _decision(factor: float | None) -> tuple[tuple[str, str], ...]:
    if factor is None:
        return ("guard_factor", ""), ("rule", "simple")
    return ("rule", "guard_band"), ("guard_factor", _exact(factor))


def changed_recipe(content: bytes, change: RecipeChange, named: str = NAMED) -> bytes:
    """Return the text of a recipe with a change; the rest stays as it is written.

    Raises:
        StationError: the recipe does not ask for the metric itself, or more than once. RecipeError: the text is none.

    """
    place = place_of(parse_recipe(content, named), change.metric, named)
    entry: list[tuple[OptionPath, str]] = [(("metrics", place, name), value) for name, value in change.entry]
    return all_changed(content, [*entry, *((("decision", name), value) for name, value in change.decision)])


def place_of(recipe: Recipe, metric: str, named: str = NAMED) -> int:
    """Return where the entry of a metric stands under `metrics`; StationError as `changed_recipe`."""
    places = [place for place, one in enumerate(recipe.metrics) if one.id == metric]
    if len(places) != 1:
        raise StationError(
            f"{named}: has {len(places)} entries of {metric} under 'metrics'; expected exactly one. Change the limits "
            "by hand on the page Recipes"
        )
    return places[0]


def definition_of(recipe: Recipe, metric: str, text: str) -> tuple[MetricWanted, tuple[tuple[str, str], ...]]:
    """Return what a text says instead of the entry of a metric, and the options that make it that.

    text: a metric and its choices as `--metric` takes it, such as `stiffness_at torque=50% branch=load`; the choices
    alone are of the metric itself.

    Raises:
        StationError: its values are in another unit, so that no limit of the metric is one of it. RecipeError: no
        metric is defined so.

    """
    text = " ".join(text.split())
    if "=" in text.split(" ", 1)[0]:
        text = f"{metric} {text}"
    given = written_options(text)
    limits = [name for name in LIMIT_OPTIONS if name in given]
    if limits:
        raise StationError(
            f"{PLACE}: found the limit {limits[0]}={given[limits[0]]}; allowed is what defines a value: "
            f"{', '.join(CHOICES)}. Give new limits beside it"
        )
    wanted = read_alone(text, PLACE, recipe)
    unit, there = METRICS[wanted.id].unit, METRICS[metric].unit
    if METRICS[wanted.id].kind is not METRICS[metric].kind:
        raise StationError(
            f"{PLACE}: {wanted.id} is in {_unit(unit)}, and the limits of {metric} are in {_unit(there)}. Choose a "
            f"metric in {_unit(there)}; 'lostmotion metrics' lists them"
        )
    options = [("id", wanted.id), *((name, _quoted(given.get(name, ""))) for name in CHOICES)]
    options += [(name, value) for name, value in given.items() if name not in ("id", *CHOICES)]
    return wanted, tuple(options)


def other_definitions(recipe: Recipe, metric: str) -> tuple[str, ...]:
    """Return other definitions of a metric as texts that `definition_of` reads.

    First the other choices of the metric, then other metrics in the same unit by which a unit is bad on the same side;
    without what the recipe reports already. StationError as `changed_recipe`.
    """
    one, row = recipe.metrics[place_of(recipe, metric)], METRICS[metric]
    present = {
        "branch": one.branch,
        "side": one.side,
        "torque": None if one.torque_nm is None else f"{one.torque_nm:.10g} N·m",
        "band": None if one.band is None else f"{100.0 * one.band:.10g} %",
        "variant": one.variant,
        "fit": one.fit,
    }
    found = []
    for name, choices in (("variant", row.variants), ("fit", row.fits), ("branch", row.branches)):
        for other in choices:
            chosen = {**present, name: other}
            if other == (present[name] or choices[0]) or (chosen["variant"] == "direct" and chosen["fit"] is not None):
                continue
            words = " ".join(f"{option}={value}" for option, value in chosen.items() if value is not None)
            found.append(f"{metric} {words}")
    like = (other for other in METRICS.values() if (other.kind, other.bad) == (row.kind, row.bad))
    found += [other.id for other in like if other.id != metric and other.calibration == row.calibration]
    reference_nm = recipe.measurement.reference_torque_nm
    there = {wanted.key(reference_nm) for wanted in recipe.metrics}
    return tuple(text for text in found if read_alone(text, PLACE, recipe).key(reference_nm) not in there)


def _quoted(text: str) -> str:
    """Return a text as YAML reads it as one: the side - alone would be a list."""
    return "'{}'".format(text.replace("'", "''")) if text else ""


def _unit(unit: str) -> str:
    return "no unit" if unit in ("", "1") else unit


def _with_unit(metric: str, value: float) -> str:
    unit = METRICS[metric].unit
    return _exact(value) if unit in ("", "1") else f"{_exact(value)} {unit}"


def _exact(value: float) -> str:
    """Return the shortest text that is read as this value: a limit that is rounded judges another way."""
    return repr(float(value)).removesuffix(".0")
