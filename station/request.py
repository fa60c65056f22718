"""What is asked for, checked before anything moves: recipe, bench, profiles, unit and scenario."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import drivers
from controller.compiler import compile_program
from controller.program import Program
from recipes import (
    Bench,
    Problem,
    Recipe,
    RecipeError,
    check,
    default_bench,
    find_bench,
    load_bench,
    load_recipe,
    shipped_recipes,
)

DRIVER_PROFILES = Path(drivers.__file__).parent / "profiles"


@dataclass(frozen=True)
class Source:
    """A file as it was read: the record keeps these bytes."""

    path: Path
    content: bytes

    @classmethod
    def read(cls, path: Path) -> Source:
        """Read a file that the loader has accepted; RecipeError when it is gone."""
        try:
            return cls(path, path.read_bytes())
        except OSError as error:
            raise RecipeError([Problem(str(path), 0, 0, "", f"cannot be read: {error.strerror}", "")]) from error

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes, as hexadecimal digits."""
        return hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True)
class Job:
    """A recipe on a bench, both loaded and checked against each other."""

    recipe: Recipe
    bench: Bench
    recipe_source: Source
    bench_source: Source

    @cached_property
    def program(self) -> Program:
        """What the controller steps through."""
        return compile_program(self.recipe, self.bench)

    @property
    def profile_names(self) -> tuple[str, ...]:
        """Device profiles that the bench file names, each once."""
        bench = self.bench
        names = (bench.drive.profile, bench.amplifier.profile, bench.brake.profile, bench.remote_io.profile)
        return tuple(dict.fromkeys(names))

    @cached_property
    def profile_paths(self) -> dict[str, Path]:
        """Files of the device profiles; RecipeError with every one that is not there."""
        return {name: find_profile(name, self.bench_source.path) for name in self.profile_names}


def find_profile(name: str, bench_path: Path) -> Path:
    """Return a profile's file: from `profiles/` beside the bench file, from beside it, or the shipped one."""
    beside = bench_path.parent
    places = [beside / "profiles" / f"{name}.yaml", beside / f"{name}.yaml", DRIVER_PROFILES / f"{name}.yaml"]
    for place in places:
        if place.is_file():
            return place
    shipped = ", ".join(sorted(path.stem for path in DRIVER_PROFILES.glob("*.yaml")))
    found = f"there is no profile '{name}' beside the bench file"
    raise RecipeError([Problem(str(bench_path), 0, 0, "profile", found, f"a file there, or one of {shipped}")])


def recipe_path(name_or_path: str) -> Path:
    """Return a recipe's file by path or by the name of a shipped one."""
    path = Path(name_or_path)
    return path if path.exists() else shipped_recipes().get(name_or_path, path)


def load_job(recipe_name: str, bench_name: str | None) -> Job:
    """Load recipe and bench and check one against the other.

    Raises:
        RecipeError: with all problems of both files, or all that speaks against the pair.

    """
    problems: list[Problem] = []
    recipe: Recipe | None = None
    bench: Bench | None = None
    recipe_file = recipe_path(recipe_name)
    try:
        recipe = load_recipe(recipe_file)
    except RecipeError as error:
        problems += error.problems
    try:
        if bench_name is not None:
            bench_file = find_bench(bench_name)
            bench = load_bench(bench_file)
        elif recipe is not None:
            bench_file, bench = default_bench(recipe)
    except RecipeError as error:
        problems += error.problems
    if recipe is None or bench is None or problems:
        raise RecipeError(problems)
    found = check(recipe, bench, recipe_file)
    if found:
        raise RecipeError(found)
    job = Job(recipe, bench, Source.read(recipe_file), Source.read(bench_file))
    _ = job.profile_paths
    return job
