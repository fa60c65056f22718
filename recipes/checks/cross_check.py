"""Checks of a recipe against a bench, before anything moves.

Each check is a function that yields findings; `CHECKS` lists them all. A recipe for the other side of the reducer is
refused at once, since none of its torques could be judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

from recipes.checks.bus_load import check_line
from recipes.checks.expectations import Finding
from recipes.checks.limits import check_limits, idle_limits, implausible_limits, unmet_limits
from recipes.checks.measurement import (
    check_ages,
    check_angle_agreement,
    check_calibration,
    check_fixture,
    check_metrics,
    check_sensors,
    check_stored_calibration,
    check_torque_ratio,
    check_two_speeds,
    of_one_unit,
    without_noise,
)
from recipes.checks.ratings import (
    check_brake,
    check_drive,
    check_input_sensor,
    check_limits_before_peak,
    check_output_sensor,
    check_release,
    check_speed_ramps,
    check_step_size,
    check_tares,
    check_torque_ramps,
    check_unit_rating,
)
from recipes.checks.sweep import check_sweep
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.text.problems import NO_VALUE, Problem, one_of, place

Check = Callable[[Recipe, Bench], Iterator[Finding]]

CHECKS: tuple[Check, ...] = (
    check_unit_rating,
    check_output_sensor,
    check_input_sensor,
    check_tares,
    check_brake,
    check_drive,
    check_limits_before_peak,
    check_torque_ramps,
    check_speed_ramps,
    check_step_size,
    check_sweep,
    check_release,
    check_sensors,
    check_angle_agreement,
    check_calibration,
    check_torque_ratio,
    check_two_speeds,
    check_metrics,
    check_limits,
    check_ages,
    check_line,
)
"""All checks that need a recipe and a bench that load the same side."""


DatedCheck = Callable[[Recipe, Bench, date], Iterator[Finding]]

DATED_CHECKS: tuple[DatedCheck, ...] = (check_stored_calibration, check_fixture)
"""Checks that depend on the day too."""


def check(
    recipe: Recipe,
    bench: Bench,
    path: str | Path | None = None,
    today: date | None = None,
    *,
    in_record: bool = False,
) -> list[Problem]:
    """Return everything that speaks against this recipe on this bench, sorted by its place in the recipe.

    `path` replaces the recipe's path in the messages; `today` is the day that stored calibrations are judged by.
    `in_record`: the recipe is the copy in a record, which opens as ever, with options that were left empty.
    """
    findings = list(_other_side(recipe, bench))
    if not findings:
        findings += [finding for row in CHECKS for finding in row(recipe, bench)]
        day = today or datetime.now(tz=UTC).date()
        findings += [finding for row in DATED_CHECKS for finding in row(recipe, bench, day)]
    return _problems(recipe, [*findings, *(() if in_record else _empty_options(recipe))], path)


def check_alone(recipe: Recipe, path: str | Path | None = None) -> list[Problem]:
    """Return what speaks against a recipe whatever the bench: limits that none can fail or meet, and empty options."""
    return _problems(recipe, [*idle_limits(recipe), *unmet_limits(recipe), *_empty_options(recipe)], path)


def warnings(recipe: Recipe, bench: Bench | None = None, path: str | Path | None = None) -> list[Problem]:
    """Return what may be meant, but is not usual: limits of another magnitude, or on the side that decides nothing.

    With a bench also what of it is not usual for this recipe.
    """
    of_bench = () if bench is None else (*of_one_unit(recipe, bench), *without_noise(recipe, bench))
    return _problems(recipe, [*implausible_limits(recipe), *of_bench], path)


def _problems(recipe: Recipe, findings: Iterable[Finding], path: str | Path | None) -> list[Problem]:
    problems = {recipe.problem(*finding) for finding in findings}
    if path is not None:
        problems = {replace(one, path=str(path)) for one in problems}
    return sorted(problems, key=place)


def check_side(recipe: Recipe, bench: Bench) -> list[Problem]:
    """Return why a trace of this recipe cannot be from this bench: it loads the other shaft, or another model."""
    return [recipe.problem(*finding) for finding in _other_side(recipe, bench)]


def out_of_date(recipe: Recipe, bench: Bench, day: date) -> list[str]:
    """Return in words what of the bench, that this recipe measures by, was not in date on a day."""
    findings = (finding for row in DATED_CHECKS for finding in row(recipe, bench, day))
    return [f"{finding.found}; expected {finding.allowed}" for finding in findings]


def _empty_options(recipe: Recipe) -> Iterator[Finding]:
    """Options without a value: such a limit decides nothing, where its author meant to add a number.

    Refused here and not when a recipe is read: records have such recipes, and go on opening.
    """
    for option in recipe.empty_options():
        yield Finding(option, *NO_VALUE)


def _other_side(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    header = bench.bench
    if recipe.loading != header.loading:
        found = f"'{recipe.loading}', but the servo of bench '{header.name}' drives the {header.loading} shaft"
        yield Finding(("loading",), found, f"'{header.loading}' on this bench", "Choose a bench that loads this side.")
    model = recipe.unit_under_test.model
    if header.models and model not in header.models:
        found = f"'{model}', which bench '{header.name}' is not built for"
        yield Finding(("unit_under_test", "model"), found, one_of(header.models), "Choose another bench.")
