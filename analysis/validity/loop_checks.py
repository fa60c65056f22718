"""Figures of the validity checks that ask whether a loop can be a reducer's at all: stiffness, loss, creep, waves.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from analysis.loop.loop import Loop
from analysis.loop.measured import Measured
from analysis.loop.method import REVERSAL_EXCLUSION
from analysis.loop.samples import BranchSamples, part_ends_nm
from analysis.loop.windup import measured_windup
from analysis.trace.units import FloatArray
from analysis.validity.channel_checks import angle_steps
from analysis.validity.evidence import (
    NO_SPAN,
    NOT_EVALUATED,
    Evidence,
    Figure,
    LeftOpen,
    Reading,
    has_span,
    of_measured,
    of_span,
    span_arcmin,
)

SECANT = (0.25, 0.75)
"""Torques between which the stiffness is read, of the lesser of peak and reference torque: beyond play and reversal."""


@of_measured
def stiffness_low(found: Measured) -> Reading | str:
    """Secant stiffness of the loops over that of the catalogue; the softer side."""
    if found.angles == "given":
        return "the wind-up was computed elsewhere and may include the fixture, so the stiffness cannot be checked"
    return _stiffness(found, min)


@of_measured
def stiffness_high(found: Measured) -> Reading | str:
    """Secant stiffness of the loops over that of the catalogue; the stiffer side."""
    return _stiffness(found, max)


def _stiffness(found: Measured, side: Callable[[list[float]], float]) -> Reading | str:
    """Return the stiffness of the side over the declared one.

    A factor tells a wrong unit or scale of angle or torque, which every metric of the loop carries unseen.
    """
    declared = found.method.catalogue_stiffness_nm_per_arcmin
    if declared is None:
        return "needs the stiffness of the unit in the recipe"
    secants = [_secant_nm_per_arcmin(loop, way) for loop in found.loops for way in (1, -1)]
    if any(one is None for one in secants):
        return "needs loops that pass through zero torque"
    worst = side([one for one in secants if one is not None])
    words = (
        f"the loop has {worst:.3g} N·m/arcmin, and the recipe declares {declared:g} for this unit: "
        "an angle or a torque is in another unit or scale"
    )
    return Reading(worst / declared, words)


def _secant_nm_per_arcmin(loop: Loop, side: int) -> float | None:
    """Secant of the mean curve in the middle of one side, N·m/arcmin; None where the loop has no such side."""
    ends = (loop.forward.torque_nm, loop.backward.torque_nm)
    peak = min(float(one[-1] if side > 0 else -one[0]) for one in ends)
    low, high = (part * min(peak, loop.reference_nm) for part in SECANT)
    if not peak > 0.0 or not all(branch.covers(*sorted((side * low, side * high))) for branch in
                                 (loop.forward, loop.backward)):  # fmt: skip
        return None
    way = side * (loop.mean_at(side * high) - loop.mean_at(side * low))
    return (high - low) / way if way else math.inf


@of_measured
def loss(found: Measured) -> Reading | str:
    """Energy of the cycle that loses least, % of the rectangle of torque and wind-up that its loop stands in."""
    if not has_span(found):
        return Reading(-math.inf, NO_SPAN)
    way = float(found.loops[0].forward.torque_nm[-1] - found.loops[0].forward.torque_nm[0])
    least = min(loop.energy_nm_arcmin for loop in found.loops)
    return Reading(100.0 * least / (way * span_arcmin(found)))


WIDTH_AT = (0.3, 0.7)
"""Shares of the peak torque between which the growth of the width is read: beyond play, and before the turn."""

LEAST_REST_S = 0.08
"""A dwell that is shorter shows no creep."""

SETTLES_S = 0.03
"""Start of a dwell that is left out: there filters settle, and the ramp runs out."""

CERTAIN = 3.0
"""Standard uncertainties beyond which a creep is one."""


@of_measured
def width_growth(found: Measured) -> Reading | str:
    """Growth of the loop's width from small to large torque on one side, mean of the cycles, %; the larger side.

    A loop closes towards its turns. One that opens was bent by a wind-up that went against its torque all the time.
    """
    worst = 0.0
    for side in (1, -1):
        widths = [_widths_arcmin(loop, side) for loop in found.loops]
        if not all(widths):
            return "needs loops with positive and negative torque"
        small, large = np.mean([one for one in widths if one], axis=0).tolist()
        if not small > 0.0:
            return "the loop has no width at small torque"
        worst = max(worst, large / small - 1.0)
    return Reading(100.0 * worst)


def _widths_arcmin(loop: Loop, side: int) -> tuple[float, float] | None:
    """Width about both torques of `WIDTH_AT`, mean over a tenth of the peak, so that noise says little."""
    forward, backward = loop.forward, loop.backward
    peak = min(float(one.torque_nm[-1] if side > 0 else -one.torque_nm[0]) for one in (forward, backward))
    if not peak > 0.0:
        return None
    near, far = (side * peak * np.linspace(share - 0.05, share + 0.05, 21) for share in WIDTH_AT)
    small, large = (float(np.mean(backward.at(at) - forward.at(at))) for at in (near, far))
    return small, large


@of_measured
def creep_back(found: Measured) -> Reading | str:
    """Wind-up that would creep back against its torque during one branch, as it does in the dwells, % of the wind-up.

    Mean of dwells at both signs of torque, so that a drift says nothing. A unit creeps the way its torque points.
    """
    trace = found.trace
    if trace.t_s is None or trace.segment is None or trace.torque_out_nm is None:
        return "not measured: needs time, segments and output torque"
    windup = measured_windup(trace, found.method).arcmin
    borders = np.concatenate(([0], np.flatnonzero(np.diff(trace.segment)) + 1, [trace.segment.size]))
    rates: dict[bool, list[float]] = {True: [], False: []}
    for start, stop in pairwise(borders.tolist()):
        time = trace.t_s[start:stop]
        if trace.segments[int(trace.segment[start])].role != "dwell" or time[-1] - time[0] < LEAST_REST_S:
            continue
        settled = time >= time[0] + SETTLES_S
        if settled.sum() < 2:
            continue
        if not float(np.ptp(time[settled])) > 0.0:
            row = int(start + np.argmax(settled)) + 1
            return Reading(math.inf, f"all samples of the dwell from row {row} on have one time: it is rounded")
        positive = float(trace.torque_out_nm[start:stop].mean()) > 0.0
        rate = float(np.polyfit(time[settled] - time[0], windup[start:stop][settled], 1)[0])
        rates[positive].append(rate if positive else -rate)
    if min(len(some) for some in rates.values()) < 2 or not has_span(found):
        return "not measured: needs two dwells or more at both signs of torque"
    mean = float(np.mean([np.mean(some) for some in rates.values()]))
    u = math.hypot(*(float(np.std(some, ddof=1)) / math.sqrt(len(some)) for some in rates.values())) / 2.0
    seconds = [float(np.ptp(one.t_s)) for pair in found.pairs for one in pair if one.t_s is not None]
    back = max(0.0, -mean - CERTAIN * u) * max(seconds)
    words = f"while the torque is held, the wind-up moves back by {-60.0 * mean:.2g} arcmin/min"
    return of_span(found, back, words)


WAVE_AT = (0.25, 0.95)
"""Shares of the largest torque of a loading branch between which waves are looked for: there a unit's curve is even."""

LEAST_WAY = 0.4
"""Share of that torque that is left at least, where friction takes a part: while it reverses no curve is even."""

WAVE_BLOCKS, LEAST_PER_BLOCK = 200, 2
"""Blocks of samples that such a stretch is averaged into, and the fewest samples of a block."""

EVEN: Mapping[int, FloatArray] = {2: np.arange(0.5, 1.0, 0.1), 3: np.arange(1.0, 12.25, 0.25)}
"""Waves in the stretch that are tried, by the degree of the curve that is even beside them.

A curve of the third degree is much like less than one wave; beside one of the second degree half a wave is seen, and
sound units leave up to 0.04 % of the wind-up (rms). Less than half a wave is a curve that a unit may have.
"""

FULL_TURN_ARCMIN = 21_600.0

OPEN_FROM, LEFT_OF_WAVE = 2.0, 0.75
"""Waves in the stretch from which it is told how large one may be unseen, and the least share of its amplitude that an
even curve leaves there, in any phase: of one wave a fifth, of half a wave a fiftieth."""

BY_CHANCE = 4.0
"""Standard uncertainties that the amplitude of noise at the best of all waves comes to at most."""


def angle_waves(evidence: Evidence) -> Reading | str:
    """Amplitude of a wave over the angle in loading branches, beyond noise, rounding and what is declared, %.

    A unit's loading curve is even: a polynomial of the third degree leaves less than 0.02 % of the wind-up. What an
    encoder repeats in its turn stands in all cycles at the same angle.
    """
    found = evidence.measured
    if found is None:
        return NOT_EVALUATED
    if not has_span(found):
        return "not measured: the wind-up does not change"
    if found.interruptions:
        return "not measured: a ramp was interrupted"
    steps = angle_steps(evidence)
    rounding = steps.figure / math.pi * span_arcmin(found) / 100.0 if isinstance(steps, Reading) else 0.0
    friction_nm = REVERSAL_EXCLUSION * max(loop.friction_nm for loop in found.loops)
    worst, words, unseen, longest = 0.0, "", 0.0, math.inf
    for side, branches in enumerate(zip(*found.pairs, strict=True)):
        blocks = [_loading_blocks(one, 1 - 2 * side, friction_nm) for one in branches]
        loading = [one for one in blocks if one is not None]
        if len(loading) < len(blocks):
            return (
                "not measured: a loading branch rises in steps, has mostly friction torque, or has less than "
                f"{WAVE_BLOCKS * LEAST_PER_BLOCK} samples up to {100 * WAVE_AT[1]:g} % of its torque"
            )
        way = float(np.ptp(loading[0][1]))
        amplitudes = [0.0]
        for degree, tried in EVEN.items():
            stretches = [(angle, angle - np.polyval(np.polyfit(at, angle, degree), at)) for at, angle in loading]
            amplitudes += _amplitudes_arcmin(stretches, way / tried) if way else []
        explained = BY_CHANCE * _of_noise_arcmin(stretches) + rounding + evidence.angle_wave_arcmin
        beyond, unseen, longest = max(amplitudes) - explained, max(unseen, explained), min(longest, way)
        if beyond > worst:
            worst = beyond
            words = f"an even curve leaves a wave of {max(amplitudes):.2g} arcmin over the angle in the loading branch"
    per_shaft = found.method.ratio if found.method.loading == "input" else 1.0
    per_turn = OPEN_FROM * FULL_TURN_ARCMIN / (longest * per_shaft) if longest > 0.0 else math.inf
    at_shaft = per_shaft / LEFT_OF_WAVE
    left_open = LeftOpen(at_shaft * span_arcmin(found) / 100.0, at_shaft * unseen, f"{per_turn:.0f} or more in a turn")
    return of_span(found, worst, words)._replace(left_open=left_open)


def _loading_blocks(branch: BranchSamples, side: int, friction_nm: float) -> tuple[FloatArray, FloatArray] | None:
    """Torque over its largest, and angle [arcmin], of the loading part of a branch in blocks; None of few."""
    if part_ends_nm(branch).size:
        return None
    torque = side * branch.torque_nm
    peak = float(torque.max())
    low, high = max(WAVE_AT[0] * peak, friction_nm), WAVE_AT[1] * peak
    if high - low < LEAST_WAY * peak:
        return None
    inside = (torque > low) & (torque < high)
    per_block = int(np.count_nonzero(inside)) // WAVE_BLOCKS
    if per_block < LEAST_PER_BLOCK:
        return None
    at, angle = (
        values[inside][: per_block * WAVE_BLOCKS].reshape(WAVE_BLOCKS, per_block).mean(axis=1)
        for values in (torque / high, branch.windup_arcmin)
    )
    return at, angle


def _amplitudes_arcmin(stretches: list[tuple[FloatArray, FloatArray]], lengths_arcmin: FloatArray) -> list[float]:
    """Amplitude of the wave of each length that all cycles have in common, arcmin."""
    angles, left = (np.array(values) for values in zip(*stretches, strict=True))
    turns = np.exp((-2j * math.pi / lengths_arcmin)[:, None, None] * angles)
    found: list[float] = (2.0 * np.abs((left * turns).mean(axis=2).mean(axis=1))).tolist()
    return found


def _of_noise_arcmin(stretches: list[tuple[FloatArray, FloatArray]]) -> float:
    """Standard uncertainty of either part of such an amplitude, by what neighbouring blocks differ, arcmin."""
    variance = float(np.mean([np.mean(np.square(np.diff(left, 2))) / 6.0 for _, left in stretches]))
    return math.sqrt(2.0 * variance / (WAVE_BLOCKS * len(stretches)))


FIGURES: dict[str, Figure] = {
    "stiffness_low": stiffness_low,
    "stiffness_high": stiffness_high,
    "loss": loss,
    "width_growth": width_growth,
    "creep_back": creep_back,
    "angle_waves": angle_waves,
}
"""Figures of these checks, by their ids."""
