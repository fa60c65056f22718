"""Torque sweeps: what the drive can follow, what moves the unit at all, and what a response can be read from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import cos, pi, sin

from definitions.units import DURATION, FREQUENCY, TORQUE
from recipes.checks.expectations import Finding, windup_rad
from recipes.compiler.budgets import budget
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.schema.sequence_schema import TorqueSweep
from recipes.text.quantity import show

LEAST_CYCLES = 4.0
"""Cycles of the lowest frequency in a period: the line beside it is then far enough away."""

LEAST_LINES = 4.0
"""Lines of the response that the band holds; whole cycles in a period may take two of them."""

SLEW_SHARE = 0.8
"""Of the drive's slew that a planned sweep may take: the rest is for the control."""

FOLLOWED = 0.9
"""Share of the planned amplitude that the torque has to reach: a reducer's stiffness depends on the amplitude."""

CYCLE_STEPS, PLAYED_CYCLES = 200, 4
"""Steps of a cycle that is played through, and cycles until it repeats."""

ROUNDING = 1.0 + 1e-9


def check_sweep(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Frequencies in order, a torque on one side of zero, and a drive that can follow through the unit's friction."""
    sweeps = [(index, step) for index, step in enumerate(recipe.sequence) if isinstance(step, TorqueSweep)]
    for index, _ in sweeps[1:]:
        hint = "Delete it, and measure it with a separate recipe."
        yield Finding(("sequence", index, "torque_sweep"), "a second sweep", "one in a recipe", hint)
    for index, step in sweeps:
        option = ("sequence", index, step.kind)
        for name, found, allowed, hint in (*_shape(recipe, bench, step), *_speed(recipe, bench, step)):
            yield Finding((*option, name), found, allowed, hint)


Row = tuple[str, str, str, str]


def _shape(recipe: Recipe, bench: Bench, step: TorqueSweep) -> Iterator[Row]:
    if step.to_frequency_hz <= step.from_frequency_hz:
        found = f"{show(step.to_frequency_hz, FREQUENCY)}, not above from_frequency"
        yield "to_frequency", found, f"above {show(step.from_frequency_hz, FREQUENCY)}", "Exchange the two."
    elif (step.to_frequency_hz - step.from_frequency_hz) * step.period_s < LEAST_LINES / ROUNDING:
        least_hz = step.from_frequency_hz + LEAST_LINES / step.period_s
        found = f"{show(step.to_frequency_hz, FREQUENCY)}, too near to from_frequency for a period of this length"
        yield "to_frequency", found, f"at least {show(least_hz, FREQUENCY, 4)}", "Raise it, or take a longer period."
    shortest_s = LEAST_CYCLES / step.from_frequency_hz
    if step.period_s < shortest_s / ROUNDING:
        found = (
            f"{show(step.period_s, DURATION)}, {step.period_s * step.from_frequency_hz:.3g} cycles of from_frequency"
        )
        allowed = f"at least {show(shortest_s, DURATION, 3)}, {LEAST_CYCLES:g} of its cycles"
        yield "period", found, allowed, "Take a longer period, or a higher from_frequency."
    if step.amplitude_nm > step.peak_torque_nm / 2.0 * ROUNDING:
        found = f"{show(step.amplitude_nm, TORQUE)}, with which the torque goes below zero"
        allowed = f"up to half of peak_torque, {show(step.peak_torque_nm / 2.0, TORQUE, 4)}"
        yield "amplitude", found, allowed, "Take a smaller amplitude: through zero it is the backlash that is measured."
    if recipe.measurement.output_torque == "calibrated" or bench.sensors.torque_out is None:
        found = "a sweep, while the output torque is converted from the input torque"
        hint = "Delete the sweep: friction reverses in every cycle, so the conversion is not valid."
        yield "amplitude", found, "a sweep where the output torque is measured", hint


def reached_nm(  # noqa: PLR0917 - what the loop and the unit are
    step: TorqueSweep, frequency_hz: float, friction_nm: float, efficiency: float, slew_nm_s: float, gain_per_s: float
) -> float:
    """Amplitude of the output torque [N·m] that the torque loop reaches at a frequency, of the one that is planned.

    A cycle is played through step by step, as it is once it repeats. friction_nm: of the input side, as output torque;
    efficiency: of the loading line, 0…1. Loading, T_out = d − C, and unloading, T_out = d/η² + C, with d the drive's
    torque in terms of the loading line: between the two the output torque stands, and the loop has to catch up.
    """
    mean_nm, amplitude_nm = step.peak_torque_nm - step.amplitude_nm, step.amplitude_nm
    step_s = 1.0 / (frequency_hz * CYCLE_STEPS)
    torque_nm, drive_nm = mean_nm, mean_nm + friction_nm
    found: list[float] = []
    for place in range(PLAYED_CYCLES * CYCLE_STEPS):
        phase = 2.0 * pi * place / CYCLE_STEPS
        error_nm = mean_nm + amplitude_nm * sin(phase) - torque_nm
        rate_nm_s = 2.0 * pi * frequency_hz * amplitude_nm * cos(phase) + gain_per_s * error_nm
        drive_nm += min(slew_nm_s, max(-slew_nm_s, rate_nm_s)) * step_s
        torque_nm = min(drive_nm / efficiency**2 + friction_nm, max(drive_nm - friction_nm, torque_nm))
        found.append(torque_nm)
    last = found[-CYCLE_STEPS:]
    return (max(last) - min(last)) / 2.0


def _speed(recipe: Recipe, bench: Bench, step: TorqueSweep) -> Iterator[Row]:
    """What the drive has to do: the sine itself, and the way through the friction at each of its turns."""
    unit, limits = recipe.unit_under_test, recipe.interlocks
    at_input = recipe.loading == "input"
    slope = unit.loading_torque_ratio.slope if at_input else 1.0
    friction_nm = abs(unit.loading_torque_ratio.offset_nm) if at_input else 0.0
    efficiency = min(1.0, slope / unit.ratio) if at_input else 1.0
    gain_per_s = bench.torque_control.gain_per_s
    slew_nm_s = budget("slew_of_peak_per_s") * bench.max_loading_torque_nm * slope

    def follows(frequency_hz: float) -> bool:
        return (
            2.0 * pi * frequency_hz * step.amplitude_nm <= SLEW_SHARE * slew_nm_s * ROUNDING
            and reached_nm(step, frequency_hz, friction_nm, efficiency, slew_nm_s, gain_per_s)
            >= FOLLOWED * step.amplitude_nm
        )

    if step.amplitude_nm > friction_nm and not follows(step.to_frequency_hz):
        found = f"{show(step.to_frequency_hz, FREQUENCY)} with an amplitude of {show(step.amplitude_nm, TORQUE)}"
        allowed = f"up to {show(_highest_hz(follows, step.to_frequency_hz), FREQUENCY, 3)}"
        allowed += f": the drive changes the output torque by {slew_nm_s:.3g} N·m/s"
        if friction_nm:
            allowed += f", and the friction of {show(friction_nm, TORQUE, 3)} turns twice in a cycle"
        yield "to_frequency", found, allowed, "Lower the frequency or the amplitude."
    if step.amplitude_nm <= friction_nm:
        found = f"{show(step.amplitude_nm, TORQUE)}, which is below the friction of the input side"
        allowed = f"above {show(friction_nm, TORQUE, 3)}, offset of loading_torque_ratio"
        yield "amplitude", found, allowed, "Raise it: the unit would hardly move."
    rate_nm_s = 2.0 * pi * step.to_frequency_hz * step.amplitude_nm
    slowest_rad_s = min(limits.speed_rad_s, bench.max_loading_speed_rad_s)
    if windup_rad(recipe, rate_nm_s) >= slowest_rad_s:
        found = f"{show(step.to_frequency_hz, FREQUENCY)}, at which the {recipe.loading} shaft is faster than allowed"
        yield "to_frequency", found, "a speed below interlocks.speed and the drive's max_speed", "Lower it."
    if limits.torque_rate_nm_s is not None and rate_nm_s >= limits.torque_rate_nm_s:
        found = f"{show(step.to_frequency_hz, FREQUENCY)}, which is {rate_nm_s:.3g} N·m/s"
        yield "to_frequency", found, f"below {limits.torque_rate_nm_s:g} N·m/s, interlocks.torque_rate", "Lower it."


def _highest_hz(follows: Callable[[float], bool], too_high_hz: float) -> float:
    """Return the highest frequency [Hz] at which the torque follows, by bisection below one at which it does not."""
    low_hz, high_hz = 0.0, too_high_hz
    for _ in range(12):
        middle_hz = (low_hz + high_hz) / 2.0
        low_hz, high_hz = (middle_hz, high_hz) if follows(middle_hz) else (low_hz, middle_hz)
    return low_hz
