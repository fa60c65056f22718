"""`alignment: two_speeds` needs cycles that show how the loop's width changes with the speed."""

from __future__ import annotations

from collections.abc import Iterator

from definitions.method import DIFFERENT_SPEED
from definitions.units import ARCMIN_PER_RAD, TORQUE
from recipes.checks.expectations import Finding
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.schema.sequence_schema import SpeedCycles, TorqueCycles
from recipes.text.document import OptionPath
from recipes.text.quantity import show

LEAST_CYCLES = 3
"""Cycles of which one more than two says how well the skew is known."""
ROUNDING = 1.0 + 1e-9
OPTION: OptionPath = ("measurement", "alignment")
BY_BENCH = "Add a block of cycles at another speed, or write 'declared' to use the lags of the bench file."

Ramps = TorqueCycles | SpeedCycles
"""Cycles that run at one speed; a staircase stands still where it is read."""


def check_two_speeds(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Cycles at two speeds that differ enough, with one peak: the width of a loop depends on where it turned."""
    if recipe.measurement.alignment != "two_speeds":
        return
    steps = [(index, step) for index, step in enumerate(recipe.sequence) if isinstance(step, Ramps)]
    speeds = [_windup_speed(recipe, bench, step) for _, step in steps]
    if not speeds or max(speeds) * ROUNDING < DIFFERENT_SPEED * min(speeds):
        found = "'two_speeds', but " + (
            f"cycles at {' and '.join(f'{speed:.3g}' for speed in sorted(set(speeds)))} arcmin/s of wind-up alone"
            if speeds
            else "no torque_cycles or speed_cycles"
        )
        allowed = f"torque_cycles or speed_cycles in sequence at two speeds that differ by {DIFFERENT_SPEED:g} times "
        yield Finding(OPTION, found, allowed + "or more", BY_BENCH)
        return
    cycles = sum(step.count for _, step in steps)
    if cycles < LEAST_CYCLES:
        hint = "Raise a count: two cycles do not say how well the delay is known."
        yield Finding(OPTION, f"'two_speeds' with {cycles} cycles", f"{LEAST_CYCLES} cycles or more", hint)
    first = steps[0][1].peak_torque_nm
    for index, step in steps[1:]:
        if abs(step.peak_torque_nm - first) * 1e9 > first:
            found = f"{show(step.peak_torque_nm, TORQUE)} beside {show(first, TORQUE)} with 'alignment: two_speeds'"
            hint = "The width of a loop depends on where it turned, and that would be taken for a delay."
            yield Finding(("sequence", index, step.kind, "peak_torque"), found, "one peak for all cycles", hint)


def _windup_speed(recipe: Recipe, bench: Bench, step: Ramps) -> float:
    """Speed of the wind-up at the output by the catalogue's stiffness [arcmin/s]."""
    unit = recipe.unit_under_test
    if isinstance(step, TorqueCycles):
        return step.torque_rate_nm_s / unit.stiffness_nm_per_arcmin
    loaded = step.speed_rad_s / bench.drive.gear_ratio * ARCMIN_PER_RAD
    return loaded / unit.ratio if recipe.loading == "input" else loaded
