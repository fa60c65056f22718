"""How each metric is read off a loop: one small function per estimator, chosen by the table of metrics.

Each takes the loop of one cycle and what is asked, and returns the value in the metric's unit. AnalysisError, with
the reason, where the loop does not carry the metric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.errors import AnalysisError
from analysis.loop import Loop

LSQ_BAND = (0.2, 0.8)
"""Band of the least squares and the two-point stiffness, of the reference torque ("stiffness characterization", 4)."""

LSQ_POINTS = 200
"""Torques, equally spaced, of the least squares stiffness."""


@dataclass(frozen=True)
class Ask:
    """What is asked of a loop: side +1, -1 or 0 (both together), branch, torque [N·m], band (fraction), variant."""

    side: int
    branch: str
    torque_nm: float
    band: float
    variant: str


def backlash_width(loop: Loop, ask: Ask) -> float:
    """Width of the loop at a band of the reference torque: |f(T) − r(T)|, arcmin."""
    torque = ask.side * ask.band * loop.reference_nm
    return abs(loop.rising_at(torque) - loop.falling_at(torque))


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


def stiffness_at(loop: Loop, ask: Ask) -> float:
    """1 / F′(T) of the fitted mean curve, N·m/arcmin."""
    if ask.torque_nm > loop.method.fit_nm:
        raise AnalysisError(
            f"the mean curve is fitted to {loop.method.fit_nm:.4g} N·m and asked for {ask.torque_nm:.4g} N·m; choose a "
            "torque within, or a higher reference torque"
        )
    return loop.fit.mean.stiffness_at(ask.side * ask.torque_nm)


def spring_constant(loop: Loop, ask: Ask) -> float:
    """ΔT / ΔF over a small step that ends at, starts from, or is centred on the reference torque, N·m/arcmin.

    Variant "direct" takes the mean of the branches as measured instead of the fit, over the step that ends there.
    """
    step = loop.method.spring_step_nm
    end = loop.reference_nm + {"ending": 0.0, "centred": 0.5, "from": 1.0, "direct": 0.0}[ask.variant] * step
    torques = ask.side * np.array([end - step, end])
    if ask.variant == "direct":
        angles = np.array([loop.raw_mean_at(float(torque)) for torque in torques])
    else:
        angles = loop.fit.mean.at(torques)
    return _ratio(ask.side * step, float(angles[1] - angles[0]))


def windup(loop: Loop, ask: Ask) -> float:
    """F(+T_r) − F(−T_r) of the fitted mean curve, arcmin; variant "direct": of the branches as measured."""
    torque = loop.reference_nm
    if ask.variant == "direct":
        return loop.raw_mean_at(torque) - loop.raw_mean_at(-torque)
    low, high = loop.fit.mean.at(np.array([-torque, torque]))
    return float(high - low)


def hysteresis_energy(loop: Loop, ask: Ask) -> float:  # noqa: ARG001
    """Area of the whole loop, N·m·arcmin."""
    return loop.energy_nm_arcmin


def _ratio(torque_nm: float, angle_arcmin: float) -> float:
    """Torque over angle; not a number where the angle does not change."""
    return torque_nm / angle_arcmin if angle_arcmin else math.nan
