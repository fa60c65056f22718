"""What shall be done: recipe and bench schemas, units, the strict loader, and the shipped files.

recipe = load_recipe("rv-40e-121-inverse.yaml")     # RecipeError: all problems, with line and column
path, bench = default_bench(recipe)                 # or load_bench("my-bench.yaml")
problems = check(recipe, bench)                     # empty when this bench can run this recipe
"""

from recipes.checks.cross_check import check, check_alone, check_side, out_of_date, warnings
from recipes.loader import load_document, parse_document
from recipes.schema.bench_schema import Bench
from recipes.schema.calibration_schema import Calibration
from recipes.schema.metric_presets import PRESETS
from recipes.schema.metric_schema import MetricWanted
from recipes.schema.recipe_schema import Decision, Recipe
from recipes.schema.sequence_schema import SpeedCycles, StepCycles, TorqueCycles
from recipes.selection import OWN, Selection, left_out, selected
from recipes.shipped import (
    default_bench,
    find_bench,
    find_recipe,
    load_bench,
    load_recipe,
    parse_bench,
    parse_recipe,
    parse_written_bench,
    shipped_benches,
    shipped_recipes,
)
from recipes.text.problems import Problem, RecipeError
from recipes.text.regular_file import open_regular
from recipes.text.yaml_source import read_bytes

__all__ = [
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
    "SpeedCycles",
    "StepCycles",
    "TorqueCycles",
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
    "open_regular",
    "out_of_date",
    "parse_bench",
    "parse_document",
    "parse_recipe",
    "parse_written_bench",
    "read_bytes",
    "selected",
    "shipped_benches",
    "shipped_recipes",
    "warnings",
]
