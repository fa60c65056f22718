"""Limits of the metrics against what they are for: one that never fails is refused, an implausible one is told."""

from __future__ import annotations

from collections.abc import Iterator

from recipes.bench_schema import Bench
from recipes.expectations import Finding
from recipes.limit_kinds import LIMIT_KINDS, LimitKind
from recipes.metric_schema import MetricWanted
from recipes.metric_units import METRIC_UNITS
from recipes.recipe_schema import Recipe

SIDES = ("min", "max")


def check_limits(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    """No limit is one that no unit can fail."""
    yield from idle_limits(recipe)


def idle_limits(recipe: Recipe) -> Iterator[Finding]:
    """Limits that never fail: a recipe that has one decides less than it says."""
    for index, metric in enumerate(recipe.metrics):
        kind = LIMIT_KINDS[metric.id]
        if kind.ceiling is not None and metric.max is not None and metric.max >= kind.ceiling:
            allowed = f"a max below {_said(kind.ceiling, metric)}, the largest there is"
            yield _never(index, metric, "max", metric.max, allowed)
        alone = metric.max is None
        if alone and kind.floor is not None and metric.min is not None and metric.min <= kind.floor:
            allowed = f"a {kind.decides}" if kind.decides == "max" else f"a min above {_said(kind.floor, metric)}"
            yield _never(index, metric, "min", metric.min, allowed)


def implausible_limits(recipe: Recipe) -> Iterator[Finding]:
    """Limits that may be meant, but look like a wrong unit, a slipped digit, or the wrong side."""
    for index, metric in enumerate(recipe.metrics):
        kind, option = LIMIT_KINDS[metric.id], ("metrics", index)
        given = {side: limit for side in SIDES if (limit := getattr(metric, side)) is not None}
        if given and kind.decides not in given:
            other = next(iter(given))
            found = f"'{metric.id}' with {other} alone"
            way = "much" if kind.decides == "max" else "little"
            hint = f"Without it a unit with too {way} of it passes."
            yield Finding((*option, other), found, f"a {kind.decides}, the side that decides", hint)
        yield from (
            found for side, limit in given.items() for found in _out_of_range(recipe, index, metric, side, limit, kind)
        )


def _out_of_range(  # noqa: PLR0917 - a limit, where it stands, and what it is held against
    recipe: Recipe, index: int, metric: MetricWanted, side: str, limit: float, kind: LimitKind
) -> Iterator[Finding]:
    scale = kind.scale(recipe)
    least, most = kind.least * scale, kind.most * scale
    too_low = limit < least and side == kind.decides
    if not (too_low or limit > most):
        return
    of = f" ({kind.least:g} to {kind.most:g} of {kind.of})" if kind.of else ""
    found = f"{_said(limit, metric)} for '{metric.id}'"
    usual = f"one from {_said(least, metric)} to {_said(most, metric)}{of}"
    yield Finding(("metrics", index, side), found, usual, "Check the number and its unit.")


def _never(index: int, metric: MetricWanted, side: str, limit: float, allowed: str) -> Finding:
    found = f"{side} {_said(limit, metric)} for '{metric.id}', which no unit fails"
    return Finding(("metrics", index, side), found, allowed, "Correct it, or delete it where nothing is to be decided.")


def _said(value: float, metric: MetricWanted) -> str:
    unit = METRIC_UNITS[metric.id]
    return f"{value:.4g}" if unit == "1" else f"{value:.4g} {unit}"
