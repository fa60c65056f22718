"""Delay of the torque behind the wind-up, told where both turn: it needs neither segments nor dwells nor time.

No passive unit lets its torque go on rising while its wind-up falls. The wind-up is at its turn where the straight
course of its arrival reaches its largest value. A torque that is late still goes on by then, by how much is its
`overrun`; and the straight courses by which it arrives and leaves meet later than the wind-up turned, at its `meeting`.
For a pure delay both are the delay; a filter of the first order meets after its time constant τ and overruns by
(1 − ln 2)·τ. Where the load rests at its turn, courses meet late without any delay, but nothing overruns.

Rows count, not times: where rows were cut out, what is left of the ramps on both sides meets as late as before.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from analysis.loop.measured import Measured
from analysis.loop.windup import measured_windup
from analysis.torque_ratio.quadrants import Quadrants
from analysis.trace.runs import Run
from analysis.trace.units import FloatArray

REACH_SHARE = 0.04
"""Share of the torque at the turn over which a course arrives: over more of it the unit's stiffness changes."""

LEAVES_SHARES = (0.05, 0.15)
"""Shares of the torque at the turn between which it leaves: a filter has settled there, if its verdict is open."""

LEAST_ROWS = 6
"""Rows of a course without which no line is drawn."""

SMOOTH_SHARE = 0.001
"""Share of the torque at the turn over which rows are averaged to find the largest value."""

LOOKED_AT = 0.3
"""Share of each ramp that is looked at, next to its turn."""

NEAR_SHARE = 0.005
"""Share of a ramp's wind-up within which it is at its turn: more than noise."""

FIRST_ORDER = 1.0 - math.log(2.0)
"""Overrun of a filter of the first order at a turn without rest, in time constants."""

RESTED = 0.2
"""Overrun over meeting below which the load has rested at its turn: no filter overruns by so little."""

TOP_SHARE = 0.5
"""Share of the meeting over which the torque at the turn is averaged, about it: it may rest there for long."""


class TurnLag(NamedTuple):
    """Delay of the torque behind the wind-up: median over the turns and its standard uncertainty.

    seconds: None where the trace has no time. nm: what the torque at the output changes by in that time.
    nm_per_arcmin: torque over wind-up where they arrive. turns: how many were told.
    """

    seconds: float | None
    u_seconds: float | None
    nm: float
    u_nm: float
    nm_per_arcmin: float
    turns: int


def lag_at_turns(found: Measured) -> TurnLag | str:
    """Return the delay of a torque behind the wind-up, or why it cannot be told; positive where the torque is late.

    The output torque, where it was measured. Turns next to a staircase do not count: its holds let a filter settle.
    """
    trace = found.trace
    torque, scale = trace.torque_out_nm, 1.0
    if torque is None:
        torque, scale = trace.torque_in_nm, _to_output(found)
    if torque is None:
        return "not measured: needs a torque in the trace"
    windup = measured_windup(trace, found.method).arcmin
    told = []
    for arriving, leaving in pairwise(found.runs):
        if arriving.direction != leaving.direction and len(arriving.pieces) == len(leaving.pieces) == 1:
            one = _turn(arriving, leaving, torque, windup)
            told += [] if one is None else [one]
    if not told:
        return "not measured: needs a turning point between two ramps where both torque and wind-up reverse"
    columns = np.array(told)
    overrun, meeting, rate, u_noise, smooth, speed = np.median(columns, axis=0).tolist()
    rows = _late(overrun, meeting, smooth)
    # By the median of the deviations, as the figure itself: one turn that was disturbed does not count.
    scatter = 1.483 * np.median(np.abs(columns - np.median(columns, axis=0)), axis=0)
    u_overrun, u_meeting = (1.25 * np.maximum(scatter[:2], u_noise) / math.sqrt(len(told))).tolist()
    u_rows = u_overrun if rows == overrun else math.hypot(u_overrun, u_meeting)
    step_s = trace.step_s
    seconds, u_seconds = (None, None) if step_s is None else (rows * step_s, u_rows * step_s)
    return TurnLag(seconds, u_seconds, scale * rows * rate, scale * u_rows * rate, scale * rate / speed, len(told))


def _to_output(found: Measured) -> float:
    """Output torque per input torque, where the input torque alone was measured."""
    quadrants = found.quadrants
    return quadrants.load_positive.slope if isinstance(quadrants, Quadrants) else found.method.ratio


class _Turn(NamedTuple):
    """One turn: overrun and meeting after that of the wind-up [rows], and the rate of the torque [N·m per row].

    u_noise: standard uncertainty of both by the noise of the torque, rows. smooth: rows that its largest value is the
    mean of, and by a quarter of which it is low where the load does not rest. speed: of the wind-up, arcmin per row.
    """

    overrun: float
    meeting: float
    rate: float
    u_noise: float
    smooth: int
    speed: float


def _turn(arriving: Run, leaving: Run, torque: FloatArray, windup: FloatArray) -> _Turn | None:
    """Read one turn; None where its courses have too few rows, or are none."""
    (before,), (after,), way = arriving.pieces, leaving.pieces, arriving.direction
    start = before.stop - round(LOOKED_AT * (before.stop - before.start))
    stop = after.start + round(LOOKED_AT * (after.stop - after.start))
    load, turned = way * torque[start:stop], way * windup[start:stop]
    near = float(turned.max()) - NEAR_SHARE * float(turned.max() - min(turned[0], turned[-1]))
    first = int(np.argmax(turned >= near))
    peak = abs(float(load.max()))
    reach = first - int(np.argmax(load[: first + 1] >= load[first] - REACH_SHARE * peak))
    if reach < LEAST_ROWS:
        return None
    rises, load_at, noise = _line(load, first - reach, first + 1)
    winds, turned_at, _ = _line(turned, first - reach, first + 1)
    if not (rises > 0.0 and winds > 0.0):
        return None
    smooth = max(1, round(SMOOTH_SHARE * peak / rises))
    turn = first + (float(_mean(turned[first:], smooth).max()) - turned_at) / winds
    highest = float(_mean(load[first:], smooth).max())
    high, low = (highest - share * peak for share in LEAVES_SHARES)
    past = int(load.size - np.argmax(load[::-1] >= high))
    gone = past + int(np.argmax(load[past:] <= low)) if past < load.size else past
    if gone - past < LEAST_ROWS:
        return None
    falls, left_at, _ = _line(load, past, gone)
    meets = first + (left_at - load_at + falls * (first - gone + 1)) / (rises - falls)
    wide = round(0.5 * TOP_SHARE * (meets - turn))
    middle = slice(round(meets) - wide, round(meets) + wide + 1)
    top = float(load[middle].mean()) if wide > smooth else highest
    u_noise = noise / rises * math.hypot(2.0 / math.sqrt(reach), 1.0 / math.sqrt(max(smooth, 2 * wide)))
    return _Turn(first + (top - load_at) / rises - turn, meets - turn, rises, u_noise, smooth, winds)


def _late(overrun: float, meeting: float, smooth: float) -> float:
    """Return the delay that overrun and meeting stand for; what they leave open counts as late."""
    if overrun < RESTED * meeting and meeting > 2.0 * smooth:
        return overrun
    if overrun <= 0.0 or meeting >= RESTED * overrun:
        return max(overrun, meeting)
    # It leaves steeply: friction reverses in less torque than lies between the courses, and they meet early.
    return overrun / FIRST_ORDER


def _line(values: FloatArray, start: int, stop: int) -> tuple[float, float, float]:
    """Slope per row of a straight line through rows of a channel, its value at the last of them, and what it leaves."""
    rows = np.arange(start - stop + 1, 1, dtype=np.float64)
    at_last, slope = np.polynomial.polynomial.polyfit(rows, values[start:stop], 1)
    left = values[start:stop] - at_last - slope * rows
    return float(slope), float(at_last), float(left.std())


def _mean(values: FloatArray, width: int) -> FloatArray:
    """Moving mean over so many rows, where all are there."""
    width = min(width, values.size)
    total = np.concatenate(([0.0], np.cumsum(values)))
    found: FloatArray = (total[width:] - total[:-width]) / width
    return found
