"""Figures of the validity checks that ask whether a loop can be a reducer's at all: its stiffness, and what it loses.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from analysis.loop.loop import Loop
from analysis.loop.measured import Measured
from analysis.validity.evidence import NO_SPAN, Figure, Reading, has_span, of_measured, span_arcmin

SECANT = (0.25, 0.75)
"""Torques between which the stiffness is read, of the lesser of peak and reference torque: beyond play and reversal."""


@of_measured
def stiffness_low(found: Measured) -> Reading | str:
    """Secant stiffness of the loops over that of the catalogue; the softer side."""
    if found.angles == "given":
        return "a wind-up computed elsewhere may include its fixture, so its stiffness cannot be checked"
    return _stiffness(found, min)


@of_measured
def stiffness_high(found: Measured) -> Reading | str:
    """Secant stiffness of the loops over that of the catalogue; the stiffer side."""
    return _stiffness(found, max)


def _stiffness(found: Measured, side: Callable[[list[float]], float]) -> Reading | str:
    """Return the stiffness of the side over the declared one.

    A factor tells a wrong unit or scale of angle or torque, which every metric of the loop carries unseen.
    """
    declared = found.method.catalogue_stiffness_nm_per_arcmin
    if declared is None:
        return "no stiffness is declared for the unit"
    secants = [_secant_nm_per_arcmin(loop, way) for loop in found.loops for way in (1, -1)]
    if any(one is None for one in secants):
        return "a loop does not pass through zero torque"
    worst = side([one for one in secants if one is not None])
    words = (
        f"the loop has {worst:.3g} N·m/arcmin, and the recipe declares {declared:g} for this unit: "
        "an angle or a torque is in another unit or scale"
    )
    return Reading(worst / declared, words)


def _secant_nm_per_arcmin(loop: Loop, side: int) -> float | None:
    """Secant of the mean curve in the middle of one side, N·m/arcmin; None where the loop has no such side."""
    ends = (loop.forward.torque_nm, loop.backward.torque_nm)
    peak = min(float(one[-1] if side > 0 else -one[0]) for one in ends)
    low, high = (part * min(peak, loop.reference_nm) for part in SECANT)
    if not peak > 0.0 or not all(branch.covers(*sorted((side * low, side * high))) for branch in
                                 (loop.forward, loop.backward)):  # fmt: skip
        return None
    way = side * (loop.mean_at(side * high) - loop.mean_at(side * low))
    return (high - low) / way if way else math.inf


@of_measured
def loss(found: Measured) -> Reading | str:
    """Energy of the cycle that loses least, % of the rectangle of torque and wind-up that its loop stands in."""
    if not has_span(found):
        return Reading(-math.inf, NO_SPAN)
    way = float(found.loops[0].forward.torque_nm[-1] - found.loops[0].forward.torque_nm[0])
    least = min(loop.energy_nm_arcmin for loop in found.loops)
    return Reading(100.0 * least / (way * span_arcmin(found)))


FIGURES: dict[str, Figure] = {
    "stiffness_low": stiffness_low,
    "stiffness_high": stiffness_high,
    "loss": loss,
}
"""Figures of these checks, by their ids."""
