"""Stage: channels of different delay are put on a common clock.

A torque that lags behind the angle makes the loop wider or narrower by 2·ω_out·(τ_angle − τ_torque), whatever the unit
does. Where all channels lag alike nothing is moved. Source: "inverse loading test system", error of backlash by lag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.loop.loop import Loop
from analysis.loop.method import Method
from analysis.loop.samples import BranchSamples, converts
from analysis.loop.stages import Figure, StageRecord
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace
from analysis.trace.units import FloatArray
from definitions.method import DIFFERENT_SPEED

ALIGNED = ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
"""Channels that are put on a common clock."""

SAME_LAG_S = 1e-9
"""Lags that differ by less are the same."""

WIDTH_BAND = 0.03
"""Share of the reference torque at which the width of the loop is read for it."""

SPEED_BAND = 0.015
"""Share of the reference torque about it in which the speed is read."""

LEAST_SAMPLES = 3
"""Samples that a speed is read from."""

SETTLED_S = 1e-5
"""Change of an estimated skew at which it is taken as found: less than a tenth of any scan period."""

SETTLED_SHARE = 0.25
"""The same as a share of the estimate's standard error."""

MOST_ROUNDS = 4
"""Rounds in which an estimate is refined."""


@dataclass(frozen=True)
class Skew:
    """Delay of the angle behind the torque, τ_angle − τ_torque [s]; None when it is not known.

    corrected_s was taken out of the trace, left_s is still in it. u_s: standard uncertainty of one that was
    estimated, its standard error or what another round would change; None for one that was declared.
    """

    corrected_s: float | None
    left_s: float | None
    record: StageRecord
    u_s: float | None = None


@dataclass(frozen=True)
class SpeedSkew:
    """Skew [s] from widths at several speeds, its standard error (None from two speeds), width at standstill."""

    skew_s: float
    standard_error_s: float | None
    width_arcmin: float

    @property
    def settled(self) -> bool:
        """Say whether nothing is left of a skew beside what is known of it."""
        return abs(self.skew_s) < max(SETTLED_S, SETTLED_SHARE * (self.standard_error_s or 0.0))


def skew_from_speeds(speeds_arcmin_s: Sequence[float], widths_arcmin: Sequence[float]) -> SpeedSkew:
    """Estimate τ_angle − τ_torque from the loop's width at two speeds or more: ΔB = 2·ω_out·(τ_angle − τ_torque).

    speeds: of the wind-up at the output, arcmin/s; widths: arcmin. What friction gains with speed counts as skew too.
    Raises AnalysisError when the fastest is not at least 1.2 times the slowest.
    """
    x, y = np.asarray(speeds_arcmin_s, dtype=np.float64), np.asarray(widths_arcmin, dtype=np.float64)
    if (
        x.size < 2
        or not (np.isfinite(x).all() and np.isfinite(y).all())
        or not x.max() >= DIFFERENT_SPEED * x.min() > 0
    ):
        raise AnalysisError(
            f"delay from two speeds: found cycles at {', '.join(f'{one:.3g}' for one in x)} arcmin/s; expected two "
            f"speeds that differ by {DIFFERENT_SPEED:g} times or more. Add cycles at another speed"
        )
    centred = x - x.mean()
    spread = float(np.square(centred).sum())
    slope = float((centred * y).sum()) / spread
    rest = y - y.mean() - slope * centred
    error = math.sqrt(float(np.square(rest).sum()) / (x.size - 2) / spread) / 2.0 if x.size > 2 else None
    return SpeedSkew(slope / 2.0, error, float(y.mean() - slope * x.mean()))


def skew_of_cycles(loops: Sequence[Loop], pairs: Sequence[tuple[BranchSamples, BranchSamples]]) -> SpeedSkew:
    """Estimate the skew from cycles that were run at different speed; a staircase has none and does not count."""
    widths, speeds = [], []
    for loop, pair in zip(loops, pairs, strict=True):
        if any(len(one.run.pieces) > 1 for one in pair):
            continue
        torque = WIDTH_BAND * loop.reference_nm
        sides = [loop.falling_at(side * torque) - loop.rising_at(side * torque) for side in (-1, 1)]
        widths.append(sum(sides) / 2.0)
        speeds.append(float(np.mean([windup_speed(one, loop.reference_nm) for one in pair])))
    return skew_from_speeds(speeds, widths)


def windup_speed(samples: BranchSamples, reference_nm: float) -> float:
    """Speed of the wind-up where the width of the loop is read, arcmin/s; NaN without time.

    A ramp of constant torque rate turns the unit faster about zero torque, where it is softer. A trace with few samples
    there has the speed of its middle third.
    """
    if samples.t_s is None:
        return math.nan
    speeds = []
    for side in (-1, 1):
        near = np.abs(samples.torque_nm - side * WIDTH_BAND * reference_nm) <= SPEED_BAND * reference_nm
        speeds.append(_slope(samples.t_s[near], samples.windup_arcmin[near]))
    if not np.isfinite(speeds).all():
        third = samples.torque_nm.size // 3
        return _slope(samples.t_s[third : 2 * third + 1], samples.windup_arcmin[third : 2 * third + 1])
    return float(np.mean(speeds))


def _slope(time_s: FloatArray, angle_arcmin: FloatArray) -> float:
    """Amount of the slope of a straight line through samples; NaN for too few."""
    if time_s.size < LEAST_SAMPLES or not time_s[-1] > time_s[0]:
        return math.nan
    centred = time_s - time_s.mean()
    return abs(float((centred * angle_arcmin).sum()) / float(np.square(centred).sum()))


def align(trace: Trace, method: Method, estimated: SpeedSkew | None = None) -> tuple[Trace, Skew]:
    """Return the trace with every channel moved forward to the delay of the fastest one, and what was done.

    estimated: skew to be taken instead of the method's lags. To a lag comes the age of each value by the trace itself
    (`Trace.delays_s`); an estimate holds both. Equal lags move nothing. A lag of the first order is, on a ramp, a delay
    by its time constant: next to a turning point the correction is too large for as long as it lasts.
    """
    torque = "torque_in_nm" if converts(trace, method) else "torque_out_nm"
    there = [name for name in ALIGNED if getattr(trace, name) is not None]
    lags, how = _lags(there, method, estimated)
    if lags is None:
        return trace, Skew(None, None, StageRecord("time alignment", how))
    ages = {} if estimated is not None else {name: trace.delays_s[name] for name in there if name in trace.delays_s}
    behind = {name: lags[name] + ages.get(name, 0.0) for name in there}
    lags = {name: float(np.median(values)) for name, values in behind.items()}
    skew = max((lags[name] for name in there if name.startswith("angle")), default=0.0) - lags.get(torque, 0.0)
    figures = {f"lag of {name}": Figure(lags[name], "s") for name in there} | {"angle behind torque": Figure(skew, "s")}
    if estimated is not None:
        figures["standard error"] = Figure(estimated.standard_error_s, "s")
        figures["width at standstill"] = Figure(estimated.width_arcmin, "arcmin")
    first = min(lags.values(), default=0.0)
    late = {name: lags[name] - first for name in there if np.max(np.abs(behind[name] - first)) > SAME_LAG_S}
    if not late:
        text = f"time alignment: {how}; all channels have the same lag, no correction needed"
        return trace, Skew(0.0, 0.0, StageRecord("time alignment", text, figures))
    words = ", ".join(f"{name} by {lag * 1e3:.3g} ms" for name, lag in late.items())
    if method.alignment == "report" or trace.t_s is None:
        why = "the trace has no time" if trace.t_s is None else "the method only reports it"
        text = f"time alignment: {how}; {words} late, not moved: {why}"
        return trace, Skew(0.0, skew, StageRecord("time alignment", text, figures))
    time = trace.t_s
    moved = {name: np.interp(time - first, time - behind[name], getattr(trace, name)) for name in late}
    text = f"time alignment: {how}; moved back: {words}"
    return replace(trace, **moved), Skew(skew, 0.0, StageRecord("time alignment", text, figures, applied=True))


def _lags(there: Sequence[str], method: Method, estimated: SpeedSkew | None) -> tuple[dict[str, float] | None, str]:
    """Lag of each channel [s], None when they are not known, and where they come from."""
    if estimated is not None:
        behind = estimated.skew_s
        return {name: max(behind if "angle" in name else -behind, 0.0) for name in there}, "skew estimated from speeds"
    if method.lags_s is None:
        return None, "time alignment: the lags of the channels are not known"
    missing = [name for name in there if name not in method.lags_s]
    if missing:
        return None, f"time alignment: the lag of {', '.join(missing)} is not known"
    return {name: method.lags_s[name] for name in there}, "lags of the sensors as given"
