"""What is reported instead of a recipe's own metrics: those of a preset, single ones, or both. Limits stay its own."""

from __future__ import annotations

from typing import NamedTuple

from recipes.schema.metric_schema import MetricWanted, preset_metrics
from recipes.schema.metric_text import read_metric, twice
from recipes.schema.recipe_schema import Recipe
from recipes.text.section import RATED, REFERENCE

PLACE = "--metric"


class Selection(NamedTuple):
    """Name of a preset, and texts of single metrics as `metric_text` reads them; nothing: the recipe's own."""

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
    percentages = {RATED: recipe.unit_under_test.rated_torque_nm, REFERENCE: reference_nm}
    single: dict[tuple[object, ...], MetricWanted] = {}
    for text in selection.metrics:
        metric = read_metric(text, PLACE, percentages)
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
    return [one.id for one in recipe.metrics if (one.min, one.max) != (None, None) and id(one) not in judged]
