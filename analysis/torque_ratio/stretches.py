"""Two groups of runs held against each other stretch by stretch: what a change of friction in between leaves unsaid.

Friction that changed moves the lines of loading and unloading against each other, by a part that grows with the load
and one that does not. What is left beyond that in a stretch is no friction: a zero moved there for a while.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from analysis.torque_ratio.line_fit import fit_torque_ratio
from analysis.trace.units import FloatArray

STRETCH, LEAST_IN_STRETCH = 0.1, 5
"""Share of the peak torque of the calibration over which torques are averaged, and points of each that it takes."""

FRICTION_TERMS = 2
"""Terms that friction may have changed by: without load, and with it."""

AT_NO_LOAD = 0.25
"""Share of the limit at half of the peak torque that is allowed at no load; from there it grows with the torque.

Friction under load is never twice the same, and what differs grows with the load. A zero that moves does not, and an
offset is read where there is none.
"""

WAYS = {"load": 1.0, "unload": -1.0}
"""Way of the lines by the first word of their names."""

Points = Mapping[str, tuple[FloatArray, FloatArray]]
"""Input and output torques by quadrant."""


class Stretch(NamedTuple):
    """A stretch of torque on a line: by how much the calibration is beyond the cycles there, as torque while loading.

    way: 1 while loading, -1 while unloading. torque_nm: its middle. u_nm: of apart_nm, by the scatter of the points
    within. allowed: over what is allowed at half of the peak torque.
    """

    way: float
    torque_nm: float
    apart_nm: float
    u_nm: float
    allowed: float


def stretches_of(calibration: Points, cycles: Points, side: str, peak_nm: float) -> list[Stretch]:
    """Return what the calibration is beyond the cycles on both lines of a side, from straight lines of the cycles.

    side: "positive" or "negative". peak_nm: largest output torque of the calibration. A stretch with too few points of
    either has no row; lines of the cycles that do not rise have none at all. Raises AnalysisError where the cycles
    carry no line.
    """
    sign = 1.0 if side == "positive" else -1.0
    found: list[Stretch] = []
    lines = {way: fit_torque_ratio(*cycles[f"{name}_{side}"]) for name, way in WAYS.items()}
    if not min(line.slope for line in lines.values()) > 0.0:
        return found
    for name, way in WAYS.items():
        # Friction is alike both ways as torque at the input, so all is told as torque by the slope of loading.
        line, scale = lines[way], lines[1.0].slope / lines[way].slope
        pairs = (points[f"{name}_{side}"] for points in (calibration, cycles))
        parts = [(sign * y, scale * (y - line.torque_out_nm(x))) for x, y in pairs]
        for low in np.arange(0.0, 1.0, STRETCH):
            within = [left[(at >= low * peak_nm) & (at < (low + STRETCH) * peak_nm)] for at, left in parts]
            if min(left.size for left in within) < LEAST_IN_STRETCH:
                continue
            apart = float(within[0].mean() - within[1].mean())
            u = math.sqrt(sum(float(left.var(ddof=1)) / left.size for left in within))
            middle = float(low) + STRETCH / 2.0
            allowed = AT_NO_LOAD + 2.0 * (1.0 - AT_NO_LOAD) * middle
            found.append(Stretch(way, sign * middle * peak_nm, apart, u, allowed))
    return found


def beyond_friction(stretches: Sequence[Stretch]) -> Sequence[float]:
    """Return what is left of each stretch, N·m, when friction may have changed; too few of them say nothing."""
    if len(stretches) <= FRICTION_TERMS:
        return [0.0] * len(stretches)
    way, torque, apart, allowed = (
        np.array([getattr(one, name) for one in stretches]) for name in ("way", "torque_nm", "apart_nm", "allowed")
    )
    terms = np.column_stack((way, way * torque))
    changed = np.linalg.lstsq(terms / allowed[:, np.newaxis], apart / allowed, rcond=None)[0]
    left: list[float] = (apart - terms @ changed).tolist()
    return left
