"""What is reported instead of a recipe's own metrics: those of a preset, single ones, or both. Limits stay its own.

A single metric is one line of text, as the command line takes it: `stiffness_at torque=50 % branch=load` is the entry
`{id: stiffness_at, torque: 50 %, branch: load}` of a recipe, read by the same schema. Limits are not among it: what
decides stands in a recipe, which has a name, a revision and a fingerprint.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from recipes.loader import load_source
from recipes.schema.metric_schema import LIMIT_OPTIONS, MetricWanted, preset_metrics
from recipes.schema.recipe_schema import Recipe
from recipes.text.problems import Mark, Problem, RecipeError, Source, excerpt, one_of
from recipes.text.section import RATED, REFERENCE
from recipes.text.translation import options_at

PLACE = "--metric"

OPTION = re.compile(r"(?:^|\s)([^\s=]+)\s*=")
NOWHERE = Mark(0, 0, 0, 0)
"""Place of what stands in no file."""
EXAMPLE = "stiffness_at torque=50% branch=load"

CHOICES = ("branch", "side", "torque", "band", "variant", "fit")
"""Options of a metric that are part of its definition."""


class Selection(NamedTuple):
    """Name of a preset, and texts of single metrics as `read_metric` reads them; nothing: the recipe's own."""

    preset: str | None = None
    metrics: tuple[str, ...] = ()

    @property
    def made(self) -> bool:
        """Say whether anything is chosen."""
        return self.preset is not None or bool(self.metrics)

    @property
    def parts(self) -> list[str]:
        """Name what is chosen: the preset, then each metric."""
        return [*([] if self.preset is None else [f"preset {self.preset}"]), *(f"metric {one}" for one in self.metrics)]

    @property
    def text(self) -> str:
        """Name what is chosen, in one text; '' for nothing."""
        return ", ".join(self.parts)


OWN = Selection()
"""The recipe's own metrics."""


def selected(recipe: Recipe, selection: Selection = OWN) -> list[MetricWanted]:
    """Return the metrics to report: the recipe's, or the chosen ones, with what the recipe limits of the same kind.

    Raises RecipeError for a text that says no metric, or one that was said before.
    """
    if not selection.made:
        return [metric for _, metric in recipe.wanted()]
    reference_nm = recipe.measurement.reference_torque_nm
    single: dict[tuple[object, ...], MetricWanted] = {}
    for text in selection.metrics:
        metric = read_alone(text, PLACE, recipe)
        key = metric.key(reference_nm)
        if key in single:
            raise twice(text, PLACE)
        single[key] = metric
    of_preset = [] if selection.preset is None else preset_metrics(selection.preset)
    found = {metric.key(reference_nm): metric for metric in of_preset} | single
    mine = {metric.key(reference_nm): metric for metric in recipe.metrics}
    return [mine.get(key, metric) for key, metric in found.items()]


def left_out(recipe: Recipe, selection: Selection) -> list[str]:
    """Name the metrics that the recipe has limits for and that are not among the chosen ones."""
    judged = [id(one) for one in selected(recipe, selection)]
    return [one.id for one in recipe.metrics if one.limited and id(one) not in judged]


def read_alone(text: str, place: str, recipe: Recipe) -> MetricWanted:
    """Return the metric that a text asks for beside a recipe, whose torques are 100 %; RecipeError as `read_metric`."""
    reference_nm = recipe.measurement.reference_torque_nm
    return read_metric(text, place, {RATED: recipe.unit_under_test.rated_torque_nm, REFERENCE: reference_nm})


def written_options(text: str) -> dict[str, str]:
    """Return the id and the options of a text that `read_metric` reads, as they are written."""
    return dict(_options(text))


def read_metric(text: str, place: str, percentages: Mapping[str, float]) -> MetricWanted:
    """Return the metric that a text asks for.

    place: what messages call the text's place, `--metric`. percentages: what 100 % stands for, by the keys of
    `recipes.text.section`. Raises RecipeError with all that is wrong with it.
    """
    path = f"{place} {excerpt(text)}"
    data: dict[str, str] = {}
    problems: list[Problem] = []
    for name, value in _options(text):
        if name == "":
            found = f"{excerpt(value)} without the name of its option"
            allowed = f"the metric, then option=value with {one_of(_free_options())}"
            problems.append(Problem(path, 0, 0, "", found, allowed, f"Write it as in '{EXAMPLE}'."))
        elif name in data:
            problems.append(Problem(path, 0, 0, name, f"{name} a second time", "each option once", "Delete one."))
        elif name in LIMIT_OPTIONS:
            allowed = "the limits of the recipe, which hold for the same definition"
            hint = "Write it in a recipe and name that with --recipe: what decides has a name and a revision."
            problems.append(Problem(path, 0, 0, name, f"a limit, {excerpt(value)}", allowed, hint))
        else:
            data[name] = value
    source = Source(path, data, {(): NOWHERE, **{(name,): NOWHERE for name in data}}, tuple(problems))
    return load_source(source, MetricWanted, percentages)


def twice(text: str, place: str) -> RecipeError:
    """Return the refusal of a definition that is asked for a second time."""
    return RecipeError([Problem(f"{place} {excerpt(text)}", 0, 0, "", "it a second time", "each metric once",
                                "Delete one of the two.")])  # fmt: skip


def _options(text: str) -> Iterator[tuple[str, str]]:
    """Yield the id and the options as written; what has no name comes with an empty one."""
    found = list(OPTION.finditer(text))
    head = text[: found[0].start()] if found else text
    for index, word in enumerate(head.replace(",", " ").split()):
        yield ("" if index else "id"), word
    ends = [match.start() for match in found[1:]]
    for match, end in zip(found, [*ends, len(text)], strict=False):
        yield match[1], text[match.end() : end].strip().rstrip(",").strip("\"' ")


def _free_options() -> list[str]:
    return [name for name in options_at(MetricWanted, ()) if name not in ("id", *LIMIT_OPTIONS)]
