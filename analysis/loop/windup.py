"""Wind-up of the unit, one angle at the output, from the angles of both shafts."""

from __future__ import annotations

from typing import NamedTuple

from analysis.loop.fixture_curve import Angles
from analysis.loop.method import Method
from analysis.loop.stages import StageRecord
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from definitions.units import ARCMIN_PER_RAD


class Windup(NamedTuple):
    """Wind-up of the whole trace [arcmin], what it is made of, and the record of the stage."""

    arcmin: FloatArray
    angles: Angles
    record: StageRecord


def measured_windup(trace: Trace, method: Method) -> Windup:
    """Return the wind-up; with the loaded shaft's angle alone the deflection of the fixture is still in it.

    With both encoders: loaded shaft minus locked shaft, at the output. With one: the input angle over the ratio when
    the input is loaded, or the output angle; with input loading an output angle alone is a wind-up that somebody has
    made already. AnalysisError when there is no angle to take, and when what is there belongs to a bench that has
    measured both shafts: its output angle is that of the lock.
    """
    angle_in, angle_out = trace.angle_in_rad, trace.angle_out_rad
    to_output = ARCMIN_PER_RAD / method.ratio
    if angle_in is not None and angle_out is not None:
        windup = angle_out * -ARCMIN_PER_RAD
        windup += angle_in * to_output
        if method.loading == "input":
            return Windup(windup, "both", _record("wind-up = angle_in / ratio − angle_out"))
        return Windup(-windup, "both", _record("wind-up = angle_out − angle_in / ratio"))
    if method.loading == "output":
        windup = trace.channel("angle_out_rad", "the wind-up") * ARCMIN_PER_RAD
        return Windup(windup, "loaded", _record("wind-up = angle_out; the locked input was not measured"))
    if angle_in is not None:
        how = "wind-up = angle_in / ratio; the locked output was not measured"
        return Windup(angle_in * to_output, "loaded", _record(how))
    if angle_out is not None:
        _refuse_lock_as_windup(trace)
        how = "wind-up = angle_out as given; there is no input angle in the trace"
        return Windup(angle_out * ARCMIN_PER_RAD, "given", _record(how))
    return Windup(trace.channel("angle_in_rad", "the wind-up"), "loaded", _record(""))


def _refuse_lock_as_windup(trace: Trace) -> None:
    """Refuse an output angle alone beside what only a loaded input has: it is the angle of the locked shaft."""
    calibrated = any(info.role == "calibrate" for info in trace.segments.values())
    if trace.torque_in_nm is not None or calibrated:
        found = "the input torque (torque_in_nm)" if trace.torque_in_nm is not None else "calibrate segments"
        raise AnalysisError(
            f"{trace.source}: found angle_out and {found}, and no angle_in: with the input loaded, angle_out is that "
            "of the locked shaft; expected the angle of the input shaft. Add angle_in_rad or angle_in_arcmin; where "
            "angle_out is a wind-up that was made elsewhere, give it with torque_out_nm alone"
        )


def _record(text: str) -> StageRecord:
    return StageRecord("wind-up", text)
