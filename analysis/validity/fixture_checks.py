"""Figures of the validity checks on lock and fixture: what is not measured of them, moves by itself, or is taken out.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.loop.measured import Measured
from analysis.trace.units import FloatArray
from analysis.validity.evidence import NO_SPAN, Figure, Reading, of_measured, of_span, span_arcmin
from definitions.units import ARCMIN_PER_RAD

BLOCKS = 200
"""Means of a branch that the locked shaft is looked at by: noise and counts of its encoder are no motion."""

SOFTER = 2.0
"""How much softer than declared a lock may be: brake and clamping are not in every figure of a fixture."""


LEAST_SHARE = 0.002
"""Share of the wind-up that the fixture must give way by, for its motion to be looked for: less makes no error."""

CLEAR_OF_NOISE = 10.0
"""Times the standard error of the locked shaft's slope that the declared one must be, for its encoder to show it."""


@of_measured
def locked_angle(found: Measured) -> Reading | str:
    """Count deflections that are in the wind-up and that nobody knows."""
    method, curve = found.method, found.method.fixture_curve
    known = method.fixture_stiffness_nm_per_arcmin is not None or (curve is not None and curve.angles == "loaded")
    return Reading(0.0 if known or found.angles != "loaded" else 1.0)


@of_measured
def locked_motion(found: Measured) -> Reading | str:
    """Motion of the locked shaft, as wind-up, that its torque does not explain, % of the wind-up.

    A lock gives way in proportion to its torque, at most twice as far as the fixture is declared to; what is left,
    from end to end, is slip, creep, or an angle of another shaft.
    """
    if found.angles != "both":
        return "not measured: needs the angle of the locked shaft in the trace"
    torque, angle = _locked(found)
    offset, slope = np.polynomial.polynomial.polyfit(torque, angle, 1)
    slope = max(float(slope), 0.0)
    stiffness = found.method.lock_nm_per_arcmin
    if stiffness is not None and found.method.loading == "input":
        slope = min(slope, SOFTER / stiffness)
    left = float(np.ptp(angle - offset - slope * torque))
    words = f"the locked shaft moves by {left:.3g} arcmin that its torque does not explain"
    return of_span(found, left, words)


@of_measured
def locked_compliance(found: Measured) -> Reading | str:
    """How far the locked shaft gives way with its torque, % of what the declared fixture does.

    An encoder that stands leaves the whole deflection in the wind-up, one with the wrong sign twice of it.
    """
    stiffness = found.method.lock_nm_per_arcmin
    if stiffness is None or found.method.loading == "output":
        return "not measured: needs the fixture stiffness in the bench file"
    torque, angle = _locked(found)
    if found.angles != "both":
        return "not measured: needs angle and torque of the locked shaft"
    expected = float(np.ptp(torque)) / stiffness
    (slope, _), covariance = np.polyfit(torque, angle, 1, cov=True)
    noise = CLEAR_OF_NOISE * float(np.sqrt(covariance[0, 0])) * float(np.ptp(torque))
    if expected < max(noise, LEAST_SHARE * span_arcmin(found)):
        why = "its encoder is too coarse for that" if noise > expected else "too little to matter"
        return f"not measured: the fixture deflects by {expected:.2g} arcmin, {why}"
    step = _recorded_step_arcmin(found)
    if not np.ptp(angle) and step > expected:
        words = f"the locked shaft's angle does not change; angles are recorded in steps of {step:.2g} arcmin, and the "
        return Reading(0.0, f"{words}fixture deflects by {expected:.2g} arcmin: record the angles with more digits")
    words = (
        f"the locked shaft turns by {slope * float(np.ptp(torque)):.2g} arcmin with its torque, but the fixture "
        f"deflects by {expected:.2g} arcmin: its encoder is stuck or counts in the wrong direction, or another "
        "fixture is mounted"
    )
    return Reading(100.0 * float(slope) * stiffness, words)


def _recorded_step_arcmin(found: Measured) -> float:
    """Least step of the loaded shaft's angle as it is recorded, which rounds both alike; arcmin at that shaft."""
    trace = found.recorded
    angle = trace.angle_in_rad if found.method.loading == "input" else trace.angle_out_rad
    if angle is None:
        return 0.0
    steps = np.abs(np.diff(angle))
    return float(steps[steps > 0.0].min(initial=math.inf)) * ARCMIN_PER_RAD if steps.any() else 0.0


def _locked(found: Measured) -> tuple[FloatArray, FloatArray]:
    """Torque at the output [N·m] and angle of the locked shaft, at the output [arcmin], in means along the branches."""
    trace, by_input = found.trace, found.method.loading == "input"
    locked = trace.angle_out_rad if by_input else trace.angle_in_rad
    scale = ARCMIN_PER_RAD if by_input else ARCMIN_PER_RAD / found.method.ratio
    torques, angles = [np.empty(0)], [np.empty(0)]
    for one in (one for pair in found.pairs for one in pair):
        if locked is None:
            continue
        angle = scale * one.run.take(locked)[one.masked :]
        edges = np.linspace(0, angle.size, min(BLOCKS, angle.size), endpoint=False).astype(np.int64)
        counts = np.diff(np.append(edges, angle.size))
        torques.append(np.add.reduceat(one.torque_nm, edges) / counts)
        angles.append(np.add.reduceat(angle, edges) / counts)
    return np.concatenate(torques), np.concatenate(angles)


@of_measured
def fixture_share(found: Measured) -> Reading | str:
    """Deflection of the fixture that is taken from the wind-up, % of the wind-up with it."""
    method, curve = found.method, found.method.fixture_curve
    ends = [end(one.torque_nm) for pair in found.pairs for one in pair for end in (np.min, np.max)]
    low, high = float(min(ends)), float(max(ends))
    if method.fixture == "report":
        taken = 0.0
    elif curve is not None and curve.angles == found.angles:
        taken = float(np.ptp(curve.at(np.array([low, high]))))
    elif method.fixture_stiffness_nm_per_arcmin is not None and found.angles == "loaded":
        taken = (high - low) / method.fixture_stiffness_nm_per_arcmin
    else:
        taken = 0.0
    whole = span_arcmin(found) + taken
    return Reading(100.0 * taken / whole) if whole > 0.0 else Reading(math.inf, NO_SPAN)


FIGURES: dict[str, Figure] = {
    "locked_angle": locked_angle,
    "locked_motion": locked_motion,
    "fixture_share": fixture_share,
    "locked_compliance": locked_compliance,
}
"""Figures of these checks, by their ids."""
