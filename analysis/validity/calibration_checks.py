"""Figures of the validity checks that hold the calibration of this run against its cycles.

Most ask whether it can convert their torque. Where both torques were measured in the cycles too, both say which ratio
the unit has. Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps

import numpy as np

from analysis.loop.measured import Measured
from analysis.loop.samples import converts
from analysis.torque_ratio.quadrant_fit import quadrant_points
from analysis.torque_ratio.quadrants import Quadrants
from analysis.torque_ratio.stretches import beyond_friction, stretches_of
from analysis.torque_ratio.transition_fit import ZERO_BOUND
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import Run
from analysis.validity.evidence import Figure, Reading, of_measured
from analysis.validity.settled_lines import (
    IN_TRANSITION,
    SIDES,
    TOLD,
    WITHOUT_PLAY,
    begins_of_both_nm,
    ratios_apart,
    settled_lines,
)
from definitions.checks import CHECKS

NOT_CONVERTED = "needs an output torque that is calculated by a calibration in this run"
NO_TRANSITION = "not needed: the calibration shows no transition after a reversal"


def of_own_calibration(figure: Callable[[Measured, Quadrants], Reading | str]) -> Figure:
    """Make a check's figure of one that reads the quadrants measured in this run: where they convert nothing, none."""

    @of_measured
    @wraps(figure)
    def read(found: Measured) -> Reading | str:
        quadrants, method = found.quadrants, found.method
        if not converts(found.trace, method) or method.quadrants is not None or not isinstance(quadrants, Quadrants):
            return NOT_CONVERTED
        return figure(found, quadrants)

    return read


@of_own_calibration
def calibrated_turn(found: Measured, quadrants: Quadrants) -> Reading | str:
    """How far the input torque at a turn of the cycles is from that at the same turn while calibrating, %.

    Transition and correction belong to the turn that they were measured after.
    """
    if quadrants.transition_rad is None:
        return NO_TRANSITION
    turns: dict[tuple[str, int], list[float]] = {}
    for run in _runs(found):
        turns.setdefault((run.role, run.direction), []).append(_turn_nm(found, run))
    worst, words = 0.0, ""
    for direction in (1, -1):
        # A branch that starts at rest has no turn: the largest torque is that of the one that comes from a turn.
        calibrated = max(turns.get(("calibrate", direction), [0.0]))
        for measured in turns.get(("measure", direction), []):
            apart = abs(measured / calibrated - 1.0) if calibrated > 0.0 else math.inf
            if apart > worst:
                worst = apart
                words = (
                    f"the cycles reverse at {-direction * measured:.4g} N·m at the input, the calibration reversed at "
                    f"{-direction * calibrated:.4g} N·m: its correction of friction after a reversal does not apply"
                )
    return Reading(100.0 * worst, words)


@of_own_calibration
def calibrated_gap(found: Measured, _quadrants: Quadrants) -> Reading | str:
    """Largest torque between neighbouring samples of a calibrated branch, in order of torque, % of the reference."""
    output = found.trace.channel("torque_out_nm", "the torque ratio")
    worst, words = 0.0, ""
    for run in _calibration(found):
        torque = np.sort(run.take(output))
        gaps = np.diff(torque)
        if gaps.size and float(gaps.max()) > worst:
            at = int(np.argmax(gaps))
            worst = float(gaps[at])
            words = f"the calibration has no sample between {torque[at]:.3g} and {torque[at + 1]:.3g} N·m"
    return Reading(100.0 * worst / found.method.reference_nm, words)


@of_own_calibration
def calibrated_zero(found: Measured, quadrants: Quadrants) -> Reading | str:
    """What the output sensor read at zero torque by the calibration, % of the largest reading that is sought."""
    if quadrants.transition_rad is None:
        return NO_TRANSITION
    output = found.trace.channel("torque_out_nm", "the torque ratio")
    peak_nm = max(float(np.abs(run.take(output)).max()) for run in _calibration(found))
    share = abs(quadrants.zero_nm) / (ZERO_BOUND * peak_nm)
    return Reading(
        100.0 * share, f"the zero of the output torque was not found: its search ended at {quadrants.zero_nm:+.3g} N·m"
    )


@of_measured
def calibration_agreement(found: Measured) -> Reading | str:
    """How far the ratio that the torques show while calibrating is from that in the cycles, % of the recipe's.

    Beyond the scatter of the lines. Friction that is another in the cycles, for it is warmer or faster, moves the lines
    of loading and unloading against each other, and their harmonic mean by nothing. A gain that changed in between
    moves both alike, and friction that changed within one branch bends that one alone.
    """
    trace, ratio = found.trace, found.method.ratio
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        return "needs two torque channels"
    calibration, cycles = _calibration(found), _cycles(found)
    if not calibration:
        return "needs a calibration in this run"
    try:
        apart, shown = ratios_apart(trace, calibration, cycles), settled_lines(trace, cycles).ratios
    except AnalysisError as error:
        return f"not measured: {error}"
    # Where the transition after a turn has not ended, that of a first loading from rest is another.
    if max(one.expanded for one in shown.values()) > TOLD * ratio:
        return IN_TRANSITION
    side, worst = max(apart.items(), key=lambda one: abs(one[1].value) - one[1].expanded)
    beyond = 100.0 * max(0.0, abs(worst.value) - worst.expanded) / ratio
    unsure = max(one.expanded for one in apart.values())
    if unsure > TOLD * ratio and beyond <= CHECKS["calibration_agreement"].limit:
        return "not measured: the torque ratio of the calibration scatters too much"
    words = (
        f"the torques of the calibration show a gear ratio that is {100.0 * abs(worst.value) / ratio:.2g} % "
        f"{'larger' if worst.value > 0.0 else 'smaller'} than that of the measured cycles on the {side} side; scatter "
        f"explains {100.0 * worst.expanded / ratio:.2g} % of it"
    )
    return Reading(beyond, words)


@of_measured
def calibration_torque(found: Measured) -> Reading | str:
    """How far the output torque while calibrating is from that of the cycles at the same input torque, % of the peak.

    Friction that changed in between moves loading and unloading against each other, by a part that grows with the
    load and one that does not. A zero that moved for a while moves one branch, or a piece of it: nothing in the line
    of that branch need tell it from another line.
    """
    trace = found.trace
    if trace.torque_in_nm is None or trace.torque_out_nm is None:
        return "needs two torque channels"
    calibration, cycles = _calibration(found), _cycles(found)
    if not calibration:
        return "needs a calibration in this run"
    peak_nm = max(float(np.abs(run.take(trace.torque_out_nm)).max()) for run in calibration)
    begins = begins_of_both_nm(trace, calibration, cycles)
    # Below the share of these a side that is loaded from rest has friction of its own, and one with play bounces.
    own, others = (
        quadrant_points(trace, runs, loading=WITHOUT_PLAY, begins_nm=begins) for runs in (calibration, cycles)
    )
    try:
        shown = settled_lines(trace, cycles).ratios
        by_side = [stretches_of(own, others, side, peak_nm) for side in SIDES]
    except AnalysisError as error:
        return f"not measured: {error}"
    if max(one.expanded for one in shown.values()) > TOLD * found.method.ratio:
        return IN_TRANSITION
    worst, words = 0.0, ""
    for stretches in by_side:
        for one, left_nm in zip(stretches, beyond_friction(stretches), strict=True):
            beyond = max(0.0, abs(left_nm) - 2.0 * one.u_nm) / (one.allowed * peak_nm)
            if beyond > worst:
                worst = beyond
                words = (
                    "output torque over input torque of the calibration differs from that of the measured cycles by "
                    f"{abs(left_nm):.2g} N·m near {one.torque_nm:.3g} N·m, and a change of friction does not explain it"
                )
    return Reading(100.0 * worst, words)


def _calibration(found: Measured) -> list[Run]:
    return [run for run in found.runs if run.role == "calibrate"]


def _cycles(found: Measured) -> list[Run]:
    return [one.run for pair in found.pairs for one in pair]


def _runs(found: Measured) -> list[Run]:
    """Return the runs that calibrate, and those of the cycles."""
    return _calibration(found) + _cycles(found)


def _turn_nm(found: Measured, run: Run) -> float:
    """Input torque at the turn that a run begins at, N·m; positive on the side of that turn."""
    torque = found.trace.channel("torque_in_nm", "the torque ratio")
    return float((-run.direction * run.take(torque)).max())


FIGURES: dict[str, Figure] = {
    "calibrated_turn": calibrated_turn,
    "calibrated_gap": calibrated_gap,
    "calibrated_zero": calibrated_zero,
    "calibration_agreement": calibration_agreement,
    "calibration_torque": calibration_torque,
}
"""Figures of these checks, by their ids."""
