"""What a recipe wants measured against sensors, calibrations and sampling of a bench."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date

from definitions.method import DIFFERENT_SPEED
from definitions.metrics import METRICS
from definitions.units import ANGLE, ARCMIN_PER_RAD, FRACTION, PERIOD, TORQUE
from recipes.checks.expectations import Finding, loaded_steps, windup_rad
from recipes.schema.bench_schema import Bench
from recipes.schema.recipe_schema import Recipe
from recipes.schema.sequence_schema import Calibrate, SpeedCycles, StepCycles, TorqueCycles
from recipes.schema.validity_schema import PERCENT
from recipes.text.problems import OptionPath, one_of
from recipes.text.quantity import show

MEASURED = (TorqueCycles, SpeedCycles, StepCycles)
ROUNDING = 1.0 + 1e-9
LARGEST_DISAGREEMENT = 0.25
"""Of drive and angle sensor, as a share of the wind-up at the highest peak."""
BEYOND_BLANK_TEST = 1.05
"""Torque up to which a fixture's curve may be continued straight, of its end."""

LEAST_CYCLES = 3
"""Cycles of which one more than two says how well the skew is known."""
ALIGNMENT: OptionPath = ("measurement", "alignment")
BY_BENCH = (
    "Lags are measured by cycles at two speeds: add a block of cycles at another speed. Or write 'declared' "
    "to use the lags of the bench file."
)

Ramps = TorqueCycles | SpeedCycles
"""Cycles that run at one speed; a staircase stands still where it is read."""


def check_sensors(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """The sensors that the measurement needs are on the bench."""
    option, sensors, name = ("measurement", "output_torque"), bench.sensors, bench.bench.name
    source = recipe.measurement.output_torque
    if source == "reaction" and sensors.torque_out is None:
        found = f"'reaction', but bench '{name}' has no output torque sensor"
        yield Finding(option, found, "'calibrated', from the input torque", "Calibrate, or fit the sensor.")
    if source == "calibrated" and recipe.loading == "output":
        found = "'calibrated' with the load at the output"
        yield Finding(option, found, "'reaction'", "The torque is measured where it acts.")
    elif source == "calibrated" and sensors.torque_in is None:
        found = f"'calibrated', but bench '{name}' has no input torque sensor"
        yield Finding(option, found, "'reaction'", "Fit the sensor, or measure at the output.")
    if sensors.angle_out is None:
        found = f"'{recipe.loading}', but bench '{name}' has no encoder at the output"
        yield Finding(("loading",), found, "a bench with both encoders", "One measures, the other watches the lock.")


def check_angle_agreement(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """The drive's position watches the angle sensor closely enough: one that stands still shows well below the peak."""
    accepted_rad = bench.drive.angle_agreement_rad
    highest = max(loaded_steps(recipe), key=lambda row: row[1].peak_torque_nm, default=None)
    if highest is None:
        return
    option, step = highest
    turned_rad = windup_rad(recipe, step.peak_torque_nm)
    if accepted_rad > LARGEST_DISAGREEMENT * turned_rad * ROUNDING:
        found = f"{show(step.peak_torque_nm, TORQUE)}, which turns the {recipe.loading} shaft by "
        found += f"{show(turned_rad, ANGLE, 3)}, too little to show that its angle sensor stands still"
        allowed = f"a turn of {1 / LARGEST_DISAGREEMENT:g} times the bench's angle_agreement, "
        hint = "Lower drive.angle_agreement in the bench file; coupling_stiffness there allows for twist."
        yield Finding((*option, "peak_torque"), found, allowed + show(accepted_rad, ANGLE, 3), hint)


def check_calibration(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """A measured torque ratio has its step and both sensors; a stored one has no step."""
    option, wanted = ("measurement", "calibration"), recipe.measurement.calibration
    steps = [index for index, step in enumerate(recipe.sequence) if isinstance(step, Calibrate)]
    if recipe.measurement.output_torque == "calibrated" and wanted == "measured" and not steps:
        hint = "Add '- calibrate: {...}' behind lock, or write 'calibration: stored'."
        yield Finding(option, "'measured' without a step calibrate", "a sequence with calibrate", hint)
    for index in steps:
        place = ("sequence", index, "calibrate")
        if wanted == "stored":
            found = "a step calibrate with 'calibration: stored'"
            yield Finding(place, found, "calibrate with 'calibration: measured'", "Delete the step or change it.")
        if recipe.loading == "output":
            found = "a step calibrate with the load at the output"
            yield Finding(place, found, "calibrate with 'loading: input'", "Delete the step.")
        if bench.sensors.torque_in is None or bench.sensors.torque_out is None:
            found = f"a step calibrate on bench '{bench.bench.name}', which lacks a torque sensor"
            yield Finding(place, found, "a torque sensor at input and output", "Use a stored calibration.")


def check_torque_ratio(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    """The catalogue's loading line and the ratio make an efficiency that the validity checks let pass."""
    if recipe.loading != "input":
        return
    unit, limits = recipe.unit_under_test, recipe.validity.limits()
    efficiency = unit.loading_torque_ratio.slope / unit.ratio
    low, high = limits["efficiency_low"] / PERCENT, limits["efficiency_high"] / PERCENT
    if not low <= efficiency <= high:
        found = (
            f"a slope of {unit.loading_torque_ratio.slope:g} with a ratio of {unit.ratio:g}, which is an efficiency of "
        )
        found += show(efficiency, FRACTION, 3)
        allowed = f"one from {show(low, FRACTION)} to {show(high, FRACTION)} (validity.efficiency_low, efficiency_high)"
        hint = "Compare ratio and slope with the unit's plate and catalogue: no run of this recipe would be judged."
        yield Finding(("unit_under_test", "loading_torque_ratio", "slope"), found, allowed, hint)


def check_stored_calibration(recipe: Recipe, bench: Bench, today: date) -> Iterator[Finding]:
    """A stored torque ratio exists for this model on this bench and is in date."""
    if recipe.measurement.calibration != "stored":
        return
    model, name = recipe.unit_under_test.model, bench.bench.name
    newest = bench.newest_calibration(model)
    option = ("measurement", "calibration")
    hint = "Calibrate on this bench and enter the result in its file, or write 'measured'."
    if newest is None:
        found = f"'stored', but bench '{name}' has no calibration for {model}"
        yield Finding(option, found, "a calibration of this model in the bench file", hint)
        return
    if newest.due < today:
        found = f"'stored', but calibration '{newest.id}' of bench '{name}' was due on {newest.due.isoformat()}"
        yield Finding(option, found, "a calibration in date", hint)
    elif newest.made > today:
        found = f"'stored', but calibration '{newest.id}' is from {newest.made.isoformat()}, a date in the future"
        yield Finding(option, found, "a calibration made today or before", "Correct the date or the clock.")


def of_one_unit(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """A stored torque ratio that is not known to be that of a lot: what other units differ by is not in any U."""
    measurement = recipe.measurement
    newest = bench.newest_calibration(recipe.unit_under_test.model)
    stored = measurement.calibration == "stored" and measurement.output_torque == "calibrated"
    if stored and newest is not None and newest.units is None:
        found = f"'stored', and calibration '{newest.id}' of bench '{bench.bench.name}' has no units"
        allowed = "the mean of several units, for how they differ is how wrong it may be for another one"
        hint = "Enter 'lostmotion calibration RUN RUN ...' of a run of each, unless its own unit alone is measured."
        yield Finding(("measurement", "calibration"), found, allowed, hint)


def without_noise(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Torque sensors that are declared to have no noise: by it samples that were smoothed or copied are told."""
    named = {"torque_in": bench.sensors.torque_in, "torque_out": bench.sensors.torque_out}
    quiet = [name for name, sensor in named.items() if sensor is not None and sensor.noise_fraction == 0.0]
    if quiet:
        found = f"'{recipe.measurement.output_torque}', and bench '{bench.bench.name}' has noise: 0 % for "
        allowed = "its noise as measured, without which torques that were filtered or copied are not seen"
        hint = "Enter the standard deviation at rest in the bench file (noise)."
        yield Finding(("measurement", "output_torque"), found + " and ".join(quiet), allowed, hint)


def check_fixture(recipe: Recipe, bench: Bench, today: date) -> Iterator[Finding]:
    """The blank test of the fixture, where there is one, is in date and reaches as far as the cycles."""
    curve, name, option = bench.fixture.curve, bench.bench.name, ("measurement",)
    if curve is None:
        return
    allowed, hint = (
        "a blank test that is not overdue",
        "Repeat the blank test on this bench and enter 'lostmotion blank' in its file.",
    )
    test = f"the fixture's blank test '{curve.id}' of bench '{name}'"
    if curve.due < today:
        found = f"{test}, which was due on {curve.due.isoformat()}"
        yield Finding(option, found, allowed, hint)
    elif curve.made > today:
        day = curve.made.isoformat()
        found = f"the fixture's blank test '{curve.id}' of bench '{name}' is from {day}, a date in the future"
        yield Finding(option, found, allowed, "Correct the date or the clock.")
    peak_nm = max((step.peak_torque_nm for step in recipe.sequence if isinstance(step, MEASURED)), default=0.0)
    low_nm, high_nm = curve.points[0].torque_nm, curve.points[-1].torque_nm
    if min(-low_nm, high_nm) * BEYOND_BLANK_TEST < peak_nm:
        found = f"{test}, which goes from {show(low_nm, TORQUE)} to {show(high_nm, TORQUE)}"
        needed = f"one that reaches ±{show(peak_nm, TORQUE)}, where the cycles turn"
        yield Finding(option, found, needed, "Repeat the blank test with the peak torque of this recipe.")


def check_metrics(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Every metric comes out of what is measured, and none is asked twice."""
    peaks = [step.peak_torque_nm for step in recipe.sequence if isinstance(step, MEASURED)]
    if not peaks:
        kinds = one_of(["torque_cycles", "speed_cycles", "step_cycles"])
        yield Finding(("metrics",), "metrics, but no measured cycles", kinds, "Fatigue cycles are not evaluated.")
    calibrates = any(isinstance(step, Calibrate) for step in recipe.sequence)
    both_sensors = bench.sensors.torque_in is not None and bench.sensors.torque_out is not None
    reference_nm = recipe.measurement.reference_torque_nm
    asked: set[tuple[object, ...]] = set()
    for place, metric in recipe.wanted():
        needs = METRICS[metric.id]
        option = (*place, "id") if place[0] == "metrics" else place
        if needs.calibration and not (calibrates and both_sensors):
            found = f"'{metric.id}', which is measured in calibrate only"
            yield Finding(option, found, "a sequence with calibrate", "Delete it or add the step.")
        reach_nm = needs.reach * reference_nm
        if "torque" in needs.free and metric.torque_nm is not None:
            reach_nm = metric.torque_nm
        if "band" in needs.free and metric.band is not None:
            reach_nm = metric.band * reference_nm
        if peaks and not needs.calibration and reach_nm > min(peaks) * ROUNDING:
            found = f"'{metric.id}', which is read at {show(reach_nm, TORQUE)}"
            allowed = f"metrics up to {show(min(peaks), TORQUE)}, where the cycles turn"
            yield Finding(option, found, allowed, "Raise peak_torque or lower reference_torque.")
        key = metric.key(reference_nm)
        if key in asked:
            yield Finding(option, f"'{metric.id}' a second time", "each metric once", "Delete one of the two.")
        asked.add(key)


def check_ages(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Limits on the age of values leave room for how often each value comes, and end before the drive gives up."""
    period_s, limits, drive = recipe.sampling.period_s, recipe.interlocks, bench.drive
    sample_s = bench.sample_every_s if bench.channels is None else bench.sample_every(period_s)
    if bench.channels is None and period_s * ROUNDING < sample_s:
        allowed = f"from {show(sample_s, PERIOD)}: the amplifier is not asked more often"
        yield Finding(("sampling", "period"), show(period_s, PERIOD), allowed, "Raise the period.")
    for option, age_s, every_s, what in (
        (("sampling", "sample_age"), recipe.sampling.sample_age_s, sample_s, "samples come"),
        (("interlocks", "sample_age"), limits.sample_age_s, sample_s, "samples come"),
        (("interlocks", "drive_age"), limits.drive_age_s, period_s, "the drive answers"),
        (("interlocks", "io_age"), limits.io_age_s, bench.remote_io.poll_every_s, "the remote I/O is asked"),
        (("interlocks", "brake_age"), limits.brake_age_s, bench.lock_brake.poll_every_s, "the brake is asked"),
        (("interlocks", "drive_heartbeat"), limits.drive_heartbeat_s, drive.drive_heartbeat_s, "it comes"),
    ):
        shortest_s = 2 * max(every_s, period_s)
        if age_s * ROUNDING < shortest_s:
            found = f"{show(age_s, PERIOD)}, though {what} every {show(max(every_s, period_s), PERIOD)}"
            allowed = f"at least {show(shortest_s, PERIOD)}"
            yield Finding(option, found, allowed, "Raise it: every run would trip.")
    waits = f"the drive waits {show(drive.setpoint_timeout_s, PERIOD)} for a set-point "
    waits += "(drive.setpoint_timeout of the bench)"
    for name, age_s in (("sample_age", limits.sample_age_s), ("drive_age", limits.drive_age_s)):
        if age_s > drive.setpoint_timeout_s * ROUNDING:
            allowed = f"up to {show(drive.setpoint_timeout_s, PERIOD)}: {waits}"
            hint = "Lower it: it must not be longer than the drive's own time-out."
            yield Finding(("interlocks", name), show(age_s, PERIOD), allowed, hint)
    if drive.setpoint_timeout_s * ROUNDING < 2 * period_s:
        allowed = f"up to {show(drive.setpoint_timeout_s / 2, PERIOD)}: {waits}"
        yield Finding(("sampling", "period"), show(period_s, PERIOD), allowed, "Lower the period.")


def check_two_speeds(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    """Cycles at two speeds that differ enough, with one peak: the width of a loop depends on where it turned."""
    if recipe.measurement.alignment != "two_speeds":
        return
    steps = [(index, step) for index, step in enumerate(recipe.sequence) if isinstance(step, Ramps)]
    speeds = [_windup_speed(recipe, bench, step) for _, step in steps]
    if not speeds or max(speeds) * ROUNDING < DIFFERENT_SPEED * min(speeds):
        found = "'two_speeds', but " + (
            f"cycles at {' and '.join(f'{speed:.3g}' for speed in sorted(set(speeds)))} arcmin/s of wind-up alone"
            if speeds
            else "no torque_cycles or speed_cycles"
        )
        allowed = f"torque_cycles or speed_cycles in sequence at two speeds that differ by {DIFFERENT_SPEED:g} times "
        yield Finding(ALIGNMENT, found, allowed + "or more", BY_BENCH)
        return
    cycles = sum(step.count for _, step in steps)
    if cycles < LEAST_CYCLES:
        hint = "Raise a count: two cycles do not give the uncertainty of the delay."
        yield Finding(ALIGNMENT, f"'two_speeds' with {cycles} cycles", f"{LEAST_CYCLES} cycles or more", hint)
    first = steps[0][1].peak_torque_nm
    for index, step in steps[1:]:
        if abs(step.peak_torque_nm - first) * 1e9 > first:
            found = f"{show(step.peak_torque_nm, TORQUE)} and {show(first, TORQUE)} with 'alignment: two_speeds'"
            hint = "The loop width depends on the peak torque. A difference would be read as a delay."
            yield Finding(("sequence", index, step.kind, "peak_torque"), found, "one peak for all cycles", hint)


def _windup_speed(recipe: Recipe, bench: Bench, step: Ramps) -> float:
    """Speed of the wind-up at the output by the catalogue's stiffness [arcmin/s]."""
    unit = recipe.unit_under_test
    if isinstance(step, TorqueCycles):
        return step.torque_rate_nm_s / unit.stiffness_nm_per_arcmin
    loaded = step.speed_rad_s / bench.drive.gear_ratio * ARCMIN_PER_RAD
    return loaded / unit.ratio if recipe.loading == "input" else loaded
