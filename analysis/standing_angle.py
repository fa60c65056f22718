"""An angle that stands while its shaft is loaded: an encoder that is saturated, has stopped, or lost its connection."""

from __future__ import annotations

import numpy as np

from analysis.measured import Measured

STANDING_COUNTS = 3.0
"""Counts of an encoder, in torque, that its angle may stand."""


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
        if loaded is None or one.masked or len(one.run.pieces) > 1:
            continue
        loading = one.run.direction * one.torque_nm > 0.0
        torque, angle = one.torque_nm[loading], one.run.take(loaded)[loading]
        if not torque.size:
            continue
        starts = np.concatenate(([0], np.flatnonzero(angle[1:] != angle[:-1]) + 1))
        ends = np.append(starts[1:], angle.size) - 1
        way = float(np.ptp(torque))
        usual = STANDING_COUNTS * way / starts.size if starts.size > 1 else 0.0
        stood = float(np.abs(torque[ends] - torque[starts]).max()) - usual
        worst = max(worst, stood / float(np.ptp(some.torque_nm)))
    return worst
