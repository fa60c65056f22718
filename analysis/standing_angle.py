"""An angle that stands while its shaft is loaded: an encoder that is saturated, has stopped, or lost its connection."""

from __future__ import annotations

import numpy as np

from analysis.measured import Measured

STANDING_COUNTS = 3.0
"""Counts of an encoder, in torque, that its angle may stand."""

WINDOWS = 10
"""Parts of a loading branch whose wind-up is compared."""

LEAST_SHARE = 0.1
"""Wind-up of a part, of the median of all parts: a unit that is ten times stiffer there is no unit."""


def angle_stands(found: Measured) -> float:
    """Largest share of a branch's torque, while loading, in which the loaded shaft's angle does not change at all.

    What `STANDING_COUNTS` counts of an encoder of this resolution take is left out.
    """
    trace = found.trace
    by_input = found.method.loading == "input" and trace.angle_in_rad is not None
    loaded = trace.angle_in_rad if by_input else trace.angle_out_rad
    worst = 0.0
    sides = [one for pair in found.pairs for one in pair]
    for one, some in zip(sides, found.blocks, strict=True):
        if loaded is None or len(one.run.pieces) > 1:
            continue
        loading = one.run.direction * one.torque_nm > 0.0
        torque, angle = one.torque_nm[loading], one.run.take(loaded)[one.masked :][loading]
        if not torque.size:
            continue
        starts = np.concatenate(([0], np.flatnonzero(angle[1:] != angle[:-1]) + 1))
        ends = np.append(starts[1:], angle.size) - 1
        way = float(np.ptp(torque))
        usual = STANDING_COUNTS * way / starts.size if starts.size > 1 else 0.0
        stood = float(np.abs(torque[ends] - torque[starts]).max()) - usual
        worst = max(worst, stood / float(np.ptp(some.torque_nm)))
    return worst


def windup_stands(found: Measured) -> float:
    """Largest share of a branch's torque, while loading, in which the wind-up all but stands or goes back.

    A saturated angle with noise does so, and one of which a wrong fixture takes more than there is.
    """
    worst = 0
    # A loop that gains energy runs the wrong way round: a gate of its own says so.
    for loop in (one for one in found.loops if one.energy_nm_arcmin >= 0.0):
        for side, branch in ((1, loop.forward), (-1, loop.backward)):
            peak = float(branch.torque_nm[-1] if side > 0 else -branch.torque_nm[0])
            if not peak > 0.0 or not branch.covers(min(0.0, side * peak), max(0.0, side * peak)):
                continue
            moves = np.diff(loop.loading(side, np.linspace(0.0, peak, WINDOWS + 1)))
            usual = float(np.median(np.abs(moves)))
            worst = max(worst, int(np.count_nonzero(moves <= LEAST_SHARE * usual)))
    return worst / (2.0 * WINDOWS)
