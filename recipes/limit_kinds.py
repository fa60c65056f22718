"""What a limit on a metric is for: which side decides, what can never fail, and the range in which limits lie.

Ranges are wide, a factor of ten about what reducers of robots and indexing tables have: they find a wrong unit or a
slipped digit, not a strict limit. Sources: catalogues of Nabtesco, SPINEA and Harmonic Drive (backlash and lost motion
below 1 to 3 arcmin, planetary gears up to 10), and the metrics of unit P1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from recipes.recipe_schema import Recipe

Scale = Callable[[Recipe], float]


class LimitKind(NamedTuple):
    """Row of `LIMIT_KINDS`."""

    decides: Literal["min", "max"]
    """Side on which a unit is bad; a limit on the other side alone lets every bad one pass."""
    least: float
    most: float
    """Range of a deciding limit, in the scale."""
    scale: Scale
    of: str = ""
    """What the scale is, in words; empty where it is the metric's own unit."""
    floor: float | None = None
    """Smallest value there is: a `min` up to it never fails."""
    ceiling: float | None = None
    """Largest value there is: a `max` from it on never fails."""


def _own(_recipe: Recipe) -> float:
    return 1.0


def _stiffness(recipe: Recipe) -> float:
    return recipe.unit_under_test.stiffness_nm_per_arcmin


def _windup(recipe: Recipe) -> float:
    """Wind-up between both reference torques by the catalogue, arcmin."""
    return 2.0 * recipe.measurement.reference_torque_nm / _stiffness(recipe)


def _energy(recipe: Recipe) -> float:
    return _windup(recipe) * recipe.measurement.reference_torque_nm


def _ratio(recipe: Recipe) -> float:
    return recipe.unit_under_test.ratio


def _friction(recipe: Recipe) -> float:
    return recipe.unit_under_test.rated_torque_nm


_PLAY = LimitKind("max", 0.01, 15.0, _own, floor=0.0)
_STIFFNESS = LimitKind("min", 0.1, 3.0, _stiffness, "the unit's catalogue stiffness", floor=0.0)

LIMIT_KINDS: dict[str, LimitKind] = {
    "backlash_width_3pct": _PLAY,
    "backlash_width_zero": _PLAY,
    "backlash_branches_3pct": _PLAY,
    "gear_clearance": _PLAY,
    "grade": LimitKind("max", 1.0, 2.0, _own, floor=1.0, ceiling=2.0),
    "lost_motion": _PLAY,
    "windup": LimitKind("max", 0.3, 10.0, _windup, "the wind-up by the catalogue stiffness", floor=0.0),
    "asymmetry_at_rated": LimitKind("max", 1.0, 600.0, _own, floor=0.0),
    "stiffness_lsq": _STIFFNESS,
    "stiffness_two_point": _STIFFNESS,
    "stiffness_end_point": _STIFFNESS,
    "stiffness_estimate": _STIFFNESS,
    "stiffness_50_100": _STIFFNESS,
    "stiffness_at": _STIFFNESS,
    "spring_constant": _STIFFNESS,
    "k1": _STIFFNESS,
    "k2": _STIFFNESS,
    "k3": _STIFFNESS,
    "hysteresis_energy": LimitKind(
        "max", 0.003, 1.0, _energy, "reference torque times the wind-up by the catalogue stiffness", floor=0.0
    ),
    "hysteresis_angle": LimitKind("max", 1.0, 900.0, _own, floor=0.0),
    "torque_ratio_slope": LimitKind("min", 0.5, 1.02, _ratio, "the ratio", floor=0.0),
    "torque_ratio_offset": LimitKind("min", -0.3, 0.0, _friction, "the rated torque"),
}
"""Kind of the limit of every metric."""
