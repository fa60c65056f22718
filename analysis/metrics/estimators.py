"""How each metric is read off a loop: one small function per estimator, chosen by the id of its definition.

Each takes the loop of one cycle and what is asked, and returns the value in the metric's unit, with its sign where the
metric is its magnitude. AnalysisError, with the reason, where the loop does not carry the metric.

Three straight lines through a branch that meet at two break torques give K1, K2 and K3. Source: catalogues of strain
wave gears (Harmonic Drive), which divide the torque-torsion curve at T1 and T2. A grade is read off the mean backlash
of all cycles by the table `GRADES`, and never averaged itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from analysis.loop.curves import DEFAULT_FIT, fitted_curve
from analysis.loop.loop import Curve, Loop
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray
from definitions.metrics import GRADES, LSQ_POINTS, SPRING_STEP_ENDS
from definitions.units import ARCSEC_PER_ARCMIN

LSQ_BAND = (0.2, 0.8)
"""Band of the least squares and the two-point stiffness, of the reference torque ("stiffness characterization", 4)."""

SECANT_BAND = (0.5, 1.0)
"""Band of the secant stiffness of makers' catalogues, of the reference torque."""

ROUNDING = LSQ_POINTS * float(np.finfo(np.float64).eps)
"""Share of the largest singular value of so many points that is rounding."""

OPEN = 0.02
"""Share of a branch's torque by which the two may end apart: a turn that creeps opens it by less, a mask by more."""


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
    """Backlash that a grade is read off (see `GRADED`), arcmin; the wider side where it has sides."""
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
    torque, centred, square = lsq_line(loop.reference_nm)
    return _ratio(1.0, float((centred * loop.loading(ask.side, torque)).sum() / square))


def stiffness_chord(loop: Loop, ask: Ask, between: tuple[float, float]) -> float:
    """Chord of a branch between two torques, fractions of the reference torque, N·m/arcmin."""
    low, high = between
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
    torque, slopes = three_segments(ends)
    if ask.branch == "load":
        windup = loop.loading(ask.side, torque)
    else:
        windup = np.array([loop.branch_at(ask.branch, ask.side, float(one)) for one in torque])
    return _ratio(1.0, float(slopes[segment] @ windup))


def stiffness_at(loop: Loop, ask: Ask) -> float:
    """1 / F′(T) of a fitted curve: the mean curve or one branch's own, N·m/arcmin."""
    if ask.torque_nm > loop.method.fit_nm:
        raise AnalysisError(
            f"the fitted curve ends at {loop.method.fit_nm:.4g} N·m, but a value is needed at {ask.torque_nm:.4g} "
            f"N·m; choose a lower torque, or a higher reference torque"
        )
    return _curve(loop, ask).stiffness_at(ask.side * ask.torque_nm)


def spring_constant(loop: Loop, ask: Ask) -> float:
    """ΔT / ΔF over a small step that ends at, starts from, or is centred on the reference torque, N·m/arcmin.

    Of a fitted curve, the mean one or a branch's own. Variant "direct" takes the branches as measured instead of the
    fit, over the step that ends there.
    """
    step = loop.method.spring_step_nm
    end = loop.reference_nm + SPRING_STEP_ENDS[ask.variant] * step
    torques = (ask.side * (end - step), ask.side * end)
    if ask.variant == "direct":
        before, after = (ask.side * loop.branch_at(ask.branch, ask.side, abs(torque)) for torque in torques)
    else:
        before, after = (_curve(loop, ask).value_at(torque) for torque in torques)
    return _ratio(ask.side * step, after - before)


def windup(loop: Loop, ask: Ask) -> float:
    """F(+T_r) − F(−T_r) of the fitted mean curve, arcmin; variant "direct": of the branches as measured."""
    torque = loop.reference_nm
    if ask.variant == "direct":
        return loop.mean_at(torque) - loop.mean_at(-torque)
    curve = _curve(loop, ask)
    return curve.value_at(torque) - curve.value_at(-torque)


def hysteresis_energy(loop: Loop, ask: Ask) -> float:  # noqa: ARG001
    """Area of the whole loop, N·m·arcmin; AnalysisError where the loop is cut open at a turn."""
    ends = [(branch.torque_nm[0], branch.torque_nm[-1]) for branch in (loop.forward, loop.backward)]
    missing = max(abs(float(one - other)) for one, other in zip(*ends, strict=True))
    if missing > OPEN * max(float(high - low) for low, high in ends):
        raise AnalysisError(
            f"the loop is incomplete: after a reversal, {missing:.3g} N·m of one branch are missing, so the loop has "
            "no "
            "area; measure the torque at the output, or leave this metric out of the recipe"
        )
    return loop.energy_nm_arcmin


def _curve(loop: Loop, ask: Ask) -> Curve:
    return fitted_curve(loop, ask.fit, ask.branch, ask.side)


def _ratio(torque_nm: float, angle_arcmin: float) -> float:
    """Torque over angle; not a number where the angle does not change."""
    return torque_nm / angle_arcmin if angle_arcmin else math.nan


@lru_cache(maxsize=16)
def lsq_line(reference_nm: float) -> tuple[FloatArray, FloatArray, float]:
    """Return torques of the least squares line [N·m], the same less their mean, and the sum of the squares of that."""
    low, high = LSQ_BAND
    torque_nm = np.linspace(low * reference_nm, high * reference_nm, LSQ_POINTS)
    centred = torque_nm - torque_nm.mean()
    return torque_nm, centred, float(np.square(centred).sum())


@lru_cache(maxsize=16)
def three_segments(ends_nm: tuple[float, float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Return torques from 0 up [N·m], and what makes the slopes of the three lines of the wind-up at these.

    ends_nm: of the lines. The slopes [arcmin per N·m] are those of least squares; a budget asks for them thousands of
    times, always at the same torques.
    """
    _, first, second, last = ends_nm
    torque_nm = np.linspace(0.0, last, LSQ_POINTS)
    columns = (
        np.ones_like(torque_nm),
        np.minimum(torque_nm, first),
        np.clip(torque_nm - first, 0.0, second - first),
        np.maximum(torque_nm - second, 0.0),
    )
    return torque_nm, np.asarray(np.linalg.pinv(np.column_stack(columns), rcond=ROUNDING)[1:], dtype=np.float64)


def grade_of(backlash_arcmin: float) -> int:
    """Return the best grade that takes a backlash [arcmin]; the border belongs to the better grade."""
    return next(row.grade for row in GRADES if backlash_arcmin <= row.most_arcmin)


def grade_uncertainty(backlash_arcmin: float, expanded_arcmin: float) -> float:
    """Return by how many grades the truth may differ, for a backlash and its expanded uncertainty [arcmin]."""
    here = grade_of(backlash_arcmin)
    worse = grade_of(backlash_arcmin + expanded_arcmin) - here
    better = here - grade_of(max(0.0, backlash_arcmin - expanded_arcmin))
    return float(max(worse, better))


def backlash_limits(least: float | None, most: float | None) -> tuple[float | None, float | None]:
    """Return the limits on the backlash [arcmin] that limits on the grade stand for; None where there is none."""
    above = [row.most_arcmin for row in GRADES if least is not None and row.grade < least]
    within = [row.most_arcmin for row in GRADES if most is not None and row.grade <= most]
    high = None if most is None else max(within, default=0.0)
    return (max(above) if above else None), (None if high == math.inf else high)


ESTIMATORS: dict[str, Callable[[Loop, Ask], float]] = {
    "backlash_width_3pct": backlash_width,
    "backlash_width_zero": backlash_width,
    "backlash_branches_3pct": backlash_branches,
    "gear_clearance": gear_clearance,
    "grade": graded_backlash,
    "lost_motion": lost_motion,
    "stiffness_lsq": stiffness_lsq,
    "stiffness_two_point": partial(stiffness_chord, between=LSQ_BAND),
    "stiffness_end_point": stiffness_end_point,
    "stiffness_estimate": stiffness_estimate,
    "stiffness_50_100": partial(stiffness_chord, between=SECANT_BAND),
    "stiffness_at": stiffness_at,
    "spring_constant": spring_constant,
    "k1": partial(stiffness_segment, segment=0),
    "k2": partial(stiffness_segment, segment=1),
    "k3": partial(stiffness_segment, segment=2),
    "hysteresis_energy": hysteresis_energy,
    "hysteresis_angle": hysteresis_angle,
    "windup": windup,
    "asymmetry_at_rated": asymmetry,
}
"""What reads each metric off a loop, by its id; a metric of the torque ratio has none."""
