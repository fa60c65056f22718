"""Torque lines of which the transition after a turn is no part, and how sure what they show is.

After a turn friction goes over to the other side, and the unloading line begins where that has ended: at a small load
not before most of it is gone. So the line is fitted to less and less of the unloading, until leaving out more changes
nothing but what the scatter of the points explains. What it still changes is part of the uncertainty. Where it never
settles the figure is worth nothing, and its uncertainty says so. Branches of other speeds have other friction, so
all lines are of one kind of run, calibration or cycles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from analysis.torque_ratio.line_fit import LEAST_POINTS, RatioFit, fit_torque_ratio
from analysis.torque_ratio.quadrant_fit import (
    LOADING_RANGE,
    UNLOADING_RANGE,
    bounce_ends_nm,
    fit_lines,
    quadrant_points,
)
from analysis.torque_ratio.quadrants import QUADRANTS, TorqueLine
from analysis.trace.runs import Run
from analysis.trace.trace import Trace

SIDES = ("positive", "negative")

SHARES = (UNLOADING_RANGE[1], 0.6, 0.48, 0.38, 0.3, 0.24)
"""Shares of the peak torque below which unloading lines are fitted, one after the other."""

WITHOUT_PLAY = (0.25, LOADING_RANGE[1])
"""Shares of the peak torque between which loading lines of ramps by other laws are held against each other.

At a small torque a unit that comes through its play bounces, more on a ramp by torque than at a constant speed.
"""

SETTLED = 3.0
"""Standard uncertainties of a line's figure by which another share may change it."""

SETTLES = 0.25
"""Least change from share to share over the largest up to which a figure settles at all."""

STRAIGHTER, LOADED = 2.0, 0.5
"""Residual of the calibration over that of the cycles from which these are taken, and their least share of its peak."""

IN_TRANSITION = "not measured: at this load, most of the unloading branch is the transition after the turning point"

TOLD = 0.01
"""Uncertainty of a ratio up to which it is held against another, that of the recipe or of other runs."""

LEAST_LEFT = 10
"""Points of an unloading line that are left at least."""

LEAST_APART = 0.1
"""Share of the loading slope by which that of unloading must differ, for their lines to meet anywhere definite."""

OTHER = "other_"
"""Before the name of a line of the other runs, where the lines of two are held against each other."""


class Told(NamedTuple):
    """A figure that lines show, and its expanded uncertainty (k = 2)."""

    value: float
    expanded: float


class SettledLines(NamedTuple):
    """What the torque lines of a run show: ratio of each side, both torques at no load [N·m] or None, friction.

    friction: share of the load that it grows by, mean of both sides. zero_in_nm: of the input torque, without the
    friction that is there without load, idle_nm of each direction, NaN where it is not known. hysteresis_nm: by how
    much the output torque reads high at no load while it falls, and low while it rises; None where it is not known.
    """

    ratios: Mapping[str, Told]
    zero_nm: Told | None
    friction: float
    zero_in_nm: Told | None = None
    idle_nm: float = math.nan
    hysteresis_nm: Told | None = None


Fits = Mapping[str, RatioFit]
Lines = Mapping[str, RatioFit | TorqueLine]
Figure = Callable[[Lines], float]


def straighter(trace: Trace, calibration: Sequence[Run], cycles: Sequence[Run]) -> tuple[Sequence[Run], str]:
    """Return the runs that show the lines, and their name: the calibration, unless the cycles are straighter by far.

    The first loading of a side, from rest or not, has friction of its own. Cycles without output torque show nothing.
    """
    if not calibration:
        return cycles, "the lines of the measured cycles"
    torque = trace.channel("torque_out_nm", "the torque ratio")
    peaks = [max(float(np.abs(run.take(torque)).max()) for run in runs) for runs in (calibration, cycles)]
    if peaks[1] > LOADED * peaks[0]:
        bent = [_bent_nm(trace, runs) for runs in (calibration, cycles)]
        if bent[0] > STRAIGHTER * bent[1]:
            return cycles, "the lines of the measured cycles"
    return calibration, "the lines of the calibration"


def _bent_nm(trace: Trace, runs: Sequence[Run]) -> float:
    """Residual of the loading lines, N·m; the worse side, infinite without."""
    points = quadrant_points(trace, runs)
    sizes = [points[f"load_{side}"] for side in SIDES]
    if any(x.size < LEAST_POINTS for x, _ in sizes):
        return math.inf
    return max(fit_torque_ratio(x, y).residual_sd_nm for x, y in sizes)


def settled_lines(trace: Trace, runs: Sequence[Run]) -> SettledLines:
    """Return what the lines of runs show; both torques are in the trace.

    Raises AnalysisError where a quadrant has too few points, naming it.
    """
    known = _by_share(trace, runs, bounce_ends_nm(trace, runs))
    ratios = {side: told(known, partial(ratio_of, side=side)) for side in SIDES}
    zero, zero_in, hysteresis = (told(known, figure) for figure in (zero_of, zero_in_of, hysteresis_of))
    return SettledLines(
        ratios,
        zero if math.isfinite(zero.value) else None,
        friction_of(known[-1]),
        zero_in if math.isfinite(zero_in.value) else None,
        idle_of(known[-1]),
        hysteresis if math.isfinite(hysteresis.expanded) else None,
    )


def ratios_apart(trace: Trace, runs: Sequence[Run], others: Sequence[Run]) -> dict[str, Told]:
    """Return by how much the ratio that runs show is beyond that of others, by side: both by the same shares.

    The loading lines of both begin where neither bounces. A transition that has not ended is in both alike, and leaves
    the difference before it leaves the ratios. Raises AnalysisError as `settled_lines`.
    """
    begins = begins_of_both_nm(trace, runs, others)
    one, other = (_by_share(trace, some, begins, WITHOUT_PLAY) for some in (runs, others))
    known = [
        {**fits, **{f"{OTHER}{name}": fit for name, fit in beside.items()}}
        for fits, beside in zip(one, other, strict=False)
    ]
    return {side: told(known, partial(_ratio_beyond, side=side)) for side in SIDES}


def begins_of_both_nm(trace: Trace, runs: Sequence[Run], others: Sequence[Run]) -> dict[str, float]:
    """Return the torque [N·m] from which on neither of two groups of runs bounces, of the loading lines that do."""
    ends = [bounce_ends_nm(trace, some) for some in (runs, others)]
    return {name: max(end.get(name, 0.0) for end in ends) for name in ends[0] | ends[1]}


def _ratio_beyond(fits: Lines, side: str) -> float:
    other: Lines = {name: fits[f"{OTHER}{name}"] for name in QUADRANTS}
    return ratio_of(fits, side) - ratio_of(other, side)


def _by_share(
    trace: Trace, runs: Sequence[Run], begins_nm: Mapping[str, float], loading: tuple[float, float] = LOADING_RANGE
) -> list[Fits]:
    """Return the lines of runs by less and less of the unloading, while enough of that is left.

    begins_nm, loading: see `quadrant_points`.
    """
    points = quadrant_points(trace, runs, loading=loading, begins_nm=begins_nm)
    peak = max(float(np.abs(y).max(initial=0.0)) for _, y in points.values()) / LOADING_RANGE[1]
    known: list[Fits] = [fit_lines(trace, runs, loading=loading, begins_nm=begins_nm)]
    for share in SHARES[1:]:
        fits = dict(known[0])
        for name in (f"unload_{side}" for side in SIDES):
            x, y = points[name]
            settled = np.abs(y) <= share * peak
            if np.count_nonzero(settled) >= LEAST_LEFT:
                fits[name] = fit_torque_ratio(x[settled], y[settled])
        if any(fits[name] is known[0][name] for name in (f"unload_{side}" for side in SIDES)):
            break
        known.append(fits)
    return known


def ratio_of(fits: Lines, side: str) -> float:
    """Harmonic mean of the slopes of loading and unloading of one side: the ratio of the gear; 0 if level."""
    load, unload = fits[f"load_{side}"].slope, fits[f"unload_{side}"].slope
    return 2.0 * load * unload / (load + unload) if load + unload else 0.0


def zero_of(fits: Lines) -> float:
    """Output torque at which the lines of a direction of motion meet, N·m; mean of both; NaN where they do not."""
    return sum(torque_out for _, torque_out in _meetings(fits)) / len(SIDES)


def hysteresis_of(fits: Lines) -> float:
    """Half of what the output torque reads more where the lines of falling torque meet, N·m; NaN where they do not.

    No load is none in either direction: a sensor that reads another there has the difference from the direction.
    """
    (_, rising), (_, falling) = _meetings(fits)
    return (falling - rising) / 2.0


def zero_in_of(fits: Lines) -> float:
    """Input torque at which the lines of a direction of motion meet, N·m; mean of both; NaN where they do not.

    The friction without load stands there, against each direction: where it is alike in both the mean has none of it.
    """
    return sum(torque_in for torque_in, _ in _meetings(fits)) / len(SIDES)


def idle_of(fits: Lines) -> float:
    """Friction without load at the input, N·m: half of what lies between both directions; NaN where it is not known."""
    (forward, _), (backward, _) = _meetings(fits)
    return abs(forward - backward) / 2.0


def _meetings(fits: Lines) -> list[tuple[float, float]]:
    """Input and output torque [N·m] at which the lines of each direction of motion meet; NaN where they do not."""
    found = []
    for side, other in (SIDES, SIDES[::-1]):
        load, unload = fits[f"load_{side}"], fits[f"unload_{other}"]
        apart = unload.slope - load.slope
        if not apart > LEAST_APART * load.slope:
            return [(math.nan, math.nan)] * len(SIDES)
        torque_in = (load.offset_nm - unload.offset_nm) / apart
        torque_out = (unload.slope * load.offset_nm - load.slope * unload.offset_nm) / apart
        found.append((torque_in, torque_out))
    return found


def friction_of(fits: Lines) -> float:
    """Friction that grows with the load, as a share of it: from the slopes of loading and unloading."""
    shares = []
    for side in SIDES:
        load, unload = fits[f"load_{side}"].slope, fits[f"unload_{side}"].slope
        shares.append((unload - load) / (unload + load) if unload + load else 0.0)
    return max(0.0, sum(shares) / len(shares))


def told(by_share: Sequence[Fits], figure: Figure) -> Told:
    """Return a figure of the lines where it has settled, else by the share at which it changes least."""
    values = [figure(fits) for fits in by_share]
    scatter = [_standard_uncertainty(fits, figure) for fits in by_share]
    if len(values) < 2:
        return Told(values[0], math.inf)
    steps = [abs(after - before) for before, after in pairwise(values)]
    for place, step in enumerate(steps):
        if step <= SETTLED * math.hypot(scatter[place], scatter[place + 1]):
            return Told(values[place], 2.0 * scatter[place] + step)
    known = [place for place, step in enumerate(steps) if math.isfinite(step)]
    if not known:
        return Told(values[-1], math.inf)
    place = min(known, key=lambda one: steps[one])
    if steps[place] > SETTLES * max(steps[one] for one in known):
        return Told(values[place + 1], math.inf)
    # It settles and has not yet: the next steps may go on the same way.
    return Told(values[place + 1], 2.0 * scatter[place + 1] + len(SHARES) * steps[place])


def _standard_uncertainty(fits: Fits, figure: Figure) -> float:
    """Standard uncertainty of a figure by the scatter of the points about their lines, by moving each line."""
    lines = {name: TorqueLine(fit.offset_nm, fit.slope) for name, fit in fits.items()}
    parts = []
    for name, fit in fits.items():
        along = (fit.u_offset_nm, fit.correlation * fit.u_slope)
        across = (0.0, fit.u_slope * math.sqrt(max(0.0, 1.0 - fit.correlation**2)))
        for offset_nm, slope in (along, across):
            high, low = (
                figure(lines | {name: TorqueLine(fit.offset_nm + way * offset_nm, fit.slope + way * slope)})
                for way in (1.0, -1.0)
            )
            parts.append((high - low) / 2.0)
    return math.hypot(*parts)
