"""What shall be done: recipe and bench schemas, units, the strict loader, and the shipped files.

recipe = load_recipe("rv-40e-121-inverse.yaml")     # RecipeError: all problems, with line and column
path, bench = default_bench(recipe)                 # or load_bench("my-bench.yaml")
problems = check(recipe, bench)                     # empty when this bench can run this recipe
"""

from recipes.bench_schema import Bench
from recipes.calibration_schema import Calibration
from recipes.cross_check import check, check_alone, check_side, out_of_date, warnings
from recipes.loader import load_document, parse_document
from recipes.metric_presets import PRESETS
from recipes.metric_schema import MetricWanted
from recipes.metric_units import METRIC_UNITS
from recipes.problems import Problem, RecipeError
from recipes.recipe_schema import Decision, Recipe
from recipes.selection import OWN, Selection, left_out, selected
from recipes.shipped import (
    default_bench,
    find_bench,
    find_recipe,
    load_bench,
    load_recipe,
    parse_bench,
    parse_recipe,
    shipped_benches,
    shipped_recipes,
)
from recipes.yaml_source import read_bytes

__all__ = [
    "METRIC_UNITS",
    "OWN",
    "PRESETS",
    "Bench",
    "Calibration",
    "Decision",
    "MetricWanted",
    "Problem",
    "Recipe",
    "RecipeError",
    "Selection",
    "check",
    "check_alone",
    "check_side",
    "default_bench",
    "find_bench",
    "find_recipe",
    "left_out",
    "load_bench",
    "load_document",
    "load_recipe",
    "out_of_date",
    "parse_bench",
    "parse_document",
    "parse_recipe",
    "read_bytes",
    "selected",
    "shipped_benches",
    "shipped_recipes",
    "warnings",
]
