"""Recipe and bench files that come with the program, and loading of any recipe or bench by path or shipped name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from definitions.units import TORQUE
from recipes.loader import load_source
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.schema.sequence_schema import sequence_order
from recipes.text.problems import Problem, RecipeError, Source, nearest, one_of
from recipes.text.quantity import QuantityError, read_quantity
from recipes.text.section import RATED, REFERENCE
from recipes.text.yaml_source import parse_source, read_bytes, refuse_misleading

HERE = Path(__file__).parent

KEPT = 16
"""Documents that are kept by their bytes: a start reads the same ones several times, and what is read is frozen."""


def shipped_recipes() -> dict[str, Path]:
    """Return the shipped recipes by name."""
    return {path.stem: path for path in sorted(HERE.glob("*.yaml"))}


def shipped_benches() -> dict[str, Path]:
    """Return the shipped bench files by name."""
    return {path.stem: path for path in sorted((HERE / "benches").glob("*.yaml"))}


def find_recipe(name_or_path: str | Path) -> Path:
    """Return the path of a recipe that is named by its path or its shipped name. Raises RecipeError."""
    return _file(name_or_path, shipped_recipes(), "recipe")


def find_bench(name_or_path: str | Path) -> Path:
    """Return the path of a bench file that is named by its path or its shipped name. Raises RecipeError."""
    return _file(name_or_path, shipped_benches(), "bench")


def load_recipe(path: str | Path) -> Recipe:
    """Load a recipe from a file or by its shipped name. Raises RecipeError with all problems of the file.

    An option without a value is one. For the copy in a record, which opens as ever, see `parse_recipe`.
    """
    named = find_recipe(path)
    raw = read_bytes(named)
    refuse_misleading(raw, str(named))
    recipe = parse_recipe(raw, str(named))
    recipe.refuse_empty_options()
    return recipe


@lru_cache(maxsize=KEPT)
def parse_recipe(raw: bytes, path: str) -> Recipe:
    """Load a recipe from the bytes of a file, such as the copy in a record. Raises RecipeError."""
    return _recipe_of(parse_source(raw, path))


def load_bench(path: str | Path) -> Bench:
    """Load a bench from a file or by its shipped name; as `load_recipe`. Raises RecipeError."""
    named = find_bench(path)
    return parse_written_bench(read_bytes(named), str(named))


def parse_bench(raw: bytes, path: str) -> Bench:
    """Load a bench from the bytes of a file, such as the copy in a record. Raises RecipeError."""
    return _bench_of(raw, path)[1]


def parse_written_bench(raw: bytes, path: str) -> Bench:
    """Load a bench from the bytes of a file that somebody writes: an option without a value is refused too.

    So is a sign that misleads. Raises RecipeError.
    """
    refuse_misleading(raw, path)
    source, bench = _bench_of(raw, path)
    source.refuse_empty_options()
    return bench


@lru_cache(maxsize=KEPT)
def _bench_of(raw: bytes, path: str) -> tuple[Source, Bench]:
    source = parse_source(raw, path)
    hint = "Name it as the recipe, and the bench file with --bench."
    _refuse_other(source, "recipe", "bench", "a recipe in the place of a bench file", hint)
    return source, load_source(source, Bench)


def default_bench(recipe: Recipe) -> tuple[Path, Bench]:
    """Return the embedded bench that a recipe runs on when none is named, and its file.

    One that names the recipe's model comes before one that takes any. Raises RecipeError when none fits.
    """
    model = recipe.unit_under_test.model
    fitting = [
        (path, bench)
        for path, bench in ((path, load_bench(path)) for path in shipped_benches().values())
        if bench.bench.embedded
        and bench.bench.loading == recipe.loading
        and (not bench.bench.models or model in bench.bench.models)
    ]
    if not fitting:
        found = f"'{recipe.loading}' for {model}, for which there is no virtual bench"
        hint = "Name a bench file with --bench."
        raise RecipeError([recipe.problem(("loading",), found, "the side and model of a virtual bench", hint)])
    return max(fitting, key=lambda item: bool(item[1].bench.models))


def _refuse_other(source: Source, other: str, own: str, found: str, hint: str) -> None:
    """Refuse a file of the other kind at once: each of its options would be told as unknown."""
    if isinstance(source.data, dict) and other in source.data and own not in source.data:
        raise RecipeError([source.problem((other,), found, f"a file with the section '{own}'", hint, at_name=True)])


def _recipe_of(source: Source) -> Recipe:
    hint = "Name it with --bench, and a recipe in its place."
    _refuse_other(source, "bench", "recipe", "a bench file in the place of a recipe", hint)
    recipe = load_source(source, Recipe, percentages, rules=(sequence_order,))
    return recipe.with_source(source)


def percentages(data: Any) -> Mapping[str, float | None]:
    """Return what 100 % stands for in a recipe's plain data; None where the file does not say it rightly."""
    rated = _torque(data, "unit_under_test", "rated_torque", None)
    reference = _torque(data, "measurement", "reference_torque", rated)
    written = isinstance(data, dict) and "reference_torque" in (data.get("measurement") or {})
    return {RATED: rated, REFERENCE: reference if written else rated}


def _torque(data: Any, section: str, option: str, percent_of: float | None) -> float | None:
    inside = data.get(section) if isinstance(data, dict) else None
    text = inside.get(option) if isinstance(inside, dict) else None
    try:
        return read_quantity(text, TORQUE, percent_of)
    except QuantityError:
        return None


def _file(path: str | Path, shipped: Mapping[str, Path], what: str) -> Path:
    """Return the path of a file that is named by its path or by its shipped name."""
    named = Path(path)
    if str(path) in shipped and not named.is_file():
        return shipped[str(path)]
    if named.parent == Path() and not named.exists():
        meant = nearest(named.stem, shipped)
        hint = f"Did you mean '{meant}'?" if meant else "Check the path."
        allowed = f"the path of a {what} file, or {one_of(list(shipped))}"
        raise RecipeError([Problem(str(path), 1, 1, "", "no such file", allowed, hint)])
    return named
