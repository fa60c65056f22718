"""A torque column in another unit than N·m, told by the peak that the recipe plans: a hint beside the verdict."""

from __future__ import annotations

import numpy as np

from analysis.trace.trace import Trace
from recipes import Recipe, SpeedCycles, StepCycles, TorqueCycles

TORQUE_UNITS: dict[str, float] = {
    "lbf·ft": 1.0 / 1.355_817_9,
    "lbf·in": 1.0 / 0.112_984_83,
    "kgf·m": 1.0 / 9.806_65,
    "kgf·cm": 100.0 / 9.806_65,
    "N·cm": 100.0,
    "N·mm": 1000.0,
    "kN·m": 0.001,
}
"""Units of torque that recorders have, with the number that stands for 1 N·m."""

NEAR = 0.03
"""Peaks of cycles keep to the plan within this; the factors above lie farther apart, and from one."""

TO_A_PEAK = (TorqueCycles, SpeedCycles, StepCycles)
"""Cycles that turn round at the torque that the recipe plans."""

NEARER = 0.15
"""Share within which the stiffness over that of the catalogue tells the unit: units of torque differ by more."""


def in_other_unit(hint: str, stiffness: float | None) -> bool:
    """Say whether a torque is in the unit that a hint names: the unit under test is then softer by as much.

    stiffness: of the loop over that of the catalogue; None where it is not known, and the peak alone tells. A cycle
    that went to a lower peak on purpose has the stiffness of the catalogue.
    """
    factors = [factor for unit, factor in TORQUE_UNITS.items() if f"in {unit} " in hint]
    return bool(factors) and (stiffness is None or abs(stiffness / factors[0] - 1.0) < NEARER)


def torque_unit_hint(trace: Trace, recipe: Recipe) -> str:
    """Say which unit the torque at the output seems to be in, '' where its peak is no such part of the planned one."""
    planned = [one.peak_torque_nm for one in recipe.sequence if isinstance(one, TO_A_PEAK)]
    torque = trace.torque_out_nm
    if not planned or torque is None:
        return ""
    used = torque
    if trace.segment is not None:
        measured = [key for key, one in trace.segments.items() if one.role == "measure"]
        used = torque[np.isin(trace.segment, measured)]
    if not used.size:
        return ""
    share = float(np.abs(used).max()) / max(planned)
    near = [unit for unit, factor in TORQUE_UNITS.items() if abs(share / factor - 1.0) < NEAR]
    if not near:
        return ""
    return (
        f"the largest torque is {share:.3g} times the planned {max(planned):.4g} N·m, as if the column torque_out_nm "
        f"were in {near[0]} ({TORQUE_UNITS[near[0]]:.4g} {near[0]} are 1 N·m): check the unit of this column"
    )
