"""The limits of a recipe's text on trial: what they do to runs that are there, whatever a dry run says."""

from __future__ import annotations

import math
from typing import NamedTuple

from recipes import Recipe, RecipeError, check_alone
from station.errors import StationError
from station.quality.limits_trial import Tried, limits_trial, recipe_of
from station.quality.recipe_change import place_of
from station.store.quality.lot import Lot, Production
from station.store.quality.values import Characteristic, characteristics, newest_run


class TextTried(NamedTuple):
    """What the limits of a text do to one metric of a lot: how many of its newest runs fail now, and would fail."""

    metric: Characteristic
    limit_min: float | None
    limit_max: float | None
    runs: int
    fail_now: int
    would_fail: int


class TextTrial(NamedTuple):
    """All metrics whose limits in a text are others than those of the newest run.

    lot: of the runs they were tried on; None where no valid one is there. left: metrics that the text defines in
    another way than these runs, or that cannot be tried alone.
    """

    lot: Lot | None
    tried: tuple[TextTried, ...] = ()
    left: tuple[str, ...] = ()


def text_trial(production: Production, recipe: Recipe) -> TextTrial:
    """Try the limits of a text on the newest valid first attempts of its recipe: real units, else virtual ones.

    RecipeError for limits that none can fail or meet, and options without a value: what they do to runs means nothing.
    """
    idle = check_alone(recipe)
    if idle:
        raise RecipeError(idle)
    lot = _lot_of(production, recipe.recipe.name)
    if lot is None:
        return TextTrial(None)
    there = recipe_of(production, lot)
    guard = 0.0 if recipe.decision.rule == "simple" else recipe.decision.guard_factor
    tried, left = list[TextTried](), list[str]()
    for what in characteristics(production, lot):
        try:
            entry, before = (one.metrics[place_of(one, what.metric)] for one in (recipe, there))
        except StationError:
            continue  # of a preset, or asked for more than once: no limit of the text is its own
        if (entry.min, entry.max) == (what.limit_min, what.limit_max):
            continue
        keys = (entry.key(recipe.measurement.reference_torque_nm), before.key(there.measurement.reference_torque_nm))
        if keys[0] != keys[1]:
            left.append(what.name)
            continue
        low, high = (math.nan if one is None else one for one in (entry.min, entry.max))
        asked = Tried(what.name, None, low, high, guard)
        try:
            found = limits_trial(production, lot, asked, 0)
        except StationError:
            left.append(what.name)
            continue
        failing = [sum(row[2] for row in found.verdicts if row[place] == "FAIL") for place in (0, 1)]
        tried.append(TextTried(what, entry.min, entry.max, found.runs, *failing))
    return TextTrial(lot, tuple(tried), tuple(left))


def _lot_of(production: Production, name: str) -> Lot | None:
    for virtual in (False, True):
        lot = Lot(recipe=name, virtual=virtual)
        try:
            newest_run(production, lot)
        except StationError:
            continue
        return lot
    return None
