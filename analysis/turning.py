"""Stages that say which samples are evaluated: turning points, and what is left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from analysis.method import Method
from analysis.runs import Run, commanded_runs, found_runs
from analysis.stages import Figure, StageRecord
from analysis.trace import Trace

EVALUATED = ("measure", "calibrate")
"""Roles of the runs that are evaluated."""


def converts(trace: Trace, method: Method) -> bool:
    """Say whether input torque is to be converted; output torque alone was converted by somebody before."""
    return method.output_torque == "calibrated" and not (trace.torque_in_nm is None and trace.torque_out_nm is not None)


def turning_points(trace: Trace, method: Method) -> tuple[list[Run], StageRecord]:
    """Return all runs of one direction, from the commanded segments or from turning points found on the torque.

    Raises AnalysisError when there are no segments and the torque is missing or never turns.
    """
    runs = commanded_runs(trace)
    text = "branches: from the commanded segments"
    if not runs:
        column = "torque_in_nm" if converts(trace, method) else "torque_out_nm"
        runs = found_runs(trace.channel(column, "the turning points"))
        text = "branches: turning points found on the curve, no segments in the trace"
    return runs, StageRecord("turning points", text, {"runs": Figure(len(runs), "1")})


def virgin_quarter(runs: Sequence[Run]) -> StageRecord:
    """Say which runs are not evaluated: their role keeps them out of the branches and of the torque ratio."""
    dropped = [run for run in runs if run.role not in EVALUATED]
    roles = Counter(run.role for run in dropped)
    text = f"not evaluated: {', '.join(roles)}" if dropped else "every run is evaluated"
    figures = {f"{role} runs": Figure(count, "1") for role, count in roles.items()}
    samples = sum(piece.stop - piece.start for run in dropped for piece in run.pieces)
    return StageRecord("virgin quarter", text, figures | {"samples": Figure(samples, "1")}, applied=bool(dropped))
