"""By which guard band the stored verdicts of a lot were made: one for all of its runs, or that of each one's recipe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, FromClause, Select, case, false, literal, null, true

from station.store.tables import ATTEMPTS, METRICS


@dataclass(frozen=True, slots=True)
class GuardBands:
    """The guard band of each recipe by its SHA-256, as a multiple of U; None: the simple rule, without a band.

    unknown: how many recipes of the lot are not at hand, so that nobody knows by which rule their runs were judged.
    """

    by_recipe: Mapping[str, float | None]
    unknown: int = 0

    @classmethod
    def of_all(cls, factor: float | None) -> GuardBands:
        """Return one guard band of all runs, whatever their recipes."""
        return cls({"": factor})

    @property
    def differ(self) -> bool:
        """Whether runs have to be told apart by their recipes."""
        return self.unknown > 0 or len(set(self.by_recipe.values())) != 1

    def with_recipes(self, asked: Select[Any], runs: FromClause) -> Select[Any]:
        """Return a statement on runs, with the recipe of each where the conditions below ask for it."""
        if not self.differ:
            return asked
        return asked.join(ATTEMPTS, (ATTEMPTS.c.chain == runs.c.chain) & (ATTEMPTS.c.run == runs.c.run))

    def band(self) -> ColumnElement[Any]:
        """Return the guard band by which a side was judged, in its unit; NULL where that is not known."""
        bands = {factor or 0.0: factor for factor in self.by_recipe.values()}
        there = [
            (self.is_judged_by(one), one * METRICS.c.uncertainty if one else literal(0.0)) for one in bands.values()
        ]
        if not self.differ:
            return there[0][1]
        return case(*there, else_=null()) if there else null()

    def is_judged_by(self, factor: float | None) -> ColumnElement[bool]:
        """Whether a run was judged by this guard band; 0 is the simple rule too."""
        of = [sha256 for sha256, one in self.by_recipe.items() if (one or 0.0) == (factor or 0.0)]
        if not self.differ:
            return true() if of else false()
        return ATTEMPTS.c.recipe_sha256.in_(of)

    def is_unknown(self) -> ColumnElement[bool]:
        """Whether nobody knows by which guard band a run was judged."""
        return ~ATTEMPTS.c.recipe_sha256.in_(list(self.by_recipe)) if self.differ else false()
