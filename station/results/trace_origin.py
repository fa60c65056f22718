"""Whether a recipe and a bench that are named afterwards fit the unit, the shaft and the day of a measurement."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import NamedTuple

from recipes import Bench, Recipe, RecipeError, check_side, out_of_date
from station.errors import StationError


class MeasuredUnit(NamedTuple):
    """The unit of a run, and the shaft it was loaded by; None for what an exported file of an older version lacks."""

    model: str
    loading: str | None
    ratio: float | None


def measured_unit(own: Recipe) -> MeasuredUnit:
    """Return the unit of a run by its own recipe."""
    return MeasuredUnit(own.unit_under_test.model, own.loading, own.unit_under_test.ratio)


def objections_to_bench(recipe: Recipe, bench: Bench, day: date) -> list[str]:
    """Return what of a bench was not in date on the day of a measurement, in words.

    Raises:
        RecipeError: the bench loads the other shaft, or is not built for the model.

    """
    other = check_side(recipe, bench)
    if other:
        raise RecipeError(other)
    return out_of_date(recipe, bench, day)


def check_recipe_fits(recipe: Recipe, recipe_file: Path, own: MeasuredUnit, run: str) -> None:
    """Refuse a recipe that cannot say anything about the unit of a run; run: as it is named, behind the word `run`."""
    asked = measured_unit(recipe)
    if asked.model != own.model:
        raise StationError(
            f"{recipe_file}: unit_under_test.model: found {asked.model}; run {run} measured a {own.model}. "
            "Choose a recipe for that model",
        )
    if own.loading is not None and asked.loading != own.loading:
        raise StationError(
            f"{recipe_file}: loading: found {asked.loading}; in run {run} the {own.loading} shaft was loaded. "
            f"Choose a recipe with loading: {own.loading}",
        )
    if own.ratio is not None and asked.ratio != own.ratio:
        raise StationError(
            f"{recipe_file}: unit_under_test.ratio: found {asked.ratio:g}; run {run} measured a {own.model} with ratio "
            f"{own.ratio:g}. One model has one ratio: correct the recipe that is wrong",
        )
