"""The stages in their order: from a trace to the loops that metrics are read from.

Order: common clock; wind-up; turning points; virgin quarter dropped; output torque; drift; fixture; branches; bins;
monotone regression; reversal zones; fits. Each stage is a function of its own module and leaves a record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from analysis.loop.alignment import MOST_ROUNDS, Skew, align, skew_of_cycles
from analysis.loop.branches import Blocks, binned, branch_records, monotone
from analysis.loop.drift import Drift, Pairs, correct_drift
from analysis.loop.fixture_curve import Angles
from analysis.loop.interruptions import (
    Interruption,
    interruption_records,
    interruptions_of,
    of_branch,
    without_interruptions,
)
from analysis.loop.loop import Loop, fit_record, reversal_record
from analysis.loop.method import Method
from analysis.loop.samples import converts, evaluated_samples
from analysis.loop.stages import StageRecord
from analysis.loop.windup import correct_fixture, measured_windup
from analysis.torque_ratio.quadrants import Quadrants
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import Run
from analysis.trace.trace import Trace


@dataclass(frozen=True)
class Measured:
    """Outcome of every stage: `blocks` and `pairs` are corrected, rising and falling branch of each cycle in turn.

    trace: on a common clock. recorded: the same samples before channels were moved, which smooths their noise.
    """

    trace: Trace
    method: Method
    runs: Sequence[Run]
    angles: Angles
    skew: Skew
    drift: Drift
    quadrants: Quadrants | AnalysisError
    pairs: Pairs
    blocks: Sequence[Blocks]
    loops: Sequence[Loop]
    stages: Sequence[StageRecord]
    recorded: Trace
    interruptions: Sequence[Interruption] = ()
    """Stretches of the branches that are left out of the loops; `blocks` and `pairs` have them still."""

    @cached_property
    def read(self) -> dict[str, Any]:
        """What several checks read of it, by name: each is made when it is first asked for."""
        return {}


def measure(trace: Trace, method: Method, *, with_ratio: bool = False) -> Measured:
    """Run the stages on a trace, up to the loops that metrics are read from.

    with_ratio: the torque ratio is wanted for its own sake too. Raises AnalysisError for a trace without what the
    method needs.
    """
    if method.alignment == "two_speeds":
        found = _by_two_speeds(trace, method, with_ratio=with_ratio)
    else:
        found = _stages(*align(trace, method), method, with_ratio=with_ratio)
    return replace(found, recorded=trace)


def _by_two_speeds(trace: Trace, method: Method, *, with_ratio: bool) -> Measured:
    """Run the stages with the skew of torque and angle that the cycles themselves show."""
    found = _stages(*align(trace, replace(method, alignment="report")), method, with_ratio=with_ratio)
    left = estimated = skew_of_cycles(found.loops, found.pairs)
    for _ in range(MOST_ROUNDS):
        found = _stages(*align(trace, method, estimated), method, with_ratio=with_ratio)
        # The speed is not the same along a ramp of torque: what one round leaves, the next one finds.
        left = skew_of_cycles(found.loops, found.pairs)
        if left.settled:
            break
        estimated = replace(left, skew_s=estimated.skew_s + left.skew_s)
    else:
        found = _stages(*align(trace, method, estimated), method, with_ratio=with_ratio)
    # Noise that is moved is another noise: below that an estimate does not settle, and is not known any better.
    u_s = max(estimated.standard_error_s or 0.0, abs(left.skew_s))
    return replace(found, skew=replace(found.skew, u_s=u_s))


def _stages(trace: Trace, skew: Skew, method: Method, *, with_ratio: bool) -> Measured:
    windup = measured_windup(trace, method)
    samples = evaluated_samples(trace, method, windup.arcmin, with_ratio=with_ratio)
    pairs: Pairs = samples.pairs
    blocks = _binned(pairs)
    pairs_now, drift = correct_drift(pairs, blocks, method)
    pairs_now, fixture = correct_fixture(pairs_now, windup.angles, method)
    if pairs_now is not pairs:
        blocks = _binned(pairs_now)
    sides = [one for pair in pairs_now for one in pair]
    broken = interruptions_of(sides)
    whole = [
        without_interruptions(some, of_branch(broken, one.cycle, one.run.direction))
        for some, one in zip(blocks, sides, strict=True)
    ]
    branches = [monotone(some, one.run.direction, one.where) for some, one in zip(whole, sides, strict=True)]
    loops = [Loop(rising, falling, method) for rising, falling in zip(branches[::2], branches[1::2], strict=True)]
    stages = (
        skew.record, windup.record, *samples.records, drift.record, fixture,
        *interruption_records(broken), *branch_records(pairs_now, blocks, branches), reversal_record(loops),
        fit_record(loops),
    )  # fmt: skip
    return Measured(
        trace, method, samples.runs, windup.angles, skew, drift, samples.quadrants, pairs_now, blocks, loops, stages,
        recorded=trace, interruptions=broken,
    )  # fmt: skip


def loops_by_output(found: Measured) -> Sequence[Loop]:
    """Return the loops by the torque at the output where it was measured beside one that is converted; else none."""
    if not converts(found.trace, found.method) or found.trace.torque_out_nm is None:
        return ()
    try:
        # the trace is aligned, and drift is what it was: the angles are the same
        return _stages(found.trace, found.skew, replace(found.method, output_torque="reaction"), with_ratio=False).loops
    except AnalysisError:
        return ()  # the sensor was not there while measuring


def _binned(pairs: Pairs) -> list[Blocks]:
    return [binned(one) for pair in pairs for one in pair]
