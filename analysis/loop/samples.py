"""Samples of the branches that are evaluated: which count, their torque at the output, wind-up and time, run by run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from analysis.loop.method import Method
from analysis.loop.stages import Figure, StageRecord
from analysis.torque_ratio.line_begin import begin_text
from analysis.torque_ratio.quadrant_fit import fit_quadrants, quadrants_of_cycles
from analysis.torque_ratio.quadrants import Quadrants, output_torque, turn_lines
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import Run, commanded_runs, found_runs, paired_cycles
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray

EVALUATED = ("measure", "calibrate")
"""Roles of the runs that are evaluated."""


def converts(trace: Trace, method: Method) -> bool:
    """Say whether input torque is to be converted; output torque alone was converted by somebody before."""
    return method.output_torque == "calibrated" and not (trace.torque_in_nm is None and trace.torque_out_nm is not None)


class Cut(NamedTuple):
    """Masked samples: torque by the line before the turn, which still holds at the turn itself, wind-up and time."""

    turn_nm: FloatArray
    windup_arcmin: FloatArray
    t_s: FloatArray | None


NOTHING_CUT = Cut(np.empty(0), np.empty(0), None)


@dataclass(frozen=True)
class BranchSamples:
    """One branch of one cycle in order of time: torque [N·m], wind-up [arcmin], time [s] or None.

    where: words that name the branch in messages. masked: samples that the torque ratio could not convert; they are the
    first ones, and `cut` has what is known of them.
    """

    run: Run
    cycle: int
    torque_nm: FloatArray
    windup_arcmin: FloatArray
    t_s: FloatArray | None
    where: str
    masked: int = 0
    cut: Cut = NOTHING_CUT

    def moved(self, change: Callable[[BranchSamples], FloatArray]) -> BranchSamples:
        """Return these samples with something subtracted from the wind-up."""
        cut = self.cut
        if self.masked:
            of_cut = replace(self, torque_nm=cut.turn_nm, windup_arcmin=cut.windup_arcmin, t_s=cut.t_s)
            cut = cut._replace(windup_arcmin=cut.windup_arcmin - change(of_cut))
        return replace(self, windup_arcmin=self.windup_arcmin - change(self), cut=cut)

    def without(self, masked: int, turn_nm: FloatArray) -> BranchSamples:
        """Return the samples after the masked ones; turn_nm: torque of these by the line before the turn."""
        time = self.t_s
        return replace(
            self,
            torque_nm=self.torque_nm[masked:],
            windup_arcmin=self.windup_arcmin[masked:],
            t_s=None if time is None else time[masked:],
            masked=masked,
            cut=Cut(turn_nm, self.windup_arcmin[:masked], None if time is None else time[:masked]),
        )


def part_ends_nm(samples: BranchSamples) -> FloatArray:
    """Return the torques [N·m] between the ramps and holds of a branch in steps, in order; none of a single ramp.

    They rise or fall with the branch, whatever the noise of a hold.
    """
    ends = np.cumsum([piece.stop - piece.start for piece in samples.run.pieces[:-1]], dtype=np.int64) - samples.masked
    direction = samples.run.direction
    inner: FloatArray = samples.torque_nm[ends[ends > 0] - 1]
    return direction * np.maximum.accumulate(direction * inner)


@dataclass(frozen=True)
class EvaluatedSamples:
    """Runs of a trace, the torque ratio if it was needed, rising and falling samples of each cycle, and the records."""

    runs: Sequence[Run]
    quadrants: Quadrants | AnalysisError
    pairs: list[tuple[BranchSamples, BranchSamples]]
    records: tuple[StageRecord, StageRecord, StageRecord]
    """Turning points, virgin quarter, output torque."""


def evaluated_samples(trace: Trace, method: Method, windup: FloatArray, *, with_ratio: bool) -> EvaluatedSamples:
    """Return the samples that are evaluated, with the torque at the output.

    windup: of every sample, arcmin. with_ratio: the torque ratio is wanted for its own sake too. Raises AnalysisError
    when there is no cycle, the torque is missing, or the ratio that converts it is.
    """
    runs, turning = _turning_points(trace, method)
    quadrants: Quadrants | AnalysisError = AnalysisError("not asked for")
    said: list[str] = []
    if with_ratio or converts(trace, method):
        quadrants, said = _torque_ratio(trace, method, runs)
    pairs = _branch_samples(trace, method, runs, windup, quadrants)
    torque = _output_torque_record(trace, method, pairs, quadrants, said)
    return EvaluatedSamples(runs, quadrants, pairs, (turning, _virgin_quarter(runs), torque))


def _turning_points(trace: Trace, method: Method) -> tuple[list[Run], StageRecord]:
    """Return all runs of one direction, from the commanded segments or from turning points found on the torque.

    Raises AnalysisError when there are no segments and the torque is missing or never turns.
    """
    runs = commanded_runs(trace)
    text = "branches: from the commanded segments"
    if not runs:
        column = "torque_in_nm" if converts(trace, method) else "torque_out_nm"
        runs = found_runs(trace.channel(column, "the turning points"))
        text = "branches: turning points found on the curve, no segments in the trace"
    return runs, StageRecord("turning points", text, {"runs": Figure(len(runs), "1")})


def _virgin_quarter(runs: Sequence[Run]) -> StageRecord:
    """Say which runs are not evaluated: their role keeps them out of the branches and of the torque ratio."""
    dropped = [run for run in runs if run.role not in EVALUATED]
    roles = Counter(run.role for run in dropped)
    text = f"not evaluated: {', '.join(roles)}" if dropped else "every ramp is evaluated"
    figures = {f"{role} runs": Figure(count, "1") for role, count in roles.items()}
    samples = sum(piece.stop - piece.start for run in dropped for piece in run.pieces)
    return StageRecord("virgin quarter", text, figures | {"samples": Figure(samples, "1")}, applied=bool(dropped))


def _torque_ratio(trace: Trace, method: Method, runs: Sequence[Run]) -> tuple[Quadrants | AnalysisError, list[str]]:
    """Return the torque ratio as given or as measured, or the reason why there is none; and what was found."""
    if method.quadrants is not None:
        return method.quadrants, ["torque ratio: as given"]
    calibrated = converts(trace, method) or any(run.role == "calibrate" for run in runs)
    try:
        quadrants = fit_quadrants(trace, runs) if calibrated else quadrants_of_cycles(trace, runs)
    except AnalysisError as error:
        return error, []
    which = "torque ratio" if calibrated else "torque ratio of the measured cycles"
    return quadrants, [
        f"{which}, {name}: T_out = {fit.offset_nm:.4g} + {fit.slope:.5g} T_in (N·m), s = "
        f"{fit.residual_sd_nm:.2g} N·m over {fit.points} points, {fit.flagged.size} flagged{_begin(quadrants, name)}"
        for name, fit in quadrants.fits.items()
    ]


def _begin(quadrants: Quadrants, name: str) -> str:
    """Say from where a line was fitted that begins later for a bounce; '' of another."""
    begin_nm = quadrants.begins_nm.get(name)
    return "" if begin_nm is None else f", {begin_text(name, begin_nm)}"


def _branch_samples(
    trace: Trace, method: Method, runs: Sequence[Run], windup: FloatArray, quadrants: Quadrants | AnalysisError
) -> list[tuple[BranchSamples, BranchSamples]]:
    """Return (rising, falling) samples of each cycle, with the torque at the output.

    Raises AnalysisError when there is no cycle, the torque is missing, or the ratio that converts it is.
    """
    pairs = []
    for cycle, (rising, falling) in enumerate(paired_cycles(runs), start=1):
        taken = []
        for run in (rising, falling):
            torque, masked, turn_nm = _branch_torque(trace, method, run, quadrants)
            side = "rising" if run.direction > 0 else "falling"
            where = f"{trace.source}: cycle {cycle}, {side} branch (from row {run.first_row})"
            time = None if trace.t_s is None else run.take(trace.t_s)
            one = BranchSamples(run, cycle, torque, run.take(windup), time, where)
            taken.append(one.without(masked, turn_nm))
        pairs.append((taken[0], taken[1]))
    return pairs


def _output_torque_record(
    trace: Trace,
    method: Method,
    pairs: Sequence[tuple[BranchSamples, BranchSamples]],
    quadrants: Quadrants | AnalysisError,
    found: Sequence[str],
) -> StageRecord:
    """Say where the torque at the output comes from."""
    if not converts(trace, method):
        given = "output torque: as measured at the output"
        if method.output_torque == "calibrated":
            given = "output torque: torque_out_nm as given; there is no input torque in the trace to convert"
        return StageRecord("output torque", "; ".join([given, *found]), _ratio_figures(quadrants))
    masked = sum(samples.masked for pair in pairs for samples in pair)
    if isinstance(quadrants, Quadrants) and quadrants.transition_rad is not None and not masked:
        transition = (
            "transition after each reversal: from loading to unloading line over "
            f"{quadrants.transition_rad:.3g} rad at the input; back at {quadrants.zero_nm:+.2f} N·m"
        )
    else:
        transition = f"transition after each reversal: masked, {masked} samples"
    text = "; ".join(["output torque: from the input torque by the torque ratio", *found, transition])
    figures = _ratio_figures(quadrants) | {"masked samples": Figure(masked, "1")}
    return StageRecord("output torque", text, figures, applied=True)


def _ratio_figures(quadrants: Quadrants | AnalysisError) -> dict[str, Figure]:
    if isinstance(quadrants, AnalysisError):
        return {}
    figures = {}
    for name in ("load_positive", "unload_positive", "load_negative", "unload_negative"):
        line = getattr(quadrants, name)
        figures[f"{name} slope"] = Figure(line.slope, "1")
        figures[f"{name} offset"] = Figure(line.offset_nm, "N·m")
        if name in quadrants.fits:
            figures[f"{name} residual"] = Figure(quadrants.fits[name].residual_sd_nm, "N·m")
    if quadrants.transition_rad is not None:
        figures["transition"] = Figure(quadrants.transition_rad, "rad")
        figures["reading at zero torque"] = Figure(quadrants.zero_nm, "N·m")
    return figures


def _branch_torque(
    trace: Trace, method: Method, run: Run, quadrants: Quadrants | AnalysisError
) -> tuple[FloatArray, int, FloatArray]:
    """Output torque of a run; how many of its first samples do not count, and their torque by the line before."""
    if not converts(trace, method):
        return run.take(trace.channel("torque_out_nm", "the torque at the output")), 0, np.empty(0)
    torque_in = run.take(trace.channel("torque_in_nm", "the output torque by calibration"))
    if isinstance(quadrants, AnalysisError):
        raise quadrants
    angle = None if trace.angle_in_rad is None else run.take(trace.angle_in_rad)
    torque, valid = output_torque(quadrants, torque_in, run.direction, angle)
    masked = int(np.count_nonzero(~valid))
    before, _ = turn_lines(quadrants, run.direction)
    return torque, masked, before.offset_nm + before.slope * torque_in[:masked]
