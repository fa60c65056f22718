"""Checks that need more than one place: torques against every rating, ramps against limits, methods against sensors.

Each check is a function of recipe and bench that yields findings; `CHECKS` lists them all.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from recipes.bench_schema import Bench
from recipes.metric_units import METRIC_KINDS
from recipes.problems import Problem
from recipes.recipe_schema import Recipe
from recipes.sequence_schema import Calibrate, FatigueCycles, Home, Lock, SpeedCycles, StepCycles, TorqueCycles
from recipes.yaml_source import Path_, read_source, show_path

ARCMIN_PER_RAD = 10800.0 / math.pi
MOST_OF_RATED = 2.0
LOCK_MARGIN = 1.1
SPEED_TIME_MARGIN = 1.2

Loaded = Calibrate | TorqueCycles | SpeedCycles | StepCycles | FatigueCycles


class Finding(NamedTuple):
    """What a check found: path of the option in the recipe, what was found, what is allowed, what to do."""

    path: Path_
    found: str
    allowed: str
    hint: str = ""


def check(recipe: Recipe, bench: Bench, path: str | Path | None = None, today: dt.date | None = None) -> list[Problem]:
    """All that speaks against this recipe on this bench; `path` gives the places in the recipe's file."""
    places = read_source(path).places if path is not None else {}
    shown = str(path) if path is not None else recipe.recipe.name
    problems = []
    for finding in _findings(recipe, bench, today or dt.datetime.now(tz=dt.UTC).date()):
        option = finding.path
        while option and option not in places:
            option = option[:-1]
        line, column = places.get(option, (0, 0))
        problems.append(Problem(shown, line, column, show_path(finding.path), *finding[1:]))
    return sorted(problems)


def _findings(recipe: Recipe, bench: Bench, today: dt.date) -> Iterator[Finding]:
    for function in CHECKS:
        yield from function(recipe, bench)
    yield from _calibration(recipe, bench, today)


def _loaded(recipe: Recipe) -> Iterator[tuple[Path_, Loaded]]:
    for index, step in enumerate(recipe.sequence):
        if isinstance(step, Loaded):
            yield ("sequence", index, step.kind), step


def _side(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    if recipe.loading != bench.bench.loading:
        found = f"found '{recipe.loading}', but bench '{bench.bench.name}' drives the {bench.bench.loading} shaft"
        yield Finding(("loading",), found, bench.bench.loading, "Choose a bench that loads this side.")
    if bench.bench.models and recipe.unit_under_test.model not in bench.bench.models:
        found = f"found '{recipe.unit_under_test.model}', which bench '{bench.bench.name}' does not take"
        yield Finding(("unit_under_test", "model"), found, ", ".join(bench.bench.models))


def _unit_rating(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    most_nm = MOST_OF_RATED * recipe.unit_under_test.rated_torque_nm
    for path, step in _loaded(recipe):
        if step.peak_torque_nm > most_nm * (1 + 1e-9):
            found = f"found {step.peak_torque_nm:.6g} N·m, above {MOST_OF_RATED:.0%} of the unit's rated torque"
            yield Finding((*path, "peak_torque"), found, f"up to {most_nm:.6g} N·m")


def _output_sensor(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    sensor = bench.sensors.torque_out
    if sensor is None:
        return
    for path, step in _loaded(recipe):
        if step.peak_torque_nm > sensor.full_scale_nm:
            found = f"found {step.peak_torque_nm:.6g} N·m, above the full scale of the output torque sensor"
            yield Finding((*path, "peak_torque"), found, f"up to {sensor.full_scale_nm:.6g} N·m")
    if recipe.interlocks.torque_out_trip_nm > sensor.full_scale_nm * LOCK_MARGIN:
        found = f"found {recipe.interlocks.torque_out_trip_nm:.6g} N·m, which the output torque sensor cannot show"
        allowed = f"up to {sensor.full_scale_nm * LOCK_MARGIN:.6g} N·m, where the sensor saturates"
        yield Finding(("interlocks", "torque_out_trip"), found, allowed)


def _input_torque_nm(recipe: Recipe, output_nm: float) -> float:
    line = recipe.unit_under_test.loading_torque_ratio
    return (output_nm - line.offset_nm) / line.slope


def _input_sensor(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    sensor = bench.sensors.torque_in
    if recipe.loading != "input" or sensor is None:
        return
    line = recipe.unit_under_test.loading_torque_ratio
    most_nm = sensor.full_scale_nm * line.slope + line.offset_nm
    for path, step in _loaded(recipe):
        needed_nm = _input_torque_nm(recipe, step.peak_torque_nm)
        if needed_nm > sensor.full_scale_nm:
            found = (
                f"found {step.peak_torque_nm:.6g} N·m, which takes {needed_nm:.4g} N·m at the input, above its sensor"
            )
            yield Finding(
                (*path, "peak_torque"), found, f"up to {most_nm:.5g} N·m ({sensor.full_scale_nm:g} N·m at the input)"
            )
        if needed_nm >= recipe.interlocks.torque_in_trip_nm:
            found = (
                f"found {step.peak_torque_nm:.6g} N·m, never reached: its {needed_nm:.4g} N·m at the input trips first"
            )
            yield Finding(
                (*path, "peak_torque"), found, f"less than {recipe.interlocks.torque_in_trip_nm:g} N·m at the input"
            )
    if recipe.interlocks.torque_in_trip_nm > sensor.full_scale_nm * LOCK_MARGIN:
        found = f"found {recipe.interlocks.torque_in_trip_nm:.6g} N·m, which the input torque sensor cannot show"
        allowed = f"up to {sensor.full_scale_nm * LOCK_MARGIN:.6g} N·m, where the sensor saturates"
        yield Finding(("interlocks", "torque_in_trip"), found, allowed)


def _brake(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    most_nm = bench.brake.torque_constant_nm_per_a * bench.brake.max_current_a
    for index, step in enumerate(recipe.sequence):
        if not isinstance(step, Lock):
            continue
        path: Path_ = ("sequence", index, "lock", "holding_torque")
        if step.holding_torque_nm > most_nm:
            found = f"found {step.holding_torque_nm:.6g} N·m, more than the lock brake can hold"
            yield Finding(path, found, f"up to {most_nm:.6g} N·m ({bench.brake.max_current_a:g} A)")
        for _, loaded in _loaded(recipe):
            locked_nm = loaded.peak_torque_nm
            if recipe.loading == "output":
                locked_nm /= recipe.unit_under_test.ratio
            if step.holding_torque_nm < LOCK_MARGIN * locked_nm:
                found = f"found {step.holding_torque_nm:.6g} N·m for a lock that has to bear {locked_nm:.6g} N·m"
                yield Finding(path, found, f"{LOCK_MARGIN * locked_nm:.6g} N·m or more")
                break


def _drive(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    drive = bench.drive
    most_nm = drive.max_torque_nm * drive.gear_ratio
    for path, step in _loaded(recipe):
        needed_nm = step.peak_torque_nm
        if recipe.loading == "input":
            needed_nm = _input_torque_nm(recipe, needed_nm)
        if needed_nm > most_nm:
            found = f"found {step.peak_torque_nm:.6g} N·m, which takes {needed_nm:.4g} N·m at the driven shaft"
            yield Finding((*path, "peak_torque"), found, f"up to {most_nm:.4g} N·m, the drive's limit")
        if isinstance(step, SpeedCycles) and step.speed_rad_s > drive.max_speed_rad_s:
            found = f"found {step.speed_rad_s:.4g} rad/s, above the drive's speed limit"
            yield Finding((*path, "speed"), found, f"up to {drive.max_speed_rad_s:.4g} rad/s at the motor")


def _reaches(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    limits, unit = recipe.interlocks, recipe.unit_under_test
    for path, step in _loaded(recipe):
        for name, limit_nm in (("alarm", limits.torque_out_alarm_nm), ("trip", limits.torque_out_trip_nm)):
            if step.peak_torque_nm >= limit_nm:
                found = f"found {step.peak_torque_nm:.6g} N·m, never reached: the {name} at {limit_nm:.6g} N·m is first"
                yield Finding((*path, "peak_torque"), found, f"below {limit_nm:.6g} N·m, or a higher {name} limit")
                break
        if isinstance(step, SpeedCycles):
            loaded_speed = step.speed_rad_s / bench.drive.gear_ratio
            windup_rad = 2 * step.peak_torque_nm / unit.stiffness_nm_per_arcmin / ARCMIN_PER_RAD
            windup_rad *= unit.ratio if recipe.loading == "input" else 1.0
            needed_s = SPEED_TIME_MARGIN * windup_rad / loaded_speed
            if step.time_limit_s < needed_s:
                found = f"found {step.time_limit_s:g} s: at this speed the ramp never reaches its torque in time"
                yield Finding((*path, "time_limit"), found, f"{needed_s:.3g} s or more for this unit's stiffness")
            if loaded_speed >= limits.speed_rad_s:
                found = f"found {loaded_speed:.4g} rad/s at the loaded shaft, at or above the overspeed limit"
                yield Finding((*path, "speed"), found, f"below {limits.speed_rad_s:.4g} rad/s")
        if isinstance(step, StepCycles) and step.peak_torque_nm / step.steps < 0.005 * unit.rated_torque_nm:
            found = f"found {step.steps} steps, each smaller than the ramp's tolerance"
            yield Finding((*path, "steps"), found, f"up to {int(step.peak_torque_nm / (0.005 * unit.rated_torque_nm))}")


def _limits(recipe: Recipe, _bench: Bench) -> Iterator[Finding]:
    limits = recipe.interlocks
    if limits.torque_out_alarm_nm >= limits.torque_out_trip_nm:
        found = f"found {limits.torque_out_alarm_nm:.6g} N·m, not below the trip"
        yield Finding(("interlocks", "torque_out_alarm"), found, f"below {limits.torque_out_trip_nm:.6g} N·m")
    for index, metric in enumerate(recipe.metrics):
        if metric.min is not None and metric.max is not None and metric.min > metric.max:
            found = f"found min {metric.min:g} above max {metric.max:g}"
            yield Finding(("metrics", index, "min"), found, "min up to max", "Swap the two limits.")


def _period(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    period_s = recipe.sampling.period_s
    if not 0.5e-3 <= period_s <= 20e-3:
        yield Finding(("sampling", "period"), f"found {period_s:g} s", "from 0.5 ms to 20 ms")
    if recipe.interlocks.sample_age_s < 2 * max(period_s, bench.amplifier.poll_every_s):
        every_s = bench.amplifier.poll_every_s
        found = f"found {recipe.interlocks.sample_age_s:g} s, too short for samples every {every_s:g} s"
        yield Finding(("interlocks", "sample_age"), found, "at least twice the period and the amplifier's poll_every")


def _sensors(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    source = ("measurement", "output_torque")
    if recipe.measurement.output_torque == "reaction" and bench.sensors.torque_out is None:
        yield Finding(source, "found 'reaction', but the bench has no output torque sensor", "calibrated")
    if recipe.measurement.output_torque == "calibrated":
        if recipe.loading == "output":
            yield Finding(source, "found 'calibrated', which is for loading at the input", "reaction")
        elif bench.sensors.torque_in is None:
            yield Finding(source, "found 'calibrated', but the bench has no input torque sensor", "reaction")
    if recipe.loading == "output" and bench.sensors.angle_out is None:
        yield Finding(("loading",), "found 'output', but the bench has no output encoder", "input")


def _metrics(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    calibrates = any(isinstance(step, Calibrate) for step in recipe.sequence)
    for index, metric in enumerate(recipe.metrics):
        needs = METRIC_KINDS[metric.id].needs
        if needs == "torque" and metric.torque_nm is None:
            yield Finding(("metrics", index), f"'{metric.id}' has no torque", "a torque, such as torque: 50 %")
        if needs != "torque" and metric.torque_nm is not None:
            yield Finding(("metrics", index, "torque"), f"'{metric.id}' takes no torque", "stiffness_at only")
        if needs == "calibrate" and (not calibrates or bench.sensors.torque_in is None):
            found = f"'{metric.id}' needs a calibrate step and an input torque sensor"
            yield Finding(("metrics", index, "id"), found, "a sequence with 'calibrate'")
    if not any(isinstance(step, TorqueCycles | SpeedCycles | StepCycles) for step in recipe.sequence):
        yield Finding(
            ("metrics",), "found metrics, but no measured cycles", "torque_cycles, speed_cycles or step_cycles"
        )


def _home(recipe: Recipe, bench: Bench) -> Iterator[Finding]:
    sensors = {"torque_in_tare": bench.sensors.torque_in, "torque_out_tare": bench.sensors.torque_out}
    for index, step in enumerate(recipe.sequence):
        if isinstance(step, Home):
            for name, sensor in sensors.items():
                value_nm = step.torque_in_tare_nm if name == "torque_in_tare" else step.torque_out_tare_nm
                if sensor is not None and value_nm > 0.1 * sensor.full_scale_nm:
                    found = f"found {value_nm:g} N·m, more than a tenth of the sensor's full scale"
                    yield Finding(("sequence", index, "home", name), found, f"up to {0.1 * sensor.full_scale_nm:g} N·m")


def _calibration(recipe: Recipe, bench: Bench, today: dt.date) -> Iterator[Finding]:
    path = ("measurement", "calibration")
    if recipe.measurement.calibration == "stored":
        mine = [item for item in bench.calibrations if item.model == recipe.unit_under_test.model]
        if not mine:
            found = (
                f"found 'stored', but bench '{bench.bench.name}' has no calibration for {recipe.unit_under_test.model}"
            )
            yield Finding(
                path, found, "measured, with a calibrate step", "Calibrate, and enter the result in the bench file."
            )
        elif all(item.due < today for item in mine):
            newest = max(mine, key=lambda item: item.due)
            found = f"found 'stored', but calibration '{newest.id}' was due on {newest.due.isoformat()}"
            yield Finding(path, found, "a calibration in date", "Calibrate again.")
    elif recipe.measurement.output_torque == "calibrated" and not any(
        isinstance(s, Calibrate) for s in recipe.sequence
    ):
        yield Finding(path, "found 'measured', but the sequence has no calibrate step", "a calibrate step, or stored")


CHECKS: tuple[Callable[[Recipe, Bench], Iterator[Finding]], ...] = (
    _side,
    _unit_rating,
    _output_sensor,
    _input_sensor,
    _brake,
    _drive,
    _reaches,
    _limits,
    _period,
    _sensors,
    _metrics,
    _home,
)
