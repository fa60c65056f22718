"""How late a torque is behind the wind-up: where a ramp ends in a dwell, or where the load turns.

On a steady ramp a late channel reads as friction does; nothing tells them apart. Where a ramp ends and a dwell begins
friction keeps its side, and torque and wind-up slow down together, whatever the unit is like. A channel that is late
slows down late. Where no ramp is known to end in a dwell, the turns of the load tell the same (`turns`). The figure
does not depend on what anybody says of the channels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from analysis.loop.measured import Measured
from analysis.loop.windup import measured_windup
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from analysis.validity.turns import lag_at_turns
from definitions.checks import CHECKS
from definitions.units import ARCMIN_PER_RAD

BEFORE_S, AFTER_S = (0.15, 0.35), 0.2
"""What is looked at before and after the end of a ramp, at least and at most; of a dwell as much as there is."""

BEFORE_SHARE = 0.065
"""Share of the torque at the end that is looked at before it: over more of it the unit's stiffness grows.

Over less of it nothing straight is seen of a fast ramp, for its last 150 ms are rounded. Of what bends evenly the lost
time looks like a delay, and the wave of an encoder decides between creep and delay.
"""

LEAST_AFTER_S = 0.08
"""A dwell that is shorter does not show where the ramp ended."""

STEP_S = 1e-3
"""Time between the points that are compared, unless the samples are further apart."""

LEAST_STEPS = 4
"""Samples of a dwell that are looked at, at least: with fewer nothing is seen of how it comes to rest."""

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
    """One end of a ramp: delay of the torque behind the wind-up [s], rates of torque [N·m/s] and wind-up [arcmin/s]."""

    late_s: float
    rate_nm_s: float
    speed_arcmin_s: float


CERTAIN = 3.0
"""Standard uncertainties beyond which a delay is one, and not the scatter of what shows it."""

COUNT_ROWS = 10_000
"""Rows before and after the middle of a trace by which the counts of an encoder are told."""

LEAST_DELAY, LEAST_EARLY = 0.12, 0.4
"""Shares of the limit of `late_torque` below which no delay is told, of a torque that is late and of one that is early.

The straight courses of a sound unit bend by as much, and a unit that creeps as it comes to rest is late itself.
"""


class Lateness(NamedTuple):
    """Delay of the torque behind the wind-up: the torque that it makes, its time, and words.

    nm: torque by which a ramp runs on in that time. seconds: signed; 0 where it is no more than the scatter of what
    shows it, or the trace has no time.
    """

    nm: float
    seconds: float
    words: str


def lateness_of(found: Measured) -> Lateness | str:
    """Return how late the torque is where ramps end in a dwell, else where the load turns; or why nothing tells it."""
    trace = found.trace
    if trace.torque_out_nm is not None:
        ends = list(ramp_ends(trace, measured_windup(trace, found.method).arcmin))
        if len(ends) >= LEAST_ENDS:
            return _at_ends(ends, found)
    told = lag_at_turns(found)
    if isinstance(told, str):
        return told
    allowed_nm = CHECKS["late_torque"].limit / 100.0 * found.method.reference_nm
    # What scatters by more than the limit bounds no delay; one that stands out of its scatter is one all the same.
    if CERTAIN * told.u_nm > max(allowed_nm, abs(told.nm) - allowed_nm):
        return (
            f"not measured: the delay of the torque at {told.turns} turning points is known only to "
            f"{CERTAIN * told.u_nm:.2g} N·m, and {allowed_nm:.2g} N·m are needed. Measure more cycles, or let the "
            "torque rest at its turning points for 100 ms or more"
        )
    count_nm = count_arcmin(found) * told.nm_per_arcmin
    certain = abs(told.nm) > max(CERTAIN * told.u_nm + count_nm, _least(told.nm) * allowed_nm)
    in_time = "" if told.seconds is None else f", {abs(told.seconds) * 1e3:.2g} ms"
    way = "later" if told.nm > 0.0 else "earlier"
    words = (
        f"at {told.turns} turning points the torque reverses {way} than the wind-up, by {abs(told.nm):.2g} N·m{in_time}"
    )
    return Lateness(abs(told.nm), (told.seconds or 0.0) if certain else 0.0, words)


def _at_ends(ends: Sequence[RampEnd], found: Measured) -> Lateness:
    # Of a control that was given a late torque the ends differ among themselves, in both directions.
    late_s = float(np.median([abs(one.late_s) for one in ends]))
    nm = late_s * max(abs(one.rate_nm_s) for one in ends)
    signed = np.array([one.late_s for one in ends])
    u_s = 1.25 * float(signed.std(ddof=1)) / math.sqrt(signed.size)
    allowed_nm = CHECKS["late_torque"].limit / 100.0 * found.method.reference_nm
    count_s = count_arcmin(found) / float(np.median([abs(one.speed_arcmin_s) for one in ends]))
    middle_s = float(np.median(signed))
    certain = abs(middle_s) > CERTAIN * u_s + count_s and nm > _least(middle_s) * allowed_nm
    way = "later" if middle_s > 0.0 else "earlier"
    words = f"at the ends of {len(ends)} ramps the output torque stops {late_s * 1e3:.2g} ms {way} than the wind-up"
    if count_s > late_s:
        words += (
            f", and the angles are recorded in steps of {count_arcmin(found):.2g} arcmin at the output, each of which "
            f"takes {count_s * 1e3:.2g} ms: record them with more digits"
        )
    return Lateness(nm, middle_s if certain else 0.0, words)


def count_arcmin(found: Measured) -> float:
    """Return the least step of the wind-up by the counts of its encoders, arcmin.

    Every cycle turns at the same angle and is rounded alike: their scatter does not show it.
    """
    total = 0.0
    for values, scale in ((found.trace.angle_in_rad, found.method.ratio), (found.trace.angle_out_rad, 1.0)):
        if values is not None:
            steps = np.abs(np.diff(_middle(values)))
            steps = steps[steps > 0.0]
            total += float(steps.min()) * ARCMIN_PER_RAD / scale if steps.size else 0.0
    return total


def _middle(values: FloatArray) -> FloatArray:
    """Rows in the middle of a channel that show its counts."""
    middle = values.size // 2
    return values[max(0, middle - COUNT_ROWS) : middle + COUNT_ROWS]


def _least(late: float) -> float:
    return LEAST_DELAY if late > 0.0 else LEAST_EARLY


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
    """Return the delay at which the torque follows the wind-up best; None where it cannot be told.

    That is where the wind-up does not come to rest, or the samples are too far apart to show it.
    The torque is a straight function of the wind-up and of the creep that sets in as the ramp ends; for as long as is
    looked at, that is the time that the wind-up has lost on its ramp.
    """
    # Of the last half: next to its end a control that was given a late torque has gone beyond, and comes back.
    step_s = max(STEP_S, float(np.median(np.diff(t_s))))
    if LEAST_STEPS * step_s > after_s:
        return None
    half_s = 0.5 * (end_s - float(t_s[0]))
    (from_nm, to_nm), (from_arcmin, to_arcmin) = (
        np.interp([end_s - half_s, end_s], t_s, values).tolist() for values in (torque_nm, windup_arcmin)
    )
    rate_nm_s = (to_nm - from_nm) / half_s
    if not rate_nm_s:
        return None
    before_s = float(np.clip(BEFORE_SHARE * abs(to_nm / rate_nm_s), *BEFORE_S))
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
    late, grows = _fits_best(torques, np.column_stack([straight, creep]))
    if grows * rate_nm_s > 0.0:
        # No unit's torque goes on rising while its wind-up stands: that is a channel with a slow filter.
        late, _ = _fits_best(torques, straight)
    return RampEnd(after_s * late, rate_nm_s, on_ramp)


def _fits_best(torques: FloatArray, course: FloatArray) -> tuple[float, float]:
    """Return where in `TRIED` the torque follows its course best, and how the last part of the course counts there.

    torques: one row for each delay. course: one column for each part of it.
    """
    basis, mix = np.linalg.qr(course)
    parts = torques @ basis
    # As a share of what there is to explain: the longer the delay, the less of the ramp is still looked at, and a
    # torque at rest follows anything.
    left = np.square(torques - parts @ basis.T).sum(axis=1) / torques.var(axis=1)
    best = int(np.argmin(left))
    last = float(parts[best, -1] / mix[-1, -1])
    if not 0 < best < TRIED.size - 1:
        return float(TRIED[best]), last
    below, least, above = (float(left[best + shift]) for shift in (-1, 0, 1))
    bend = below - 2.0 * least + above
    shift = 0.5 * (below - above) / bend if bend > 0.0 else 0.0
    return float(TRIED[best] + shift * (TRIED[1] - TRIED[0])), last
