"""Whether a recipe and a bench that are named afterwards fit the unit, the shaft and the day of a measurement."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from recipes import Bench, Recipe, RecipeError, check_side, out_of_date
from station.errors import StationError


def objections_to_bench(recipe: Recipe, bench: Bench, day: date) -> list[str]:
    """Return what of a bench was not in date on the day of a measurement, in words.

    Raises:
        RecipeError: the bench loads the other shaft, or is not built for the model.

    """
    other = check_side(recipe, bench)
    if other:
        raise RecipeError(other)
    return out_of_date(recipe, bench, day)


def check_recipe_fits(recipe: Recipe, recipe_file: Path, own: Recipe, run: str) -> None:
    """Refuse a recipe that cannot say anything about the unit of a run; own: its own recipe."""
    asked, was = recipe.unit_under_test.model, own.unit_under_test.model
    if asked != was:
        raise StationError(
            f"{recipe_file}: unit_under_test.model: found {asked}; run {run} measured a {was}. "
            "Choose a recipe for that model",
        )
    if recipe.loading != own.loading:
        raise StationError(
            f"{recipe_file}: loading: found {recipe.loading}; in run {run} the {own.loading} shaft was loaded. "
            f"Choose a recipe with loading: {own.loading}",
        )
    ratio, was_ratio = recipe.unit_under_test.ratio, own.unit_under_test.ratio
    if ratio != was_ratio:
        raise StationError(
            f"{recipe_file}: unit_under_test.ratio: found {ratio:g}; run {run} measured a {was} with ratio "
            f"{was_ratio:g}. One model has one ratio: correct the recipe that is wrong",
        )
