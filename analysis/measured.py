"""What the stages made of a trace, and how it was recorded: all that gates and metrics are read from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from analysis.alignment import Skew
from analysis.branches import Blocks
from analysis.drift import Drift, Pairs
from analysis.errors import AnalysisError
from analysis.fixture_curve import Angles
from analysis.loop import Loop
from analysis.method import Method
from analysis.quadrants import Quadrants
from analysis.runs import Run
from analysis.stages import StageRecord
from analysis.trace import Trace


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


@dataclass(frozen=True)
class RunFacts:
    """How a trace was recorded, as the record of the run says; None in `Evidence` for a trace from elsewhere.

    periods: scan periods that should have been, missed: those that were not; missed_allowed: share of them that may.
    oldest_sample_scans and sample_age_allowed_scans: age of samples while measuring. The others count samples whose
    status said so.
    """

    periods: int
    missed: int
    missed_allowed: float
    oldest_sample_scans: int
    sample_age_allowed_scans: int
    torque_in_saturated: int = 0
    torque_out_saturated: int = 0
    not_ready: int = 0


@dataclass(frozen=True)
class Evidence:
    """All that validity gates look at; `measured` is None when the trace could not be evaluated at all.

    noise_declared: a bench is known whose sensors have noise. torque_out_zero_nm: limit that is declared of the zero of
    the output torque [N·m]; 0 where nothing is. torque_noise_nm: standard deviation declared of a torque channel.
    """

    measured: Measured | None
    facts: RunFacts | None = None
    objections: tuple[str, ...] = ()
    noise_declared: bool = False
    torque_out_zero_nm: float = 0.0
    torque_noise_nm: Mapping[str, float] = field(default_factory=dict)
