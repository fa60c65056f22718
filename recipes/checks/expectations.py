"""What a cross check found, and the torques and angles that the checks expect of a unit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from definitions.units import ARCMIN_PER_RAD
from recipes.schema.recipe_schema import Recipe
from recipes.schema.sequence_schema import (
    Calibrate,
    Cycles,
    FatigueCycles,
    SpeedCycles,
    StepCycles,
    TorqueCycles,
    TorqueSweep,
)
from recipes.text.problems import OptionPath

Loaded = Calibrate | TorqueCycles | SpeedCycles | StepCycles | FatigueCycles | TorqueSweep
"""Steps that load the unit."""


class Finding(NamedTuple):
    """Option in the recipe, what was found, what is allowed, what to do."""

    option: OptionPath
    found: str
    allowed: str
    hint: str = ""


def loaded_steps(recipe: Recipe) -> Iterator[tuple[OptionPath, Loaded]]:
    """Yield the steps that load the unit, each with the path of its options."""
    for index, step in enumerate(recipe.sequence):
        if isinstance(step, Calibrate | Cycles | TorqueSweep):
            yield ("sequence", index, step.kind), step


def input_torque_nm(recipe: Recipe, output_nm: float) -> float:
    """Torque at the input shaft for a torque at the output [N·m].

    Loading the input, friction has to be overcome (the loading line of the recipe); loading the output, the locked
    input carries at most the torque without any friction.
    """
    unit = recipe.unit_under_test
    if recipe.loading == "output":
        return output_nm / unit.ratio
    return (output_nm - unit.loading_torque_ratio.offset_nm) / unit.loading_torque_ratio.slope


def output_torque_nm(recipe: Recipe, input_nm: float) -> float:
    """Torque at the output for a torque at the input [N·m]: the inverse of `input_torque_nm`."""
    unit = recipe.unit_under_test
    if recipe.loading == "output":
        return input_nm * unit.ratio
    return input_nm * unit.loading_torque_ratio.slope + unit.loading_torque_ratio.offset_nm


def loaded_torque_nm(recipe: Recipe, output_nm: float) -> float:
    """Torque at the shaft that the servo drives [N·m]."""
    return output_nm if recipe.loading == "output" else input_torque_nm(recipe, output_nm)


def locked_torque_nm(recipe: Recipe, output_nm: float) -> float:
    """Torque at the shaft that the lock holds [N·m]."""
    return output_nm if recipe.loading == "input" else input_torque_nm(recipe, output_nm)


def windup_rad(recipe: Recipe, torque_nm: float) -> float:
    """Wind-up at the loaded shaft by a torque at the output, from the unit's catalogue stiffness [rad]."""
    unit = recipe.unit_under_test
    at_output = torque_nm / unit.stiffness_nm_per_arcmin / ARCMIN_PER_RAD
    return at_output * unit.ratio if recipe.loading == "input" else at_output
