"""The files that come with the program, and the bench that a recipe runs on when none is named."""

from __future__ import annotations

from pathlib import Path

from recipes.bench_schema import Bench
from recipes.loader import load_bench
from recipes.problems import Problem, RecipeError, nearest
from recipes.recipe_schema import Recipe

FOLDER = Path(__file__).parent


def shipped_recipes() -> dict[str, Path]:
    """Shipped recipe files by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}


def shipped_benches() -> dict[str, Path]:
    """Shipped bench files by name."""
    return {path.stem: path for path in sorted((FOLDER / "benches").glob("*.yaml"))}


def find_bench(name_or_path: str | Path) -> Path:
    """A bench file by its path, or by the name of a shipped one; raises `RecipeError` when there is neither."""
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml") or path.exists():
        return path
    benches = shipped_benches()
    if str(name_or_path) in benches:
        return benches[str(name_or_path)]
    found, allowed = "there is no such bench", ", ".join(benches) + ", or the path of a bench file"
    raise RecipeError([Problem(str(name_or_path), 0, 0, "", found, allowed, nearest(str(name_or_path), benches))])


def default_bench(recipe: Recipe) -> tuple[Path, Bench]:
    """The embedded bench for this recipe: the side it loads, and its model before any model."""
    candidates = [(path, load_bench(path)) for path in shipped_benches().values()]
    fitting = [
        (path, bench)
        for path, bench in candidates
        if bench.bench.embedded
        and bench.bench.loading == recipe.loading
        and (not bench.bench.models or recipe.unit_under_test.model in bench.bench.models)
    ]
    if not fitting:
        found = f"no embedded bench takes {recipe.unit_under_test.model} with the load at the {recipe.loading}"
        raise RecipeError([Problem(recipe.recipe.name, 0, 0, "loading", found, "a bench file given with --bench")])
    return max(fitting, key=lambda item: bool(item[1].bench.models))
