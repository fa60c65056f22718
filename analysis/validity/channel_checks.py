"""Figures of the validity checks that look at the samples: channels that stand or lag, ramps, torque, temperature.

Each returns a Reading, or the reason in words why the figure does not apply here.

An angle stands while its shaft is loaded when its encoder is saturated, has stopped, or lost its connection.
"""

from __future__ import annotations

import numpy as np

from analysis.loop.alignment import skew_of_cycles, windup_speed
from analysis.loop.branches import Blocks
from analysis.loop.interruptions import of_branch
from analysis.loop.measured import Measured
from analysis.loop.samples import BranchSamples
from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray
from analysis.validity.evidence import MIDDLE, NOT_EVALUATED, Evidence, Figure, Reading, of_measured, of_span, once
from definitions.units import ARCMIN_PER_RAD

EXAMPLE_LAG_S = 0.01
"""Lag whose effect is told where the lag is not known."""

RATE_BLOCKS = 60
"""Stretches of a branch whose rate is compared."""

BIN_FRACTION = 0.02
"""Width of a torque bin, of the reference torque."""


@of_measured
def clipping(found: Measured) -> Reading | str:
    """Share of the wind-up in which the torque stands exactly at its end, or of the torque in which the angle does, %.

    An angle that stands makes a unit stiffer than it is, a torque that stands makes it softer.
    """
    stands = max(angle_stands(found), windup_stands(found))
    shares = []
    for one in _sides(found):
        span = float(np.ptp(one.windup_arcmin))
        for end in (one.torque_nm.max(), one.torque_nm.min()):
            at_end = np.flatnonzero(one.torque_nm == end)
            moved = abs(float(one.windup_arcmin[at_end[-1]] - one.windup_arcmin[at_end[0]]))
            shares.append(moved / span if span > 0 else 0.0)
    words = (
        "the angle of the loaded shaft stands while its torque rises: its encoder is saturated or has stopped, or a "
        "wrong fixture is taken from it"
    )
    return Reading(100.0 * max(*shares, stands), words if stands > max(shares) else "")


@of_measured
def lag(found: Measured) -> Reading | str:
    """Change of the loop's width by the skew of angle and torque, corrected or not, % of the wind-up."""
    skew = found.skew
    if skew.corrected_s is None or skew.left_s is None:
        return _lag_from_speeds(found)
    delay = abs(skew.corrected_s) + abs(skew.left_s)
    if delay == 0.0:
        return Reading(0.0)
    speed = max(windup_speed(one, found.method.reference_nm) for one in _sides(found))
    if not np.isfinite(speed):
        return Reading(np.inf, "the lags of torque and angle differ; without a time column the effect is unknown")
    width = 2.0 * speed * delay
    words = f"{delay * 1e3:.3g} ms of delay between torque and angle change the width of the loop by {width:.3g} arcmin"
    return of_span(found, width, words)


def _lag_from_speeds(found: Measured) -> Reading | str:
    """Figure of the check where nobody has said how late the channels are: two speeds show it, one does not."""
    ramps = [number for number, pair in enumerate(found.pairs) if all(len(one.run.pieces) == 1 for one in pair)]
    loops, pairs = [found.loops[number] for number in ramps], [found.pairs[number] for number in ramps]
    unknown = "not measured: the lags of the channels are not known"
    speeds = [windup_speed(one, found.method.reference_nm) for pair in pairs for one in pair]
    if not speeds or not np.isfinite(speeds).all():
        return f"{unknown}; without a time column their effect is unknown"
    try:
        estimated = skew_of_cycles(loops, pairs)
    except AnalysisError:
        each = 2.0 * max(speeds) * EXAMPLE_LAG_S
        return (
            f"{unknown}, and cycles at one speed cannot show lags: at {max(speeds):.3g} arcmin/s every "
            f"{EXAMPLE_LAG_S * 1e3:g} ms of lag would change the width of the loop by {each:.2g} arcmin"
        )
    width = 2.0 * max(speeds) * abs(estimated.skew_s)
    words = (
        f"the width of the loop changes with the speed, as from a delay of {estimated.skew_s * 1e3:.3g} ms between "
        "torque and angle"
    )
    return of_span(found, width, words)


def late_torque(evidence: Evidence) -> Reading | str:
    """Torque by which a ramp runs on while the torque is late or early, % of the reference torque."""
    found, late = evidence.measured, evidence.late
    if found is None:
        return NOT_EVALUATED
    return late if isinstance(late, str) else Reading(100.0 * late.nm / found.method.reference_nm, late.words)


TIME_UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "minutes": 1.0 / 60.0, "hours": 1.0 / 3600.0}
"""Units that a time may be in by mistake: by how much the figures are larger than in seconds."""

NEAR = 3.0
"""A scale that is off by such a unit within this factor is named after it: nobody keeps a rate exactly."""


@of_measured
def time_scale(found: Measured) -> Reading | str:
    """Torque rate of a branch over that which the recipe plans, or the other way round, the larger one."""
    planned = found.method.planned_nm_s
    if planned is None:
        return "needs cycles with a torque rate in the recipe"
    worst = Reading(1.0)
    for one in _sides(found):
        time = found.recorded.t_s
        if time is None:
            return "needs a trace with a time column"
        seconds = sum(float(time[rows.stop - 1] - time[rows.start]) for rows in one.run.pieces)
        span_nm = float(np.ptp(one.torque_nm))
        if not seconds > 0.0 or not span_nm > 0.0:
            return Reading(np.inf, f"{one.where}: torque or time does not change")
        slower, faster = planned[0] * seconds / span_nm, span_nm / (planned[1] * seconds)
        if max(slower, faster) > worst.figure:
            meant_nm_s = planned[0] if slower > faster else planned[1]
            words = f"the torque ramps at {span_nm / seconds:.3g} N·m/s, and {meant_nm_s:.3g} N·m/s are planned"
            worst = Reading(max(slower, faster), words + _as_if_in(slower if slower > faster else 1.0 / faster))
    return worst


def _as_if_in(scale: float) -> str:
    """Name the unit that the time seems to be in, after a comma; '' for none."""
    near = [name for name, factor in TIME_UNITS.items() if factor / NEAR < scale < factor * NEAR]
    return f", as if the time were in {near[0]}" if near else ""


@of_measured
def ramp_rate(found: Measured) -> Reading | str:
    """How far nine tenths of a branch stay from its median rate, %: of torque or of wind-up, whichever is steadier.

    Next to the turning points friction reverses and no rate is steady: only the middle of the branch counts.
    """
    deviations = []
    for number, (one, some) in enumerate(zip(_sides(found), found.blocks, strict=True)):
        if len(one.run.pieces) > 1:
            continue
        if some.t_s is None:
            return "needs a trace with a time column"
        exclusion = found.loops[number // 2].exclusion_nm[0 if one.run.direction > 0 else 1]
        deviations.append(_unsteadiness(some, some.t_s, exclusion))
    return Reading(100.0 * max(deviations)) if deviations else "loaded in steps"


def _unsteadiness(blocks: Blocks, t_s: FloatArray, exclusion_nm: float) -> float:
    """Deviation of the rate of one ramp from steady, outside the torque in which friction reverses after the turn."""
    size = max(1, t_s.size // RATE_BLOCKS)
    edges = np.arange(0, t_s.size - size + 1, size)
    time, torque, angle = (
        np.add.reduceat(values[: edges[-1] + size], edges) / size
        for values in (t_s, blocks.torque_nm, blocks.angle_arcmin)
    )
    step = np.diff(time)
    if not (step > 0).all():
        return float("inf")
    # Unloading may be faster than loading for the same input torque: each half is compared with itself.
    largest = MIDDLE * min(abs(float(torque[0])), abs(float(torque[-1])))
    middle = (torque[:-1] + torque[1:]) / 2.0
    turned = np.abs(middle - torque[0]) > exclusion_nm
    halves = [turned & (middle < 0) & (middle > -largest), turned & (middle > 0) & (middle < largest)]
    found = [_spread(np.diff(values) / step, halves) for values in (torque, angle)]
    return min(found)


def _spread(rate: FloatArray, halves: list[BoolArray]) -> float:
    """Deviation from the median rate of its half that nine tenths of the stretches stay within; the worse half."""
    worst = 0.0
    for half in halves:
        middle = float(np.median(rate[half])) if half.any() else 0.0
        worst = max(worst, float(np.quantile(np.abs(rate[half] / middle - 1.0), 0.9)) if middle else np.inf)
    return worst


@of_measured
def interrupted(found: Measured) -> Reading | str:
    """Largest share of a branch's torque that is left out as interrupted, %; infinity where its step is not known."""
    worst = Reading(0.0)
    for one, some in zip(_sides(found), found.blocks, strict=True):
        left_out = of_branch(found.interruptions, one.cycle, one.run.direction)
        share = 100.0 * sum(each.high_nm - each.low_nm for each in left_out) / float(np.ptp(some.torque_nm))
        unknown = [each for each in left_out if each.step_arcmin is None]
        if unknown:
            at_nm = unknown[0].middle_nm
            return Reading(
                np.inf,
                f"{one.where}: the ramp was interrupted at {at_nm:.4g} N·m, too near to a turning point to measure "
                "the step",
            )
        if share > worst.figure:
            worst = Reading(share, f"{one.where}: the ramp was interrupted")
    return worst


STEPS_TO = 1e-6
"""Angles that are nearer than this [arcmin at the output] are one: the same number, converted twice."""


@of_measured
@once
def angle_steps(found: Measured) -> Reading | str:
    """Smallest step between two values of an angle, at the output, % of the wind-up of the branch; the coarser one."""
    trace, worst = found.recorded, Reading(0.0)
    angles = {"angle_in_rad": found.method.ratio, "angle_out_rad": 1.0}
    for one in _sides(found):
        whole = float(np.ptp(one.windup_arcmin))
        for name, over in angles.items():
            channel = getattr(trace, name)
            if channel is None:
                continue
            at_output = one.run.take(channel) * (ARCMIN_PER_RAD / over)
            counts = np.round(at_output / STEPS_TO)
            moves = np.abs(np.diff(counts * STEPS_TO))
            moves = moves[moves > 0.0]
            if moves.size and moves.min() * 100.0 <= worst.figure * whole:
                continue  # the smallest step is no larger than that between neighbours: most need no sorting
            values = np.unique(counts) * STEPS_TO
            step = float(np.diff(values).min()) if values.size > 1 else 0.0  # a locked shaft may stand
            if step * 100.0 > worst.figure * whole:
                words = f"{name} moves in steps of {step:.2g} arcmin at the output, of {whole:.3g} wind-up"
                worst = Reading(100.0 * step / whole if whole else 100.0, words)
    return worst


@of_measured
def points_per_bin(found: Measured) -> Reading | str:
    """Fewest samples of a branch in a bin of 2 % of the reference torque."""
    width = BIN_FRACTION * found.method.reference_nm
    fewest = np.inf
    for one in found.blocks:
        low = max(MIDDLE * float(one.torque_nm.min()), -found.method.reference_nm)
        high = min(MIDDLE * float(one.torque_nm.max()), found.method.reference_nm)
        edges = np.arange(np.ceil(low / width), np.floor(high / width) + 0.5) * width
        if edges.size > 1:
            counts, _ = np.histogram(one.torque_nm, edges, weights=one.counts)
            fewest = min(fewest, float(counts.min()))
    return Reading(fewest if np.isfinite(fewest) else 0.0)


@of_measured
def monotone_loading(found: Measured) -> Reading | str:
    """Largest way that the torque went back within a branch, % of the reference torque."""
    back = 0.0
    for one, some in zip(_sides(found), found.blocks, strict=True):
        torque = one.run.direction * some.torque_nm
        back = max(back, float((np.maximum.accumulate(torque) - torque).max()))
    return Reading(100.0 * back / found.method.reference_nm)


def temperature_change(evidence: Evidence) -> Reading | str:
    """Range of the housing temperature, K."""
    values = None if evidence.measured is None else evidence.measured.trace.temperature_c
    return "no temperature was measured" if values is None else Reading(float(np.ptp(values)))


def temperature_low(evidence: Evidence) -> Reading | str:
    """Lowest housing temperature, °C."""
    values = None if evidence.measured is None else evidence.measured.trace.temperature_c
    return "no temperature was measured" if values is None else Reading(float(values.min()))


def temperature_high(evidence: Evidence) -> Reading | str:
    """Highest housing temperature, °C."""
    values = None if evidence.measured is None else evidence.measured.trace.temperature_c
    return "no temperature was measured" if values is None else Reading(float(values.max()))


def _sides(found: Measured) -> list[BranchSamples]:
    return [one for pair in found.pairs for one in pair]


STANDING_COUNTS = 3.0
"""Counts of an encoder, in torque, that its angle may stand."""

WINDOWS = 10
"""Parts of a loading branch whose wind-up is compared."""

LEAST_SHARE = 0.1
"""Wind-up of a part, of the median of all parts: a unit that is ten times stiffer there is no unit."""


def angle_stands(found: Measured) -> float:
    """Largest share of a branch's torque, while loading, in which the loaded shaft's angle does not change at all.

    What `STANDING_COUNTS` counts of an encoder of this resolution take is left out.
    """
    trace = found.trace
    by_input = found.method.loading == "input" and trace.angle_in_rad is not None
    loaded = trace.angle_in_rad if by_input else trace.angle_out_rad
    worst = 0.0
    sides = [one for pair in found.pairs for one in pair]
    for one, some in zip(sides, found.blocks, strict=True):
        if loaded is None or len(one.run.pieces) > 1:
            continue
        loading = one.run.direction * one.torque_nm > 0.0
        torque, angle = one.torque_nm[loading], one.run.take(loaded)[one.masked :][loading]
        if not torque.size:
            continue
        starts = np.concatenate(([0], np.flatnonzero(angle[1:] != angle[:-1]) + 1))
        ends = np.append(starts[1:], angle.size) - 1
        way = float(np.ptp(torque))
        usual = STANDING_COUNTS * way / starts.size if starts.size > 1 else 0.0
        stood = float(np.abs(torque[ends] - torque[starts]).max()) - usual
        worst = max(worst, stood / float(np.ptp(some.torque_nm)))
    return worst


def windup_stands(found: Measured) -> float:
    """Largest share of a branch's torque, while loading, in which the wind-up all but stands or goes back.

    A saturated angle with noise does so, and one of which a wrong fixture takes more than there is.
    """
    worst = 0
    # A loop that gains energy runs the wrong way round: a check of its own says so.
    for loop in (one for one in found.loops if one.energy_nm_arcmin >= 0.0):
        for side, branch in ((1, loop.forward), (-1, loop.backward)):
            peak = float(branch.torque_nm[-1] if side > 0 else -branch.torque_nm[0])
            if not peak > 0.0 or not branch.covers(min(0.0, side * peak), max(0.0, side * peak)):
                continue
            moves = np.diff(loop.loading(side, np.linspace(0.0, peak, WINDOWS + 1)))
            usual = float(np.median(np.abs(moves)))
            worst = max(worst, int(np.count_nonzero(moves <= LEAST_SHARE * usual)))
    return worst / (2.0 * WINDOWS)


FIGURES: dict[str, Figure] = {
    "clipping": clipping,
    "lag": lag,
    "points_per_bin": points_per_bin,
    "angle_steps": angle_steps,
    "late_torque": late_torque,
    "time_scale": time_scale,
    "ramp_rate": ramp_rate,
    "interrupted": interrupted,
    "monotone_loading": monotone_loading,
    "temperature_change": temperature_change,
    "temperature_low": temperature_low,
    "temperature_high": temperature_high,
}
"""Figures of these checks, by their ids."""
