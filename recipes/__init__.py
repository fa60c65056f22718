"""What shall be done: recipe and bench schemas, units, the strict loader, and the shipped files."""

from recipes.bench_schema import Bench, Calibration
from recipes.cross_check import check
from recipes.loader import load_bench, load_document, load_recipe
from recipes.metric_units import METRIC_KINDS, METRIC_UNITS
from recipes.problems import Problem, RecipeError
from recipes.recipe_schema import Decision, MetricWanted, Recipe
from recipes.shipped import default_bench, find_bench, shipped_benches, shipped_recipes

__all__ = [
    "METRIC_KINDS",
    "METRIC_UNITS",
    "Bench",
    "Calibration",
    "Decision",
    "MetricWanted",
    "Problem",
    "Recipe",
    "RecipeError",
    "check",
    "default_bench",
    "find_bench",
    "load_bench",
    "load_document",
    "load_recipe",
    "shipped_benches",
    "shipped_recipes",
]
