"""What validity checks look at, and what the figure of one is: a number with words, or why it does not apply."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import NamedTuple, TypeVar

from analysis.loop.measured import Measured
from analysis.uncertainty.figures import TORQUES, SensorFigures, TorqueChannel
from analysis.validity.ramp_ends import Lateness
from definitions.units import ARCMIN_PER_RAD

NOT_EVALUATED = "the trace could not be evaluated"
NO_SPAN = "the wind-up does not change over the cycle"

MIDDLE = 0.8
"""Share of the peak torque up to which branches are compared: beyond it friction may still be reversing."""

LEAST_SPAN_ARCMIN = 1e-9
"""A wind-up below this is rounding: nothing is a share of it."""


@dataclass(frozen=True)
class RunFacts:
    """How a trace was recorded, as the record of the run says; None in `Evidence` for a trace from elsewhere.

    periods: scan periods that should have been, missed: those that were not; missed_allowed: share of them that may.
    oldest_sample_scans and sample_age_allowed_scans: age of samples while measuring. The others count samples whose
    status said so. zeroes_again: samples of the torque zeroes that were read after the run, None in records of versions
    that read none; the zero shifts are their means, less the zeroes before the run. bench_waited: the bench was a
    virtual one that waits for the scan, so that nothing could be missed. holds: how often a ramp was held, by the
    reaction that the record has; None where nobody has asked.
    """

    periods: int
    missed: int
    missed_allowed: float
    oldest_sample_scans: int
    sample_age_allowed_scans: int
    torque_in_saturated: int = 0
    torque_out_saturated: int = 0
    not_ready: int = 0
    bench_waited: int = 0
    zeroes_again: int | None = None
    torque_in_zero_shift_nm: float | None = None
    torque_out_zero_shift_nm: float | None = None
    holds: int | None = None

    def zero_shift_nm(self, name: TorqueChannel) -> float | None:
        """Return by how much the zero of a torque channel moved in the run; None where it was not read again."""
        return self.torque_in_zero_shift_nm if name == "torque_in_nm" else self.torque_out_zero_shift_nm


@dataclass(frozen=True)
class Evidence:
    """All that validity checks look at; `measured` is None when the trace could not be evaluated at all.

    noise_declared: a bench is known whose sensors have noise. torque_out_zero_nm: limit that is declared of the zero of
    the output torque [N·m]; 0 where nothing is. torque_out_reversibility_nm: the same of its hysteresis.
    torque_noise_nm: standard deviation declared of a torque channel. late: how late the torque is behind the wind-up,
    or why nothing tells it. torque_gain: gain error that is declared of both torque sensors together, relative; None
    where nothing is. zero_moves_nm: by how much the zero of a torque channel may move in a run: friction at rest alone,
    and the largest move; of the channels whose sensors are declared. angle_wave_arcmin: peak that is declared of the
    error within a line of the loaded shaft's encoder, at the output.
    """

    measured: Measured | None
    facts: RunFacts | None = None
    objections: tuple[str, ...] = ()
    noise_declared: bool = False
    torque_out_zero_nm: float = 0.0
    torque_out_reversibility_nm: float = 0.0
    torque_noise_nm: Mapping[str, float] = field(default_factory=dict)
    late: Lateness | str = NOT_EVALUATED
    torque_gain: float | None = None
    zero_moves_nm: Mapping[TorqueChannel, tuple[float, float]] = field(default_factory=dict)
    angle_wave_arcmin: float = 0.0


def evidence_of(
    found: Measured, facts: RunFacts | None, objections: tuple[str, ...], figures: SensorFigures | None,
    late: Lateness | str,
) -> Evidence:  # fmt: skip
    """Return what checks look at for a trace that was evaluated; figures: what is declared of the sensors, if known."""
    evidence = Evidence(found, facts, objections, late=late)
    if figures is None:
        return evidence
    return replace(
        evidence,
        noise_declared=figures.noisy,
        torque_out_zero_nm=figures.torque_out_zero_nm,
        torque_out_reversibility_nm=figures.torque_out_reversibility_nm,
        torque_noise_nm=figures.torque_noise_nm,
        torque_gain=figures.torque_gain,
        zero_moves_nm={name: move for name in TORQUES if (move := figures.zero_move_nm(name)) is not None},
        angle_wave_arcmin=_declared_wave_arcmin(found, figures),
    )


def _declared_wave_arcmin(found: Measured, figures: SensorFigures) -> float:
    by_input = found.method.loading == "input"
    encoder, over = (figures.angle_in, found.method.ratio) if by_input else (figures.angle_out, 1.0)
    return 0.0 if encoder is None else encoder.interpolation_rad * ARCMIN_PER_RAD / over


class LeftOpen(NamedTuple):
    """Largest error that passes a check, in the unit of that error: so much for each unit of its limit, and so much.

    words: that say more of what is left open.
    """

    for_each: float
    besides: float = 0.0
    words: str = ""


class Reading(NamedTuple):
    """Figure of a check in its unit, and words that say more than the check's own; infinity where there is none.

    left_open: of a check that says which error it cannot see.
    """

    figure: float
    words: str = ""
    left_open: LeftOpen | None = None


Found = TypeVar("Found")

Figure = Callable[[Evidence], Reading | str]
"""What a check looks at: its figure, or in words why it does not apply."""


def of_measured(figure: Callable[[Measured], Reading | str]) -> Figure:
    """Make a check's figure of one that reads the evaluated trace: without, it does not apply."""

    @wraps(figure)
    def read(evidence: Evidence) -> Reading | str:
        return NOT_EVALUATED if evidence.measured is None else figure(evidence.measured)

    return read


def once(read: Callable[[Measured], Found]) -> Callable[[Measured], Found]:
    """Make what several checks read of an evaluated trace once: it is kept with the trace."""

    @wraps(read)
    def kept(found: Measured) -> Found:
        if read.__qualname__ not in found.read:
            found.read[read.__qualname__] = read(found)
        known: Found = found.read[read.__qualname__]
        return known

    return kept


def of_span(found: Measured, arcmin: float, words: str = "") -> Reading:
    """Return an angle as a share of the wind-up, %; infinity, in plain words, where there is none to be a share of."""
    return Reading(100.0 * arcmin / span_arcmin(found), words) if has_span(found) else Reading(math.inf, NO_SPAN)


def has_span(found: Measured) -> bool:
    """Say whether the wind-up changes over the first cycle at all."""
    return span_arcmin(found) > LEAST_SPAN_ARCMIN


def span_arcmin(found: Measured) -> float:
    """Wind-up between the turning points of the first cycle, arcmin: what shares of the wind-up are of."""
    loop = found.loops[0]
    ends = [float(branch.angle_arcmin[end]) for branch in (loop.forward, loop.backward) for end in (0, -1)]
    return max(ends) - min(ends)
