"""What the tests of definitions share: two units in closed form, their loops, and one metric side by side."""

from __future__ import annotations

import numpy as np
from reference_unit import ARC, RATED_NM, ReferenceUnit, exact_trace

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.trace import SegmentInfo, Trace

METHOD = Method(ratio=121, rated_torque_nm=RATED_NM)

CRACKED = ReferenceUnit(negative_softer=1.2)
"""Its sides differ, so that a side taken for the other one shows."""

P1 = ReferenceUnit()
LOOP_OF_P1 = exact_trace(P1, 480.0)
CRACKED_LOOP = exact_trace(CRACKED, 480.0)


def sides(wanted: MetricWanted, trace: Trace = CRACKED_LOOP, method: Method = METHOD) -> dict[str, float | None]:
    (metric,) = analyse(trace, method, [wanted]).metrics
    assert not metric.reasons
    return {side.side: side.value for side in metric.sides}


def trace_of(torque: np.ndarray, curves: list[np.ndarray]) -> Trace:
    """Forward and return branches in turn, each given as wind-up [arcmin] over rising torque."""
    parts = [torque if number % 2 == 0 else torque[::-1] for number in range(len(curves))]
    angles = [curve if number % 2 == 0 else curve[::-1] for number, curve in enumerate(curves)]
    table = {number: SegmentInfo("measure", 1 - 2 * (number % 2), number // 2 + 1) for number in range(len(curves))}
    segment = np.repeat(np.arange(len(curves)), torque.size)
    return Trace(
        torque_out_nm=np.concatenate(parts), angle_out_rad=np.concatenate(angles) * ARC, segment=segment, segments=table
    )
