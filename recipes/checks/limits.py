"""Limits of the metrics against what they are for: one that never fails, or always, is refused; an odd one is told."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from definitions.method import LEAST_USUAL_GUARD
from definitions.metrics import METRICS, USUAL_BAND, USUAL_REFERENCE, Metric, Scale, Share
from definitions.units import FRACTION, TORQUE
from recipes.checks.expectations import Finding
from recipes.checks.measurement import MEASURED
from recipes.schema.bench_schema import Bench
from recipes.schema.metric_schema import MetricWanted
from recipes.schema.recipe_schema import Recipe
from recipes.text.quantity import show

SIDES = ("min", "max")
LEAST_CYCLES = 2
"""Cycles that a standard deviation is taken over, at least."""

DECIDES = {"low": "min", "high": "max"}
"""Limit that decides, by the side on which a unit is bad; a limit on the other side alone lets every bad one pass."""


def _windup_arcmin(recipe: Recipe) -> float:
    """Wind-up between both reference torques by the catalogue."""
    return 2.0 * recipe.measurement.reference_torque_nm / recipe.unit_under_test.stiffness_nm_per_arcmin


SCALES: dict[Scale, Callable[[Recipe], float]] = {
    Scale.OWN: lambda _: 1.0,
    Scale.STIFFNESS: lambda recipe: recipe.unit_under_test.stiffness_nm_per_arcmin,
    Scale.WINDUP: _windup_arcmin,
    Scale.LOSS: lambda recipe: _windup_arcmin(recipe) * recipe.measurement.reference_torque_nm,
    Scale.RATIO: lambda recipe: recipe.unit_under_test.ratio,
    Scale.RATED_TORQUE: lambda recipe: recipe.unit_under_test.rated_torque_nm,
}
"""What each scale of a usual range is for the unit of a recipe."""


def check_limits(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    """No limit is one that no unit can fail, or none can meet."""
    yield from idle_limits(recipe)
    yield from unmet_limits(recipe)
    yield from _spread_of_one_cycle(recipe)


def idle_limits(recipe: Recipe) -> Iterator[Finding]:
    """Limits that never fail: a recipe that has one decides less than it says."""
    for index, metric in enumerate(recipe.metrics):
        row = METRICS[metric.id]
        floor, ceiling = row.usual.floor, row.usual.ceiling
        if ceiling is not None and metric.max is not None and metric.max >= ceiling:
            allowed = f"a max below {_said(ceiling, metric)}, the largest possible value"
            yield _never(index, metric, "max", metric.max, allowed)
        alone = metric.max is None
        if alone and floor is not None and metric.min is not None and metric.min <= floor:
            decides = DECIDES[row.bad.side]
            allowed = f"a {decides}" if decides == "max" else f"a min above {_said(floor, metric)}"
            yield _never(index, metric, "min", metric.min, allowed)


def unmet_limits(recipe: Recipe) -> Iterator[Finding]:
    """Limits that fail every unit: beyond the smallest or the largest value there is, or at it where none comes to it.

    A grade is one of a table and comes to its ends; what is measured does not come to 0.
    """
    for index, metric in enumerate(recipe.metrics):
        row = METRICS[metric.id]
        floor, ceiling = row.usual.floor, row.usual.ceiling
        reached = "from" if row.graded else "above"
        if (
            floor is not None
            and metric.max is not None
            and (metric.max < floor or (metric.max == floor and not row.graded))
        ):
            allowed = f"a max {reached} {_said(floor, metric)}, the smallest possible value"
            yield _always(index, metric, "max", metric.max, allowed)
        if ceiling is not None and metric.min is not None and metric.min > ceiling:
            allowed = f"a min up to {_said(ceiling, metric)}, the largest possible value"
            yield _always(index, metric, "min", metric.min, allowed)


def _spread_of_one_cycle(recipe: Recipe) -> Iterator[Finding]:
    """A standard deviation over cycles is limited where there are cycles to take it over."""
    cycles = sum(step.count for step in recipe.sequence if isinstance(step, MEASURED))
    for index, metric in enumerate(recipe.metrics):
        if metric.max_standard_deviation is not None and cycles < LEAST_CYCLES:
            found = f"a standard deviation of '{metric.id}' over {cycles} measured cycle"
            allowed = f"{LEAST_CYCLES} measured cycles or more"
            hint = "Raise 'count' of the cycles, or delete this limit."
            yield Finding(("metrics", index, "max_standard_deviation"), found, allowed, hint)


def implausible_limits(recipe: Recipe) -> Iterator[Finding]:
    """Limits that may be meant, but look like a wrong unit, a slipped digit, or the wrong side."""
    yield from _torques_to_read_at(recipe)
    yield from _narrow_guard_band(recipe)
    for index, metric in enumerate(recipe.metrics):
        row, option = METRICS[metric.id], ("metrics", index)
        decides = DECIDES[row.bad.side]
        given = {side: limit for side in SIDES if (limit := getattr(metric, side)) is not None}
        if given and decides not in given:
            other = next(iter(given))
            found = f"'{metric.id}' with {other} alone"
            way = "much" if decides == "max" else "little"
            hint = f"Without it a unit with too {way} of it passes."
            yield Finding((*option, other), found, f"a {decides}, the side that decides", hint)
        yield from (
            found for side, limit in given.items() for found in _out_of_range(recipe, index, metric, side, limit, row)
        )


def _torques_to_read_at(recipe: Recipe) -> Iterator[Finding]:
    """Torques at which limited metrics are read: at another one a unit with too much of it may pass."""
    limited = [(index, metric) for index, metric in enumerate(recipe.metrics) if metric.limited]
    for index, metric in limited:
        if metric.band is not None and not USUAL_BAND.holds(metric.band):
            found = f"a band of {show(metric.band, FRACTION)} for the limit of '{metric.id}'"
            allowed = f"one {_from_to(USUAL_BAND)} of the reference torque"
            yield Finding(("metrics", index, "band"), found, allowed, "Check the number: the limit is for this band.")
    torque_nm = recipe.measurement.reference_torque_nm
    reference = torque_nm / recipe.unit_under_test.rated_torque_nm
    if limited and not USUAL_REFERENCE.holds(reference):
        found = f"{show(torque_nm, TORQUE)}, {show(reference, FRACTION, 3)} of rated_torque"
        hint = "Check the number: percentages of the metrics are of this torque."
        yield Finding(("measurement", "reference_torque"), found, f"one {_from_to(USUAL_REFERENCE)} of it", hint)


def _narrow_guard_band(recipe: Recipe) -> Iterator[Finding]:
    """A guard band that is next to none: it decides as the rule `simple` does, under another name."""
    factor = recipe.decision.guard_factor
    if recipe.decision.rule == "guard_band" and factor < LEAST_USUAL_GUARD:
        allowed = f"{LEAST_USUAL_GUARD:g} or more, 95 % one-sided confidence"
        hint = "Delete it for that, or write 'rule: simple' where U is to be ignored."
        yield Finding(("decision", "guard_factor"), f"{factor:g}", allowed, hint)


def _from_to(share: Share) -> str:
    return f"from {show(share.least, FRACTION)} to {show(share.most, FRACTION)}"


def _out_of_range(  # noqa: PLR0917 - a limit, where it stands, and what it is held against
    recipe: Recipe, index: int, metric: MetricWanted, side: str, limit: float, row: Metric
) -> Iterator[Finding]:
    usual = row.usual
    scale = SCALES[usual.of](recipe)
    least, most = usual.least * scale, usual.most * scale
    too_low = limit < least and side == DECIDES[row.bad.side]
    if not (too_low or limit > most):
        return
    of = f" ({usual.least:g} to {usual.most:g} of {usual.of.value})" if usual.of.value else ""
    found = f"{_said(limit, metric)} for '{metric.id}'"
    allowed = f"one from {_said(least, metric)} to {_said(most, metric)}{of}"
    yield Finding(("metrics", index, side), found, allowed, "Check the number and its unit.")


def _never(index: int, metric: MetricWanted, side: str, limit: float, allowed: str) -> Finding:
    found = f"{side} {_said(limit, metric)} for '{metric.id}', which no unit fails"
    return Finding(("metrics", index, side), found, allowed, "Correct it, or delete it where nothing is to be decided.")


def _always(index: int, metric: MetricWanted, side: str, limit: float, allowed: str) -> Finding:
    found = f"{side} {_said(limit, metric)} for '{metric.id}', which no unit meets"
    return Finding(("metrics", index, side), found, allowed, "Correct the number and its sign.")


def _said(value: float, metric: MetricWanted) -> str:
    unit = METRICS[metric.id].unit
    return f"{value:.4g}" if unit == "1" else f"{value:.4g} {unit}"
