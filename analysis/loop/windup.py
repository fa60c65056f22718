"""Wind-up of the unit, one angle at the output, from the angles of both shafts; the fixture taken out of it.

A blank test measures the curve of the fixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # loads optimize where it is used

from analysis.loop.fixture_curve import Angles, FixtureCurve
from analysis.loop.loop import Loop
from analysis.loop.method import Method
from analysis.loop.samples import BranchSamples
from analysis.loop.stages import Figure, StageRecord
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from definitions.units import ARCMIN_PER_RAD

Pairs = list[tuple[BranchSamples, BranchSamples]]

CURVE_POINTS = 41
"""Torques of the curve that a blank test gives."""


class Windup(NamedTuple):
    """Wind-up of the whole trace [arcmin], what it is made of, and the record of the stage."""

    arcmin: FloatArray
    angles: Angles
    record: StageRecord


def measured_windup(trace: Trace, method: Method) -> Windup:
    """Return the wind-up; with the loaded shaft's angle alone the deflection of the fixture is still in it.

    With both encoders: loaded shaft minus locked shaft, at the output. With one: the input angle over the ratio when
    the input is loaded, or the output angle; with input loading an output angle alone is a wind-up that somebody has
    made already, and so is any that the trace calls one. AnalysisError when there is no angle to take, and when what is
    there belongs to a bench that has measured both shafts: its output angle is that of the lock.
    """
    angle_in, angle_out = trace.angle_in_rad, trace.angle_out_rad
    to_output = ARCMIN_PER_RAD / method.ratio
    alone = angle_out is not None and angle_in is None and method.loading == "input"
    if alone and not trace.windup_made:
        _refuse_lock_as_windup(trace)
    if alone or trace.windup_made:
        made = trace.channel("angle_out_rad", "the wind-up") * ARCMIN_PER_RAD
        return Windup(made, "given", _record("wind-up as given, no further correction"))
    if angle_in is not None and angle_out is not None:
        windup = angle_out * -ARCMIN_PER_RAD
        windup += angle_in * to_output
        if method.loading == "input":
            return Windup(windup, "both", _record("wind-up = angle_in / ratio − angle_out"))
        return Windup(-windup, "both", _record("wind-up = angle_out − angle_in / ratio"))
    if method.loading == "output":
        windup = trace.channel("angle_out_rad", "the wind-up") * ARCMIN_PER_RAD
        return Windup(windup, "loaded", _record("wind-up = angle_out; the locked input was not measured"))
    windup = trace.channel("angle_in_rad", "the wind-up") * to_output
    return Windup(windup, "loaded", _record("wind-up = angle_in / ratio; the locked output was not measured"))


def _refuse_lock_as_windup(trace: Trace) -> None:
    """Refuse an output angle alone beside what only a loaded input has: it is the angle of the locked shaft."""
    calibrated = any(info.role == "calibrate" for info in trace.segments.values())
    if trace.torque_in_nm is not None or calibrated:
        found = "the input torque (torque_in_nm)" if trace.torque_in_nm is not None else "calibrate segments"
        raise AnalysisError(
            f"{trace.source}: found angle_out and {found}, and no angle_in; expected the angle of the input shaft, "
            "because angle_out belongs to the locked shaft if the input is loaded. Add angle_in_rad or "
            "angle_in_arcmin. If angle_out is a wind-up from another program, leave out all columns but torque_out_nm "
            "and angle_out"
        )


def _record(text: str) -> StageRecord:
    return StageRecord("wind-up", text)


def correct_fixture(pairs: Pairs, angles: Angles, method: Method) -> tuple[Pairs, StageRecord]:
    """Take phi − T/K_fixture(T) of every sample, by the curve of a blank test or by one stiffness.

    A curve corrects a wind-up that is made of the same angles as its own; a stiffness corrects the loaded shaft's
    angle alone, for with both shafts' angles the deflection of lock and couplings is out already.
    """
    curve, stiffness = method.fixture_curve, method.fixture_stiffness_nm_per_arcmin
    peak = max(float(np.abs(one.torque_nm).max()) for pair in pairs for one in pair)
    if curve is not None and curve.angles == angles:
        name = f"blank test {curve.id}" if curve.id else "blank test"
        text = f"fixture: curve of {name} subtracted from the wind-up"
        figures = {
            f"stiffness at {sign}{peak:.4g} N·m": Figure(
                _finite(curve.stiffness_at(peak * (1 if sign == "+" else -1))), K
            )
            for sign in ("+", "-")
        }
        figures["deflection at the peak"] = Figure(float(curve.at(np.array([peak]))[0]), "arcmin")
    elif stiffness is not None and angles == "loaded":
        text = f"fixture: T / {stiffness:g} N·m/arcmin subtracted from the wind-up"
        figures = {"stiffness": Figure(stiffness, K), "deflection at the peak": Figure(peak / stiffness, "arcmin")}
    elif angles == "loaded":
        return pairs, StageRecord("fixture", "fixture: its stiffness is not known, its deflection is in the wind-up")
    else:
        why = "both shafts' angles" if angles == "both" else "the wind-up as given"
        return pairs, StageRecord("fixture", f"fixture: nothing to subtract from {why}")
    if method.fixture == "report":
        return pairs, StageRecord("fixture", f"{text}: not applied, the method only reports it", figures)

    def deflection(one: BranchSamples) -> FloatArray:
        if curve is not None and curve.angles == angles:
            return curve.at(one.torque_nm)
        return one.torque_nm / (stiffness or 1.0)

    corrected = [(rising.moved(deflection), falling.moved(deflection)) for rising, falling in pairs]
    return corrected, StageRecord("fixture", text, figures, applied=True)


K = "N·m/arcmin"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def blank_curve(loops: Sequence[Loop], angles: Angles, name: str = "") -> FixtureCurve:
    """Make the curve of a fixture from loops on a rigid dummy: mean of all branches, made monotone, zero at zero.

    Raises AnalysisError when the loops do not reach both signs of torque.
    """
    ends = [(branch.torque_nm[0], branch.torque_nm[-1]) for loop in loops for branch in (loop.forward, loop.backward)]
    low, high = max(float(end[0]) for end in ends), min(float(end[1]) for end in ends)
    if not low < 0.0 < high:
        raise AnalysisError(
            f"blank test: the loop goes from {low:.4g} to {high:.4g} N·m; expected negative and "
            "positive torques. Load the dummy in both directions"
        )
    half = CURVE_POINTS // 2
    torque = np.concatenate((np.linspace(low, 0.0, half + 1)[:-1], np.linspace(0.0, high, half + 1)))
    branches = [branch.at(torque) for loop in loops for branch in (loop.forward, loop.backward)]
    fitted = scipy.optimize.isotonic_regression(np.mean(branches, axis=0)).x
    deflection = fitted - fitted[half]
    return FixtureCurve(tuple(torque.tolist()), tuple(deflection.tolist()), angles, name)
