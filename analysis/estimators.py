"""How each metric is read off a loop: one small function per estimator, chosen by the table of metrics.

Each takes the loop of one cycle and what is asked, and returns the value in the metric's unit, with its sign where the
metric is its magnitude. AnalysisError, with the reason, where the loop does not carry the metric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from analysis.conversions import ARCSEC_PER_ARCMIN
from analysis.curves import DEFAULT_FIT, fitted_curve
from analysis.errors import AnalysisError
from analysis.loop import Curve, Loop
from analysis.segment_stiffness import three_segments

LSQ_BAND = (0.2, 0.8)
"""Band of the least squares and the two-point stiffness, of the reference torque ("stiffness characterization", 4)."""

OPEN = 0.02
"""Share of a branch's torque by which the two may end apart: a turn that creeps opens it by less, a mask by more."""

LSQ_POINTS = 200
"""Torques, equally spaced, of the least squares stiffness."""


@dataclass(frozen=True)
class Ask:
    """What is asked of a loop: side +1, -1 or 0 (both), branch, torque [N·m], band (fraction), variant, fit."""

    side: int
    branch: str
    torque_nm: float
    band: float
    variant: str
    fit: str = DEFAULT_FIT


def backlash_width(loop: Loop, ask: Ask) -> float:
    """Width of the loop at a band of the reference torque: r(T) − f(T), arcmin."""
    torque = ask.side * ask.band * loop.reference_nm
    return loop.falling_at(torque) - loop.rising_at(torque)


def backlash_branches(loop: Loop, ask: Ask) -> float:
    """Return branch at plus the band minus forward branch at minus the band: r(+b·T) − f(−b·T), arcmin."""
    torque = ask.band * loop.reference_nm
    return loop.falling_at(torque) - loop.rising_at(-torque)


def gear_clearance(loop: Loop, ask: Ask) -> float:
    """Unloading branches at zero torque, arcmin: half their distance, or one side's own.

    Unloading the positive side ends at r(0), unloading the negative side at f(0). Variant "centred" takes a side from
    the mean of the two, so that both sides have half the width; "intercept" from the zero of the angle as recorded.
    """
    positive, negative = loop.falling_at(0.0), loop.rising_at(0.0)
    if ask.variant == "intercept" and ask.side:
        return positive if ask.side > 0 else -negative
    return (positive - negative) / 2.0


def hysteresis_angle(loop: Loop, ask: Ask) -> float:
    """Width of the loop at a torque within one side: r(T) − f(T), arcsec."""
    torque = ask.side * ask.torque_nm
    return ARCSEC_PER_ARCMIN * (loop.falling_at(torque) - loop.rising_at(torque))


def asymmetry(loop: Loop, ask: Ask) -> float:  # noqa: ARG001
    """Return (m(+T_r) + m(−T_r) − 2 m(0)) / 2, arcsec; positive when the positive side winds up more."""
    torque = loop.reference_nm
    return ARCSEC_PER_ARCMIN * (loop.mean_at(torque) + loop.mean_at(-torque) - 2.0 * loop.mean_at(0.0)) / 2.0


def graded_backlash(loop: Loop, ask: Ask) -> float:
    """Backlash that a grade is read off (see `analysis.grades.GRADED`), arcmin; the wider side where it has sides."""
    if ask.variant == "lost_motion":
        return lost_motion(loop, ask)
    if ask.variant == "branches":
        return backlash_branches(loop, ask)
    if ask.variant == "width_zero":
        return abs(backlash_width(loop, replace(ask, band=0.0)))
    return max(abs(backlash_width(loop, replace(ask, side=side))) for side in (1, -1))


def lost_motion(loop: Loop, ask: Ask) -> float:
    """Centreline between plus and minus the band: m(+b·T) − m(−b·T), arcmin."""
    torque = ask.band * loop.reference_nm
    return loop.mean_at(torque) - loop.mean_at(-torque)


def stiffness_lsq(loop: Loop, ask: Ask) -> float:
    """Inverse slope of the least squares line of wind-up over torque, loading branch, N·m/arcmin."""
    low, high = LSQ_BAND
    torque = np.linspace(low * loop.reference_nm, high * loop.reference_nm, LSQ_POINTS)
    centred = torque - torque.mean()
    slope = float((centred * loop.loading(ask.side, torque)).sum() / np.square(centred).sum())
    return _ratio(1.0, slope)


def stiffness_chord(loop: Loop, ask: Ask) -> float:
    """Chord of a branch between two torques: 20–80 % ("two_point") or 50–100 % ("secant"), N·m/arcmin."""
    low, high = LSQ_BAND if ask.variant == "two_point" else (0.5, 1.0)
    low_nm, high_nm = low * loop.reference_nm, high * loop.reference_nm
    turned = loop.branch_at(ask.branch, ask.side, high_nm) - loop.branch_at(ask.branch, ask.side, low_nm)
    return _ratio(high_nm - low_nm, turned)


def stiffness_end_point(loop: Loop, ask: Ask) -> float:
    """T_r / (load(T_r) − unload(0)), N·m/arcmin, as "stiffness characterization" 4.2 prints it."""
    turned = loop.branch_at("load", ask.side, loop.reference_nm) - loop.branch_at("unload", ask.side, 0.0)
    return _ratio(loop.reference_nm, turned)


def stiffness_estimate(loop: Loop, ask: Ask) -> float:
    """Chord of the whole loading branch, T_r / (load(T_r) − load(0)), N·m/arcmin."""
    turned = loop.branch_at("load", ask.side, loop.reference_nm) - loop.branch_at("load", ask.side, 0.0)
    return _ratio(loop.reference_nm, turned)


def stiffness_segment(loop: Loop, ask: Ask, segment: int) -> float:
    """Stiffness of one of three segments, 0 … T1 … T2 … T_r of a branch, N·m/arcmin; segment: 0, 1 or 2.

    Variant "fitted": three straight lines that meet at the break torques, least squares; "chord": ΔT / Δφ of each.
    """
    ends = (0.0, *loop.method.stiffness_breaks_nm, loop.reference_nm)
    if ask.variant == "chord":
        low, high = ends[segment], ends[segment + 1]
        turned = loop.branch_at(ask.branch, ask.side, high) - loop.branch_at(ask.branch, ask.side, low)
        return _ratio(high - low, turned)
    torque = np.linspace(0.0, loop.reference_nm, LSQ_POINTS)
    if ask.branch == "load":
        windup = loop.loading(ask.side, torque)
    else:
        windup = np.array([loop.branch_at(ask.branch, ask.side, float(one)) for one in torque])
    return _ratio(1.0, three_segments(torque, windup, loop.method.stiffness_breaks_nm)[segment])


def stiffness_at(loop: Loop, ask: Ask) -> float:
    """1 / F′(T) of a fitted curve: the mean curve or one branch's own, N·m/arcmin."""
    if ask.torque_nm > loop.method.fit_nm:
        raise AnalysisError(
            f"the curve is fitted to {loop.method.fit_nm:.4g} N·m and asked for {ask.torque_nm:.4g} N·m; choose a "
            "torque within, or a higher reference torque"
        )
    return _curve(loop, ask).stiffness_at(ask.side * ask.torque_nm)


def spring_constant(loop: Loop, ask: Ask) -> float:
    """ΔT / ΔF over a small step that ends at, starts from, or is centred on the reference torque, N·m/arcmin.

    Of a fitted curve, the mean one or a branch's own. Variant "direct" takes the branches as measured instead of the
    fit, over the step that ends there.
    """
    step = loop.method.spring_step_nm
    end = loop.reference_nm + {"ending": 0.0, "centred": 0.5, "from": 1.0, "direct": 0.0}[ask.variant] * step
    torques = ask.side * np.array([end - step, end])
    if ask.variant == "direct":
        angles = np.array([_measured(loop, ask, float(torque)) for torque in torques])
    else:
        angles = _curve(loop, ask).at(torques)
    return _ratio(ask.side * step, float(angles[1] - angles[0]))


def windup(loop: Loop, ask: Ask) -> float:
    """F(+T_r) − F(−T_r) of the fitted mean curve, arcmin; variant "direct": of the branches as measured."""
    torque = loop.reference_nm
    if ask.variant == "direct":
        return loop.raw_mean_at(torque) - loop.raw_mean_at(-torque)
    low, high = _curve(loop, ask).at(np.array([-torque, torque]))
    return float(high - low)


def hysteresis_energy(loop: Loop, ask: Ask) -> float:  # noqa: ARG001
    """Area of the whole loop, N·m·arcmin; AnalysisError where the loop is cut open at a turn."""
    ends = [(branch.torque_nm[0], branch.torque_nm[-1]) for branch in (loop.forward, loop.backward)]
    missing = max(abs(float(one - other)) for one, other in zip(*ends, strict=True))
    if missing > OPEN * max(float(high - low) for low, high in ends):
        raise AnalysisError(
            f"the loop is cut open: {missing:.3g} N·m are missing in one branch after a reversal, and its area with "
            "them; measure the torque at the output, or leave this metric out of the recipe"
        )
    return loop.energy_nm_arcmin


def _curve(loop: Loop, ask: Ask) -> Curve:
    return fitted_curve(loop, ask.fit, ask.branch, ask.side)


def _measured(loop: Loop, ask: Ask, torque_nm: float) -> float:
    """Wind-up of the branch or of the mean, as measured next to the turning points too."""
    if ask.branch == "mean":
        return loop.raw_mean_at(torque_nm)
    branch = loop.forward if (ask.branch == "load") == (ask.side > 0) else loop.backward
    return float(branch.at(np.array([torque_nm]))[0])


def _ratio(torque_nm: float, angle_arcmin: float) -> float:
    """Torque over angle; not a number where the angle does not change."""
    return torque_nm / angle_arcmin if angle_arcmin else math.nan
