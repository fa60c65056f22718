"""Figure of the validity check that asks whether torque and wind-up come to rest together at the ends of ramps.

On a steady ramp a late channel reads as friction does; nothing tells them apart. Where a ramp ends and a dwell begins
friction keeps its side, and torque and wind-up slow down together, whatever the unit is like. A channel that is late
slows down late. The figure does not depend on what anybody says of the channels.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from analysis.loop.measured import Measured
from analysis.loop.windup import measured_windup
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from analysis.validity.evidence import Figure, Reading, of_measured

BEFORE_S, AFTER_S = (0.15, 0.35), 0.2
"""What is looked at before and after the end of a ramp, at least and at most; of a dwell as much as there is."""

BEFORE_SHARE = 0.04
"""Share of the torque at the end that is looked at before it: over more of it the unit's stiffness grows."""

LEAST_AFTER_S = 0.08
"""A dwell that is shorter does not show where the ramp ended."""

STEP_S = 1e-3
"""Time between the points that are compared, unless the samples are further apart."""

SMOOTH_S = 0.01
"""Time over which torque and wind-up are averaged."""

TRIED = np.linspace(-0.5, 0.5, 101)
"""Delays of the torque that are tried, in parts of what is looked at after the end; the best is refined between them.

With a longer one the torque would go on rising for all that is seen, and any creep would look like it.
"""

LEAST_ENDS = 3
"""Ends of ramps from which a delay is told: the median counts, for one of them may be disturbed."""

SLOWED = 0.5
"""Share of its speed on the ramp below which the wind-up has come to rest."""


class RampEnd(NamedTuple):
    """One end of a ramp: delay of the torque behind the wind-up [s], and rate of its torque [N·m/s]."""

    late_s: float
    rate_nm_s: float


@of_measured
def late_torque(found: Measured) -> Reading | str:
    """Torque by which a ramp runs on while the output torque is late or early, % of the reference torque."""
    trace = found.trace
    if trace.torque_out_nm is None:
        return "not measured: the torque at the output is not in the trace"
    ends = list(ramp_ends(trace, measured_windup(trace, found.method).arcmin))
    if len(ends) < LEAST_ENDS:
        return f"not measured: {len(ends)} ramps of {BEFORE_S[1]:g} s end in a dwell, and {LEAST_ENDS} are needed"
    # Of a control that was given a late torque the ends differ among themselves, in both directions.
    late_s = float(np.median([abs(one.late_s) for one in ends]))
    rate_nm_s = max(abs(one.rate_nm_s) for one in ends)
    words = f"at the ends of {len(ends)} ramps the output torque comes to rest {late_s * 1e3:.2g} ms off the wind-up"
    return Reading(100.0 * late_s * rate_nm_s / found.method.reference_nm, words)


def ramp_ends(trace: Trace, windup_arcmin: FloatArray) -> Iterator[RampEnd]:
    """Yield each end of a ramp that is followed by a dwell; none without time, commanded segments or output torque."""
    if trace.t_s is None or trace.torque_out_nm is None or trace.segment is None or not trace.segments:
        return
    borders = np.flatnonzero(trace.segment[1:] != trace.segment[:-1]) + 1
    starts, stops = [0, *borders[:-1].tolist()], [*borders[1:].tolist(), trace.segment.size]
    for start, end, stop in zip(starts, borders.tolist(), stops, strict=True):
        before, after = (trace.segments[int(trace.segment[row])] for row in (end - 1, end))
        ramp_s, dwell_s = (float(trace.t_s[last] - trace.t_s[first]) for first, last in ((start, end), (end, stop - 1)))
        if before.direction and not after.direction and ramp_s >= BEFORE_S[1] and dwell_s >= LEAST_AFTER_S:
            rows = slice(start, stop)
            channels = (trace.t_s[rows], trace.torque_out_nm[rows], windup_arcmin[rows])
            found = _ramp_end(*channels, end_s=float(trace.t_s[end]), after_s=min(AFTER_S, dwell_s))
            if found is not None:
                yield found


def _ramp_end(
    t_s: FloatArray, torque_nm: FloatArray, windup_arcmin: FloatArray, *, end_s: float, after_s: float
) -> RampEnd | None:
    """Return the delay at which the torque follows the wind-up best; None where the wind-up does not come to rest.

    The torque is a straight function of the wind-up and of the creep that sets in as the ramp ends; for as long as is
    looked at, that is the time that the wind-up has lost on its ramp.
    """
    # Of the last half: next to its end a control that was given a late torque has gone beyond, and comes back.
    half_s = 0.5 * (end_s - float(t_s[0]))
    (from_nm, to_nm), (from_arcmin, to_arcmin) = (
        np.interp([end_s - half_s, end_s], t_s, values).tolist() for values in (torque_nm, windup_arcmin)
    )
    rate_nm_s = (to_nm - from_nm) / half_s
    if not rate_nm_s:
        return None
    before_s = float(np.clip(BEFORE_SHARE * abs(to_nm / rate_nm_s), *BEFORE_S))
    step_s = max(STEP_S, float(np.median(np.diff(t_s))))
    width = max(1, round(SMOOTH_S / step_s))
    margin_s = 0.5 * after_s + width * step_s
    wide_s = np.arange(end_s - before_s - margin_s, end_s + after_s + margin_s, step_s)
    # Both are averaged alike: as they were recorded, the noise of a torque would be least between two samples.
    mean = np.ones(width) / width
    windup, torque = (
        np.convolve(np.interp(wide_s, t_s, values), mean, "same") for values in (windup_arcmin, torque_nm)
    )
    inside = (wide_s >= end_s - before_s) & (wide_s < end_s + after_s)
    at_s, speed, windup = wide_s[inside], np.gradient(windup, step_s)[inside], windup[inside]
    on_ramp = (to_arcmin - from_arcmin) / half_s
    if not on_ramp or speed[-1] / on_ramp > SLOWED:
        return None
    straight = np.stack([np.ones_like(windup), windup - windup.mean()], axis=1)
    creep = np.cumsum(1.0 - speed / on_ramp)
    torques = np.stack([np.interp(at_s + late_s, wide_s, torque) for late_s in after_s * TRIED])
    late, grows = _least(torques, np.column_stack([straight, creep]))
    if grows * rate_nm_s > 0.0:
        # No unit's torque goes on rising while its wind-up stands: that is a channel with a slow filter.
        late, _ = _least(torques, straight)
    return RampEnd(after_s * late, rate_nm_s)


def _least(torques: FloatArray, course: FloatArray) -> tuple[float, float]:
    """Return where in `TRIED` the torque follows its course best, and how the last part of the course counts there.

    torques: one row for each delay. course: one column for each part of it.
    """
    basis, mix = np.linalg.qr(course)
    parts = torques @ basis
    left = np.square(torques - parts @ basis.T).sum(axis=1)
    best = int(np.argmin(left))
    last = float(parts[best, -1] / mix[-1, -1])
    if not 0 < best < TRIED.size - 1:
        return float(TRIED[best]), last
    below, least, above = (float(left[best + shift]) for shift in (-1, 0, 1))
    bend = below - 2.0 * least + above
    shift = 0.5 * (below - above) / bend if bend > 0.0 else 0.0
    return float(TRIED[best] + shift * (TRIED[1] - TRIED[0])), last


FIGURES: dict[str, Figure] = {
    "late_torque": late_torque,
}
"""Figures of these checks, by their ids."""
