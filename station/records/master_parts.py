"""The master parts of a bench: when each was last measured, and whether it read as it should.

One run cannot show an error that both torques and the angle have in common, such as both torques 5 % too large and the
angle with them. A unit whose verdict is known can: a good one must pass, a bad one must fail.

What it should read it reads by certain limits. So it speaks for a product where it was measured by that product's
recipe, letter by letter. One of another model cannot be: it speaks by the released recipe of its own model. A recipe on
trial speaks for nothing.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from functools import cached_property
from typing import NamedTuple

from recipes.schema.bench_schema import Bench, MasterPart
from recipes.schema.recipe_schema import Recipe
from station.documents.manifest import MASTER, Manifest, RecipeHead, VerdictName
from station.documents.result import Result
from station.errors import StationError
from station.records.data_folder import Store
from station.records.revisions.history import History
from station.records.run_record import RESULT, RunRecord, only_simulated
from station.records.seal import alterations

COMPLETE = "complete"


AS_IT_SHOULD = "The master part read as it should. Put it back in its place."
NOT_AS_IT_SHOULD = "The master part does not read as it should: the bench may measure wrong. Call the technician."
GOOD_ONE_FAILED = (
    "The good master part failed: the bench may measure wrong, or the part is worn. Put it into the NOK box and call "
    "the technician."
)
NOT_MEASURED = "The master part was not measured. Measure it again, or call the technician."


def to_do_with_part(expected: VerdictName, verdict: str) -> str:
    """Return what is done with a master part after a verdict."""
    if verdict == "NOT DECIDABLE":
        return NOT_MEASURED
    if verdict == expected:
        return AS_IT_SHOULD
    return NOT_AS_IT_SHOULD if verdict == "PASS" else GOOD_ONE_FAILED


Found = tuple[RunRecord, Manifest]
"""A run of a master part."""


class MasterCheck(NamedTuple):
    """A master part as a bench last measured it: its serial number, whether it speaks for the bench, and in words."""

    serial: str
    in_order: bool
    text: str


class ProductRecipe(NamedTuple):
    """The recipe that products are measured by, and the model that it is for."""

    head: RecipeHead
    model: str


def product_recipe(recipe: Recipe, sha256: str) -> ProductRecipe:
    """Return what master parts speak for; sha256: of the file of the recipe."""
    named = recipe.recipe
    head = RecipeHead(name=named.name, revision=named.revision, sha256=sha256)
    return ProductRecipe(head, recipe.unit_under_test.model)


def master_parts(store: Store, bench: Bench, now: datetime, product: ProductRecipe | None) -> tuple[MasterCheck, ...]:
    """Return the state of each master part that a bench file names; none where it names none.

    product: whom they are to speak for; None where a bench is looked at by itself.
    """
    speaking = _Speaking(store, product)
    return tuple(_checked(store, bench.bench.name, part, now, speaking) for part in bench.master_parts)


class _Speaking:
    """Which runs of master parts speak for a product, by their recipe."""

    def __init__(self, store: Store, product: ProductRecipe | None) -> None:
        self._store, self._product = store, product

    def by_its_recipe(self, manifest: Manifest) -> bool:
        """Whether a run was made by the recipe of the product."""
        return self._product is not None and manifest.recipe.sha256 == self._product.head.sha256

    def by_a_released_one(self, manifest: Manifest) -> bool:
        """Whether a run was made by the newest released revision of its recipe, which is for no unit of the product."""
        if self._same_model(manifest):
            return False
        newest = self._history.newest_released(manifest.recipe.name)
        return newest is not None and newest.sha256 == manifest.recipe.sha256

    def why_not(self, manifest: Manifest, ago: str) -> str:
        """Return why a run does not speak for the product, and what to do."""
        measured = f"was last measured by recipe {_named(manifest.recipe)} ({ago})"
        if self._product is not None and self._same_model(manifest):
            return f"{measured}; needed is recipe {_named(self._product.head)}. Measure it by that recipe"
        return f"{measured}, which is not the newest released one of this name. Measure it by a released recipe"

    def _same_model(self, manifest: Manifest) -> bool:
        return self._product is not None and manifest.unit.model == self._product.model

    @cached_property
    def _history(self) -> History:
        return History(self._store.data)


def _named(recipe: RecipeHead) -> str:
    return f"{recipe.name} revision {recipe.revision} [{recipe.sha256[:8]}]"


def _checked(store: Store, bench: str, part: MasterPart, now: datetime, speaking: _Speaking) -> MasterCheck:
    newest, aside = _newest(store, bench, part, now, speaking)
    if newest is None:
        why = f"was never measured on this bench; needed every {_hours(part.every_s)}"
        why = why if aside is None else _set_aside(aside, now, speaking)
        return MasterCheck(part.serial, False, f"{MASTER}{part.serial} {why}")  # noqa: FBT003
    run, manifest = newest
    age = _age(manifest, now)
    ago = _ago(newest, now)
    if alterations(run):
        wrong = f"has an altered record ({ago}): it proves nothing. Measure it again"
    elif manifest.verdict != part.expect:
        wrong = f"read {manifest.verdict}, and {part.expect} is right ({ago}): this bench may measure wrong"
    elif not timedelta(0) <= age <= timedelta(seconds=part.every_s):
        wrong = f"was last measured {ago}; due every {_hours(part.every_s)}"
        if aside is not None and aside[0].id > run.id:  # it was measured since, but by another recipe
            wrong = _set_aside(aside, now, speaking)
    else:
        right = f"read {manifest.verdict}, as it should ({ago}). {_proves(run, part)}"
        return MasterCheck(part.serial, True, f"{MASTER}{part.serial} {right}")  # noqa: FBT003
    return MasterCheck(part.serial, False, f"{MASTER}{part.serial} {wrong}")  # noqa: FBT003


def _set_aside(found: Found, now: datetime, speaking: _Speaking) -> str:
    return speaking.why_not(found[1], _ago(found, now))


def _ago(found: Found, now: datetime) -> str:
    run, manifest = found
    return f"{_hours(_age(manifest, now).total_seconds())} before, run {run.id}"


def _age(manifest: Manifest, now: datetime) -> timedelta:
    return now - datetime.fromisoformat(manifest.started)


ONE_SIDED = (
    "Its recipe has a limit on one side only, so a measuring error towards better values is not detected: give this "
    "recipe a lower and an upper limit"
)


def _proves(run: RunRecord, part: MasterPart) -> str:
    """Say how large an error common to torques or angles may have been when a master part read as it should.

    A good one lies within its limits whatever the error, so its value cannot be off by more than they are apart.
    """
    if part.expect != "PASS":
        return "The bench rejects a bad unit like this master part"
    apart = {}
    for metric in run.read(Result, RESULT).metrics:
        low, high = metric.limits.min, metric.limits.max
        if low is not None and high is not None and low > 0.0:
            apart[metric.id] = 100.0 * (high / low - 1.0)
    if not apart:
        return ONE_SIDED
    narrowest = min(apart, key=lambda name: apart[name])
    return f"A measuring error above {apart[narrowest]:.2g} % of the metric {narrowest} would have been detected"


def _newest(
    store: Store, bench: str, part: MasterPart, now: datetime, speaking: _Speaking
) -> tuple[Found | None, Found | None]:
    """Return the newest run of a master part that speaks for the product, and the newest one that does not.

    Both used the bench and came to their end, without injected faults. A part has thousands of runs: behind the first
    that is older than it may be, none is looked at.
    """
    of_another_model: Found | None = None
    aside: Found | None = None
    for run in reversed(store.named_by(part.serial)):
        try:
            manifest = run.manifest()
        except StationError:
            continue
        whole = manifest.state == COMPLETE and manifest.scenario is None and manifest.recovery_of is None
        whole &= not only_simulated(manifest)
        if not (whole and manifest.serial == part.serial and manifest.bench.name == bench):
            continue
        if speaking.by_its_recipe(manifest):
            return (run, manifest), aside
        if of_another_model is None and speaking.by_a_released_one(manifest):
            of_another_model = run, manifest
        elif aside is None:
            aside = run, manifest
        if _age(manifest, now) > timedelta(seconds=part.every_s):
            break
    return of_another_model, aside


def _hours(seconds: float) -> str:
    """Return a time as a person says it: seconds below two minutes, minutes below two hours, hours below two days."""
    for unit, length, least in (("d", 86400.0, 2.0), ("h", 3600.0, 2.0), ("min", 60.0, 2.0)):
        if abs(seconds) >= least * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.0f} s"
