"""Maxwell-slip: springs that slip at their yield angles, beside springs that engage after a gap.

T = T₀ + Σ k_i s_i(φ) + Σ k_j side_j max(side_j (φ − φ_m) − from_j, 0). The slipping springs make the loop, the others
its stiffening. Parameters are plain numbers by name, elements counted from 1:
slip_1_stiffness, slip_1_yield_arcmin, …, spring_1_stiffness, spring_1_from_arcmin, spring_1_side, ….

Identified by non-negative least squares: linear, because yield angles and gaps are a given grid. Few elements of the
grid are left by themselves. Those that the loop cannot tell apart are merged: the smaller one is left out, named, and
the fit repeated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy  # loads optimize where it is used

from analysis.models.elements import maxwell_slip
from analysis.models.identify import MOST_CORRELATION, Identified, Refusal
from analysis.models.path import PathState, follow
from analysis.models.samples import LoopSamples
from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray, IntArray

NAME = "maxwell_slip"

EQUATIONS = (
    "T = T₀ + Σ k_i s_i + Σ k_j side_j max(side_j (φ − φ_m) − from_j, 0); s_i follows φ and slips at ± its yield angle"
)

TEXT = "Slipping springs and springs that engage after a gap, in parallel. Many parameters; the fit is linear."

COMMON = {"offset_nm": "N·m", "middle_arcmin": "arcmin"}
"""Parameters that the model has once, and their units: T₀ and φ_m."""

PER_ELEMENT = {
    "slip": {"stiffness": "N·m/arcmin", "yield_arcmin": "arcmin"},
    "spring": {"stiffness": "N·m/arcmin", "from_arcmin": "arcmin", "side": "1"},
}
"""Parameters that each element has, and their units."""

SLIPS = 16
"""Yield angles tried, by equal ratios from 1/2000 to 1/8 of the angle range: what slips later is an elastic spring."""

SPRINGS = 10
"""Springs tried per side, engaging at equal steps from the middle outwards."""

CONSTANTS = 2
"""Columns of the constant torque: +1 and −1, because no stiffness and so no column may be negative."""


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


def identify_maxwell_slip(loop: LoopSamples, slips: int = SLIPS, springs: int = SPRINGS) -> Identified:
    """Fit stiffnesses ≥ 0 to a loop; merged elements are named in `refused` and are not part of the model.

    The standard uncertainties hold for the elements that are left, yield angles and gaps taken as given (u = 0).
    Raises AnalysisError for a grid without elements or a fit that fails.
    """
    if slips < 1 or springs < 1:
        raise AnalysisError(f"model {NAME}: {slips} yield angles and {springs} gaps; expected one of each or more")
    low, high = loop.angle_range_arcmin
    half = 0.5 * (high - low)
    grid = Elements(
        half * np.geomspace(1e-3, 0.25, slips),
        np.tile(half * np.arange(springs) / springs, 2),
        np.repeat([1.0, -1.0], springs),
        0.5 * (low + high),
    )
    _, last = grid.torque_per_stiffness(loop.angle_arcmin, PathState())
    elements, _ = grid.torque_per_stiffness(loop.angle_arcmin, last)
    ones = np.ones((loop.torque_nm.size, 1))
    columns = np.hstack([ones, -ones, elements])
    size = np.sqrt(np.square(columns).mean(axis=0))
    allowed = size > 1e-9 * float(size.max())
    refused: list[Refusal] = []
    while True:
        found = _non_negative(columns, loop.torque_nm, allowed)
        used = np.flatnonzero(found > 0.0)
        residual = columns @ found - loop.torque_nm
        u, correlation = _covariance(columns[:, used], residual)
        pair = _hanging_together(correlation, used, size * found)
        if pair is None:
            return _identified(loop, grid, (found, used, u, correlation), residual, tuple(refused))
        weak, strong = (used[index] for index in pair)
        together = float(correlation[pair])
        refused.append(
            Refusal(_place(grid, weak), _place(grid, strong), together, f"merged: correlation {together:+.3f}")
        )
        allowed[weak] = False


def _hanging_together(correlation: FloatArray, used: IntArray, effect: FloatArray) -> tuple[int, int] | None:
    """Return the pair (smaller, larger effect) with the highest correlation, if that is too high."""
    together = np.abs(correlation - np.eye(used.size))
    # the constant is kept whatever it hangs together with
    together[used < CONSTANTS] = 0.0
    together[:, used < CONSTANTS] = 0.0
    if float(together.max(initial=0.0)) <= MOST_CORRELATION:
        return None
    first, second = (int(index) for index in np.unravel_index(int(np.argmax(together)), together.shape))
    return (first, second) if effect[used[first]] <= effect[used[second]] else (second, first)


def _non_negative(columns: FloatArray, torque_nm: FloatArray, allowed: BoolArray) -> FloatArray:
    scale = np.sqrt(np.square(columns[:, allowed]).sum(axis=0))
    try:
        found, _ = scipy.optimize.nnls(columns[:, allowed] / scale, torque_nm)
    except (RuntimeError, ValueError) as error:
        raise AnalysisError(f"model {NAME}: the fit fails on this loop: {error}; check the measured loop") from error
    stiffness = np.zeros(columns.shape[1])
    stiffness[allowed] = found / scale
    return stiffness


def _covariance(columns: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Standard uncertainties and correlation of a linear fit with these columns."""
    scale = np.sqrt(np.square(columns).sum(axis=0))
    covariance = np.linalg.pinv((columns / scale).T @ (columns / scale), hermitian=True)
    root = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    sd = np.sqrt(float(np.square(residual).sum()) / max(1, residual.size - scale.size))
    return sd * root / scale, np.clip(covariance / np.outer(root, root), -1.0, 1.0)


def _place(grid: Elements, column: int) -> str:
    """Name an element of the grid by where it is."""
    element = column - CONSTANTS
    if element < grid.yields_arcmin.size:
        return f"slip at {grid.yields_arcmin[element]:.4g} arcmin"
    spring = element - grid.yields_arcmin.size
    return f"spring from {grid.sides[spring] * grid.from_arcmin[spring]:+.4g} arcmin"


def _identified(
    loop: LoopSamples,
    grid: Elements,
    fit: tuple[FloatArray, IntArray, FloatArray, FloatArray],
    residual: FloatArray,
    refused: tuple[Refusal, ...],
) -> Identified:
    stiffness, used, u_used, correlation = fit
    values = {"offset_nm": float(stiffness[0] - stiffness[1]), "middle_arcmin": grid.middle_arcmin}
    constant = used < CONSTANTS
    u = {"offset_nm": float(u_used[constant].sum()), "middle_arcmin": 0.0}
    free: list[str] = []
    counts = {"slip": 0, "spring": 0}
    for column, spread in zip(used[~constant].tolist(), u_used[~constant].tolist(), strict=True):
        element = column - CONSTANTS
        spring = element - grid.yields_arcmin.size
        kind = "slip" if spring < 0 else "spring"
        counts[kind] += 1
        stem = f"{kind}_{counts[kind]}"
        values[f"{stem}_stiffness"], u[f"{stem}_stiffness"] = float(stiffness[column]), spread
        places = (
            {"yield_arcmin": grid.yields_arcmin[element]}
            if spring < 0
            else {"from_arcmin": grid.from_arcmin[spring], "side": grid.sides[spring]}
        )
        for name, place in places.items():
            values[f"{stem}_{name}"], u[f"{stem}_{name}"] = float(place), 0.0
        free.append(f"{stem}_stiffness")
    return Identified(
        model=NAME,
        values=values,
        u=u,
        free=tuple(free),
        correlation=correlation[np.ix_(~constant, ~constant)],
        refused=refused,
        at_bound=(),
        residual_pct=100.0 * float(np.sqrt(np.mean(residual**2))) / loop.peak_nm,
        worst_pct=100.0 * float(np.abs(residual).max()) / loop.peak_nm,
        peak_nm=loop.peak_nm,
        angle_range_arcmin=loop.angle_range_arcmin,
        samples=loop.torque_nm.size,
    )
