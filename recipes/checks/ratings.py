"""Torques and speeds of a recipe against what unit, sensors, brake and drive can bear, and against its own limits."""

from __future__ import annotations

from collections.abc import Iterator

from definitions.units import ANGLE, ARCMIN_PER_RAD, DURATION, FRACTION, SPEED, TORQUE, TRAVEL
from recipes.checks.expectations import (
    Finding,
    input_torque_nm,
    loaded_steps,
    loaded_torque_nm,
    locked_torque_nm,
    output_torque_nm,
    windup_rad,
)
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.schema.sensor_schema import TorqueSensor
from recipes.schema.sequence_schema import Home, Lock, Release, SpeedCycles, StepCycles
from recipes.text.quantity import show

HIGHEST_PEAK = 2.0
"""Of rated torque; the static test goes this far."""
LOCK_MARGIN = 1.1
"""Holding torque over the torque that the lock has to bear."""
TIME_MARGIN = 1.2
"""Time limit of a speed ramp over the expected time: play and friction add to the wind-up."""
LARGEST_TARE = 0.1
"""Zero offset, of a sensor's full scale."""
LARGEST_RELEASE = 0.1
"""Torque at which the lock may open, of rated torque."""
SMALLEST_LEVEL = 0.005
"""Step of a staircase, of rated torque: what a torque ramp settles to."""
LONGEST_RAMP_S = 1800.0
ROUNDING = 1.0 + 1e-9


def check_unit_rating(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    """Peaks up to twice the rated torque of the unit."""
    rated_nm = recipe.unit_under_test.rated_torque_nm
    for option, step in loaded_steps(recipe):
        if step.peak_torque_nm > HIGHEST_PEAK * rated_nm * ROUNDING:
            found = f"{show(step.peak_torque_nm, TORQUE)}, {step.peak_torque_nm / rated_nm:.0%} of the rated torque"
            allowed = f"up to 200 % of the rated torque, {show(HIGHEST_PEAK * rated_nm, TORQUE)}"
            yield Finding((*option, "peak_torque"), found, allowed, "Lower the peak: the unit would be damaged.")


def check_output_sensor(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Peaks inside the output sensor's full scale; its alarm and trip where it can still show them."""
    sensor = bench.sensors.torque_out
    if sensor is None:
        return
    for option, step in loaded_steps(recipe):
        if step.peak_torque_nm > sensor.full_scale_nm * ROUNDING:
            found = f"{show(step.peak_torque_nm, TORQUE)} at the output"
            allowed = f"up to {show(sensor.full_scale_nm, TORQUE)}, full scale of the output torque sensor"
            yield Finding((*option, "peak_torque"), found, allowed, "Lower the peak or fit a larger sensor.")
    limits = recipe.interlocks
    yield from _visible("torque_out_alarm", limits.torque_out_alarm_nm, sensor)
    yield from _visible("torque_out_trip", limits.torque_out_trip_nm, sensor)


def check_input_sensor(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Peaks whose input torque is inside the input sensor's full scale; a trip that it can still show."""
    sensor = bench.sensors.torque_in
    if sensor is None:
        return
    for option, step in loaded_steps(recipe):
        needed_nm = input_torque_nm(recipe, step.peak_torque_nm)
        if needed_nm > sensor.full_scale_nm * ROUNDING:
            most_nm = output_torque_nm(recipe, sensor.full_scale_nm)
            found = f"{show(step.peak_torque_nm, TORQUE)}, which is {show(needed_nm, TORQUE, 4)} at the input"
            allowed = f"up to {show(most_nm, TORQUE, 4)}: the input torque sensor ends at "
            hint = "Lower the peak or fit a larger sensor."
            yield Finding((*option, "peak_torque"), found, allowed + show(sensor.full_scale_nm, TORQUE), hint)
    yield from _visible("torque_in_trip", recipe.interlocks.torque_in_trip_nm, sensor)


def _visible(name: str, limit_nm: float, sensor: TorqueSensor) -> Iterator[Finding]:
    if limit_nm > sensor.usable_nm * ROUNDING:
        found = f"{show(limit_nm, TORQUE)}, which the sensor cannot show"
        allowed = f"up to {show(sensor.usable_nm, TORQUE)}, where the sensor saturates"
        yield Finding(("interlocks", name), found, allowed, "Lower the limit: it would never act.")


def check_tares(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Zero offsets that are accepted: a small part of each sensor's full scale."""
    for index, step in enumerate(recipe.sequence):
        if not isinstance(step, Home):
            continue
        for name, accepted_nm, sensor in (
            ("torque_in_tare", step.torque_in_tare_nm, bench.sensors.torque_in),
            ("torque_out_tare", step.torque_out_tare_nm, bench.sensors.torque_out),
        ):
            if sensor is not None and accepted_nm > LARGEST_TARE * sensor.full_scale_nm * ROUNDING:
                most = show(LARGEST_TARE * sensor.full_scale_nm, TORQUE)
                found = f"a zero offset of {show(accepted_nm, TORQUE)}"
                allowed = f"up to {most}, {LARGEST_TARE:.0%} of the sensor's full scale"
                hint = "Lower it: a larger offset is a damaged or loaded sensor."
                yield Finding(("sequence", index, "home", name), found, allowed, hint)


def check_brake(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """A holding torque that the brake can give and that bears every peak; a proof below it."""
    most_nm = bench.lock_brake.max_torque_nm
    borne_nm = max((locked_torque_nm(recipe, step.peak_torque_nm) for _, step in loaded_steps(recipe)), default=0.0)
    stiffness = bench.fixture.output_side_nm_per_arcmin
    for index, step in enumerate(recipe.sequence):
        if not isinstance(step, Lock):
            continue
        option = ("sequence", index, "lock")
        holding_nm, proof_nm = step.holding_torque_nm, locked_torque_nm(recipe, step.proof_torque_nm)
        if holding_nm > most_nm * ROUNDING:
            found = f"{show(holding_nm, TORQUE)} to hold"
            allowed = f"up to {show(most_nm, TORQUE)}, the brake's torque at {bench.lock_brake.max_current_a:g} A"
            yield Finding((*option, "holding_torque"), found, allowed, "Lower it or fit a larger brake.")
        if holding_nm < LOCK_MARGIN * borne_nm / ROUNDING:
            found = f"{show(holding_nm, TORQUE)} for a lock that has to bear {show(borne_nm, TORQUE, 4)}"
            allowed = f"at least {show(LOCK_MARGIN * borne_nm, TORQUE, 4)}, {LOCK_MARGIN:g} times that"
            yield Finding((*option, "holding_torque"), found, allowed, "Hold more, or lower the highest peak.")
        if proof_nm >= holding_nm:
            found = f"{show(step.proof_torque_nm, TORQUE)}, {show(proof_nm, TORQUE, 4)} at the lock"
            allowed = f"below holding_torque, {show(holding_nm, TORQUE)}"
            yield Finding((*option, "proof_torque"), found, allowed, "A proof is a small torque, about 10 %.")
        given_rad = borne_nm / stiffness / ARCMIN_PER_RAD
        if recipe.loading == "input" and given_rad >= recipe.interlocks.lock_slip_rad:
            found = f"{show(recipe.interlocks.lock_slip_rad, ANGLE)}, less than the fixture deflects at the peak torque"
            allowed = f"above {show(given_rad, ANGLE, 3)}"
            yield Finding(("interlocks", "lock_slip"), found, allowed, "Raise it: every run would trip.")


def check_drive(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Peaks that the servo can bring to the loaded shaft, and ramps at speeds that it can turn."""
    most_nm = bench.max_loading_torque_nm
    for option, step in loaded_steps(recipe):
        needed_nm = loaded_torque_nm(recipe, step.peak_torque_nm)
        if needed_nm > most_nm * ROUNDING:
            found = f"{show(step.peak_torque_nm, TORQUE)}, which takes {show(needed_nm, TORQUE, 4)} of the drive"
            allowed = f"up to {show(most_nm, TORQUE)} at the {recipe.loading} shaft, the drive's max_torque"
            yield Finding((*option, "peak_torque"), found, allowed, "Lower the peak or fit a larger drive.")
        if isinstance(step, SpeedCycles) and step.speed_rad_s > bench.drive.max_speed_rad_s * ROUNDING:
            allowed = f"up to {show(bench.drive.max_speed_rad_s, SPEED)}, the drive's max_speed"
            yield Finding((*option, "speed"), f"{show(step.speed_rad_s, SPEED)} of the motor", allowed, "Lower it.")


def check_limits_before_peak(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    """Every peak is reached before an alarm, a trip or the end of travel stops the ramp."""
    limits = recipe.interlocks
    for option, step in loaded_steps(recipe):
        peak_nm = step.peak_torque_nm
        never = f"{show(peak_nm, TORQUE)}, which is never reached"
        for name, limit_nm in (("alarm", limits.torque_out_alarm_nm), ("trip", limits.torque_out_trip_nm)):
            if peak_nm >= limit_nm:
                allowed = f"below torque_out_{name}, {show(limit_nm, TORQUE)}"
                yield Finding((*option, "peak_torque"), never, allowed, f"Lower the peak or raise the {name}.")
                break
        needed_nm = input_torque_nm(recipe, peak_nm)
        if needed_nm >= limits.torque_in_trip_nm:
            found = f"{never}: its {show(needed_nm, TORQUE, 4)} at the input trip first"
            allowed = f"below {show(limits.torque_in_trip_nm, TORQUE)} at the input, torque_in_trip"
            yield Finding((*option, "peak_torque"), found, allowed, "Lower the peak or raise the trip.")
        turned_rad = windup_rad(recipe, peak_nm)
        if turned_rad >= limits.travel_rad:
            found = f"{never}: the {recipe.loading} shaft turns {show(turned_rad, TRAVEL, 3)} up to there"
            allowed = f"below {show(limits.travel_rad, TRAVEL)}, interlocks.travel"
            yield Finding((*option, "peak_torque"), found, allowed, "Raise the travel or lower the peak.")


def check_torque_ramps(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Ramps by torque rate: neither endless nor faster than the drive, the speed limit or the plausible rate."""
    limits = recipe.interlocks
    slowest_rad_s = min(limits.speed_rad_s, bench.max_loading_speed_rad_s)
    for option, step in loaded_steps(recipe):
        if isinstance(step, SpeedCycles):
            continue
        rate_nm_s = step.torque_rate_nm_s
        ramp_s = 2 * step.peak_torque_nm / rate_nm_s
        if ramp_s > LONGEST_RAMP_S:
            found = f"{rate_nm_s:g} N·m/s, at which a ramp takes {show(ramp_s, DURATION, 3)}"
            allowed = f"at least {2 * step.peak_torque_nm / LONGEST_RAMP_S:.3g} N·m/s (half an hour)"
            yield Finding((*option, "torque_rate"), found, allowed, "Raise the rate.")
        if windup_rad(recipe, rate_nm_s) >= slowest_rad_s:
            speed = show(windup_rad(recipe, rate_nm_s), SPEED, 3)
            found = f"{rate_nm_s:g} N·m/s, at which the {recipe.loading} shaft turns at {speed}"
            allowed = f"below {show(slowest_rad_s, SPEED)} at that shaft (interlocks.speed, drive's max_speed)"
            yield Finding((*option, "torque_rate"), found, allowed, "Lower the rate.")
        if limits.torque_rate_nm_s is not None and rate_nm_s >= limits.torque_rate_nm_s:
            allowed = f"below {limits.torque_rate_nm_s:g} N·m/s, interlocks.torque_rate"
            yield Finding((*option, "torque_rate"), f"{rate_nm_s:g} N·m/s", allowed, "Lower the rate.")


def check_speed_ramps(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Ramps at constant speed reach their torque inside their time limit and below the overspeed limit."""
    limits, gear_ratio = recipe.interlocks, bench.drive.gear_ratio
    for option, step in loaded_steps(recipe):
        if not isinstance(step, SpeedCycles):
            continue
        loaded_rad_s = step.speed_rad_s / gear_ratio
        expected_s = windup_rad(recipe, 2 * step.peak_torque_nm) / loaded_rad_s
        expected_s += step.speed_rad_s / step.acceleration_rad_s2
        if step.time_limit_s < TIME_MARGIN * expected_s:
            found = f"{show(step.time_limit_s, DURATION)} for a ramp that takes about {show(expected_s, DURATION, 3)}"
            allowed = f"at least {show(TIME_MARGIN * expected_s, DURATION, 3)} for the stiffness of this unit"
            yield Finding((*option, "time_limit"), found, allowed, "Raise the time limit or the speed.")
        if loaded_rad_s >= limits.speed_rad_s:
            found = f"{show(step.speed_rad_s, SPEED)} of the motor, {show(loaded_rad_s, SPEED, 3)} of the loaded shaft"
            allowed = f"below {show(limits.speed_rad_s, SPEED)} of the loaded shaft, interlocks.speed"
            yield Finding((*option, "speed"), found, allowed, "Lower the speed or raise the interlock.")


def check_step_size(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    """Steps of a staircase that are larger than what a ramp settles to."""
    smallest_nm = SMALLEST_LEVEL * recipe.unit_under_test.rated_torque_nm
    for option, step in loaded_steps(recipe):
        if isinstance(step, StepCycles) and step.peak_torque_nm / step.steps < smallest_nm:
            found = f"{step.steps} steps of {show(step.peak_torque_nm / step.steps, TORQUE, 3)}"
            allowed = f"up to {int(step.peak_torque_nm / smallest_nm)} steps"
            yield Finding((*option, "steps"), found, allowed, "Fewer steps: these are too small to tell apart.")


def check_release(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """The lock opens near zero torque, at a limit that the sensor can still tell from zero."""
    rated_nm = recipe.unit_under_test.rated_torque_nm
    sensor = bench.sensors.torque_out
    for index, step in enumerate(recipe.sequence):
        if not isinstance(step, Release):
            continue
        option = ("sequence", index, "release", "max_torque")
        if step.max_torque_nm > LARGEST_RELEASE * rated_nm * ROUNDING:
            allowed = f"up to {LARGEST_RELEASE:.0%} of the rated torque, {show(LARGEST_RELEASE * rated_nm, TORQUE)}"
            found = f"{show(step.max_torque_nm, TORQUE)} when the lock opens"
            yield Finding(option, found, allowed, "Lower it: a wound-up reducer would spring back.")
        if sensor is not None and step.max_torque_nm < sensor.accuracy_fraction * sensor.full_scale_nm:
            least = show(sensor.accuracy_fraction * sensor.full_scale_nm, TORQUE)
            found = f"{show(step.max_torque_nm, TORQUE)}, which the sensor cannot tell from zero"
            allowed = f"at least {least}, {show(sensor.accuracy_fraction, FRACTION)} of the sensor's full scale"
            yield Finding(option, found, allowed, "Raise it: the lock would never open.")
