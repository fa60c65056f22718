"""Maxwell-slip: springs that slip at their yield angles, beside springs that engage after a gap.

T = T₀ + Σ k_i s_i(φ) + Σ k_j side_j max(side_j (φ − φ_m) − from_j, 0). The slipping springs make the loop, the others
its stiffening. Parameters are plain numbers by name, elements counted from 1:
slip_1_stiffness, slip_1_yield_arcmin, …, spring_1_stiffness, spring_1_from_arcmin, spring_1_side, ….
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from analysis.models.friction import maxwell_slip
from analysis.models.path import PathState, follow
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

NAME = "maxwell_slip"

EQUATIONS = (
    "T = T₀ + Σ k_i s_i + Σ k_j side_j max(side_j (φ − φ_m) − from_j, 0); s_i follows φ and slips at ± its yield angle"
)

TEXT = "Slipping springs beside springs behind a gap: many parameters, all of them linear."

COMMON = {"offset_nm": "N·m", "middle_arcmin": "arcmin"}
"""Parameters that the model has once, and their units: T₀ and φ_m."""

PER_ELEMENT = {
    "slip": {"stiffness": "N·m/arcmin", "yield_arcmin": "arcmin"},
    "spring": {"stiffness": "N·m/arcmin", "from_arcmin": "arcmin", "side": "1"},
}
"""Parameters that each element has, and their units."""


class Elements(NamedTuple):
    """Places of the elements: yield angles; angles from the middle at which springs engage, and side (+1, −1)."""

    yields_arcmin: FloatArray
    from_arcmin: FloatArray
    sides: FloatArray
    middle_arcmin: float

    def torque_per_stiffness(self, angle_arcmin: FloatArray, state: PathState) -> tuple[FloatArray, PathState]:
        """Torque [N·m] per N·m/arcmin of each element (slips, then springs) along angles [arcmin]; one column each."""
        count = self.yields_arcmin.size
        slipping, last = follow(angle_arcmin, state, self.middle_arcmin, count, maxwell_slip(self.yields_arcmin))
        turned = (np.asarray(angle_arcmin, dtype=np.float64) - self.middle_arcmin)[:, None] * self.sides
        springs = np.maximum(turned - self.from_arcmin, 0.0) * self.sides
        return np.hstack([slipping, springs]), last


def play_maxwell_slip(
    values: Mapping[str, float], angle_arcmin: FloatArray, state: PathState
) -> tuple[FloatArray, PathState]:
    """Torque [N·m] along angles [arcmin] for named parameters."""
    slips, springs = (_numbered(values, kind) for kind in ("slip", "spring"))
    elements = Elements(
        np.array([values[f"slip_{n}_yield_arcmin"] for n in slips]),
        np.array([values[f"spring_{n}_from_arcmin"] for n in springs]),
        np.array([values[f"spring_{n}_side"] for n in springs]),
        values["middle_arcmin"],
    )
    stiffness = np.array(
        [*(values[f"slip_{n}_stiffness"] for n in slips), *(values[f"spring_{n}_stiffness"] for n in springs)]
    )
    per_stiffness, last = elements.torque_per_stiffness(angle_arcmin, state)
    torque: FloatArray = values["offset_nm"] + per_stiffness @ stiffness
    return torque, last


def parameter_units(values: Mapping[str, float]) -> dict[str, str]:
    """Return the parameters that belong to the elements counted in `values`, in order, with their units."""
    units = dict(COMMON)
    for kind, parts in PER_ELEMENT.items():
        for number in _numbered(values, kind):
            units.update({f"{kind}_{number}_{part}": unit for part, unit in parts.items()})
    return units


def checked_maxwell_slip(values: Mapping[str, float]) -> dict[str, float]:
    """Return all parameters in order; AnalysisError for one that is missing, unknown, not finite or below zero."""
    units = parameter_units(values)
    unknown = [name for name in values if name not in units]
    missing = [name for name in units if name not in values]
    if unknown or missing:
        raise AnalysisError(
            f"model {NAME}: unknown parameters: {', '.join(unknown) or 'none'}; "
            f"missing: {', '.join(missing) or 'none'}; expected {', '.join(units)}"
        )
    for name in units:
        value, sided = values[name], name.endswith("_side")
        allowed = abs(value) == 1.0 if sided else value >= 0.0 or name in COMMON
        if not (math.isfinite(value) and abs(value) <= 1e9 and allowed):
            needed = "1 or -1" if sided else "a finite number up to 1e9, not below zero for an element"
            raise AnalysisError(f"model {NAME}: {name}: found {value}; expected {needed}")
    return {name: float(values[name]) for name in units}


def _numbered(values: Mapping[str, float], kind: str) -> list[int]:
    """Return the numbers of the elements of a kind: from 1 as long as there is a stiffness."""
    return list(itertools.takewhile(lambda number: f"{kind}_{number}_stiffness" in values, itertools.count(1)))
