"""By which decision rule the runs of a lot were judged: as the recipe of each says, which is known by its hash.

A lot may have runs of several revisions, and these several rules. One copy of each recipe is read: that of a run which
has it, or the text of its revision. Where there is none, the rule of its runs is not known, and is not guessed.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from sqlalchemy import func, select

from recipes import Recipe, RecipeError, parse_recipe
from recipes.text.yaml_source import read_bytes
from station.errors import StationError
from station.records.revisions.revision import hash_of, text_path
from station.records.run_record import RECIPE_COPY, RunRecord
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, Production
from station.store.tables import ATTEMPTS, RUNS

MOST_COPIES = 20
"""Runs with the same recipe whose copy of it is tried."""

MOST_RECIPES = 256

NOT_KNOWN = (
    "its recipe is not at hand as it was, so it is not known by which rule its verdict was made, and whether the "
    "evaluation had a doubt. Restore the record from a backup, or evaluate it with 'lostmotion analyze --recipe'"
)
"""Why a run is not counted."""


def judged_by(production: Production, lot: Lot) -> GuardBands:
    """Return by which guard bands the newest valid first attempts of a lot were judged."""
    runs = production.chosen(lot, RUNS.c.valid, newest=lot.newest, said=())
    together = (ATTEMPTS.c.chain == runs.c.chain) & (ATTEMPTS.c.run == runs.c.run)
    asked = select(ATTEMPTS.c.recipe_sha256, func.max(runs.c.run)).select_from(runs).join(ATTEMPTS, together)
    newest = production.connection.execute(asked.group_by(ATTEMPTS.c.recipe_sha256)).tuples().all()
    found = {sha256: _recipe(production, sha256, run) for sha256, run in newest}
    known = {sha256: guard_of(recipe) for sha256, recipe in found.items() if recipe is not None}
    return GuardBands(known, unknown=len(found) - len(known))


def guard_of(recipe: Recipe) -> float | None:
    """Return the guard band of a recipe as a multiple of U, None for the simple rule."""
    return None if recipe.decision.rule == "simple" else recipe.decision.guard_factor


def recipe_bytes(data: Path, run: str) -> tuple[Path, bytes]:
    """Return the recipe that a run was measured by, and where it stands.

    Raises:
        StationError: it is not as it was when the run began. RecipeError: it cannot be read.

    """
    record = RunRecord(data / run)
    path = record.folder / RECIPE_COPY
    content = read_bytes(path)
    expected, found = record.manifest().recipe.sha256, hash_of(content)
    if found != expected:
        raise StationError(
            f"{path}: was changed after the run: found SHA-256 {found:.16}…, and run.json says {expected:.16}…. "
            "Restore the file from a backup"
        )
    return path, content


def _recipe(production: Production, sha256: str, run: str) -> Recipe | None:
    """Return the recipe of a hash; None where no copy of it is left that can be read."""
    data = production.chain.data
    paths = [data / run / RECIPE_COPY, *_copies(production, sha256)]
    for path in dict.fromkeys(paths):
        try:
            content = read_bytes(path)
            if hash_of(content) == sha256:
                return _parsed(content)
        except RecipeError:
            continue
    return None


def _copies(production: Production, sha256: str) -> list[Path]:
    """Return where copies of a recipe may be: in runs by it, newest first, and in the texts of its revisions."""
    data, here = production.chain.data, production.chain.id
    asked = select(ATTEMPTS.c.run).where(ATTEMPTS.c.chain == here, ATTEMPTS.c.recipe_sha256 == sha256)
    runs = production.connection.execute(asked.order_by(ATTEMPTS.c.run.desc()).limit(MOST_COPIES)).scalars().all()
    # By the name in the runs: that of a recipe itself is known from a copy, and here none of them may be left.
    named = select(RUNS.c.recipe, RUNS.c.revision).where(RUNS.c.chain == here, RUNS.c.run.in_(runs)).distinct()
    texts = production.connection.execute(named.where(RUNS.c.revision.is_not(None))).tuples()
    return [*(data / run / RECIPE_COPY for run in runs), *(text_path(data, name, rev, sha256) for name, rev in texts)]


@lru_cache(MOST_RECIPES)
def _parsed(content: bytes) -> Recipe:
    return parse_recipe(content, RECIPE_COPY)
