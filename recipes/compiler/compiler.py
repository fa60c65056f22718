"""Turns a recipe and a bench into a `Program`; recipe times become scans here and in the load profile."""

from __future__ import annotations

import math
from typing import TypeVar

from definitions.faults import LIMITS, Limit
from definitions.program import Limits, Lock, Program, Tare, TorqueControl
from recipes import Bench, Recipe
from recipes.compiler.budgets import budget
from recipes.compiler.load_profile import ARCMIN_PER_RAD, segments_of
from recipes.schema.sequence_schema import Calibrate, Home, Unload
from recipes.schema.sequence_schema import Lock as LockStep
from recipes.schema.sequence_schema import Release as ReleaseStep

StepT = TypeVar("StepT")


def _step(recipe: Recipe, kind: type[StepT]) -> StepT:
    return next(step for step in recipe.sequence if isinstance(step, kind))


def _limits(recipe: Recipe, bench: Bench, period_s: float) -> Limits:
    interlocks, rated_nm = recipe.interlocks, recipe.unit_under_test.rated_torque_nm
    drive, sensors = bench.drive, bench.sensors
    angle = sensors.angle_in if recipe.loading == "input" else sensors.angle_out
    coupling = drive.coupling_stiffness_nm_per_arcmin
    lock = _step(recipe, LockStep)

    def scans(seconds: float) -> int:
        return max(1, round(seconds / period_s))

    def limit(row: Limit) -> float:
        asked: float = getattr(interlocks, row.option)
        return scans(asked) if row.in_scans else asked

    return Limits(
        **{row.in_program: limit(row) for row in LIMITS},
        lock_proof_motion_rad=lock.max_motion_rad,
        # held up at half of what trips: a short hiccup pauses the ramp, a long one stops it
        sample_late_scans=max(2, scans(interlocks.sample_age_s) // 2),
        torque_agreement_nm=budget("agreement_of_rated") * rated_nm,
        torque_agreement_ratio=budget("agreement_ratio"),
        angle_agreement_rad=drive.angle_agreement_rad if angle else math.inf,
        angle_lag_scans=angle.lag_s / period_s if angle else 0.0,
        coupling_rad_per_nm=1.0 / (coupling * ARCMIN_PER_RAD) if coupling else 0.0,
    )


def _tare(recipe: Recipe, bench: Bench, period_s: float) -> Tare:
    home, sensors = _step(recipe, Home), bench.sensors
    share = budget("tare_spread_of_full_scale")
    return Tare(
        samples=max(10, round(home.tare_time_s / period_s)),
        torque_in_zero_nm=home.torque_in_tare_nm if sensors.torque_in else math.inf,
        torque_out_zero_nm=home.torque_out_tare_nm if sensors.torque_out else math.inf,
        torque_in_spread_nm=share * sensors.torque_in.full_scale_nm if sensors.torque_in else math.inf,
        torque_out_spread_nm=share * sensors.torque_out.full_scale_nm if sensors.torque_out else math.inf,
    )


def _loading_line(recipe: Recipe, bench: Bench) -> tuple[float, float]:
    """Slope and offset that plan the input torque: of the newest stored calibration when the recipe uses one."""
    line = recipe.unit_under_test.loading_torque_ratio
    newest = bench.newest_calibration(recipe.unit_under_test.model)
    if recipe.measurement.calibration != "stored" or newest is None:
        return line.slope, line.offset_nm
    # offsets of the two directions have opposite signs: the mean of the magnitudes serves both
    slope = (newest.load_positive.slope + newest.load_negative.slope) / 2.0
    return slope, (newest.load_positive.offset_nm - newest.load_negative.offset_nm) / 2.0


def _control(recipe: Recipe, bench: Bench) -> TorqueControl:
    unit, drive = recipe.unit_under_test, bench.drive
    slope, offset_nm = _loading_line(recipe, bench)
    at_input = recipe.loading == "input"
    calibrated = recipe.measurement.output_torque == "calibrated"
    limit_nm = drive.max_torque_nm * drive.gear_ratio
    stiffness = unit.stiffness_nm_per_arcmin * ARCMIN_PER_RAD
    return TorqueControl(
        controlled_from_input=calibrated or bench.sensors.torque_out is None,
        measure_ratio=calibrated and any(isinstance(step, Calibrate) for step in recipe.sequence),
        slope=slope if at_input else 1.0,
        offset_nm=offset_nm if at_input else 0.0,
        gain_per_s=bench.torque_control.gain_per_s,
        window_nm=budget("window_of_rated") * unit.rated_torque_nm,
        tolerance_nm=budget("tolerance_of_rated") * unit.rated_torque_nm,
        rate_acceleration_s=budget("rate_acceleration_s"),
        slew_nm_s=budget("slew_of_peak_per_s") * limit_nm,
        torque_limit_nm=limit_nm,
        stiffness_nm_per_rad=stiffness / unit.ratio if at_input else stiffness,
    )


def compile_program(recipe: Recipe, bench: Bench) -> Program:
    """The program of a checked recipe on a bench; `recipes.check` has found nothing against the pair."""
    period_s = recipe.sampling.period_ns * 1e-9
    segments = segments_of(recipe, bench, period_s)
    current_a = _step(recipe, LockStep).holding_torque_nm / bench.lock_brake.torque_constant_nm_per_a
    release = _step(recipe, ReleaseStep)
    unload_nm_s = _step(recipe, Unload).torque_rate_nm_s
    peak_nm = max(segment.peak_nm for segment in segments)

    def scans(name: str) -> int:
        return math.ceil(budget(name) / period_s)

    return Program(
        name=recipe.recipe.name,
        period_s=period_s,
        loading_input=recipe.loading == "input",
        ratio=recipe.unit_under_test.ratio,
        has_torque_in=bench.sensors.torque_in is not None,
        has_torque_out=bench.sensors.torque_out is not None,
        segments=segments,
        unload_segment=len(segments) - 1,
        limits=_limits(recipe, bench, period_s),
        tare=_tare(recipe, bench, period_s),
        lock=Lock(
            current_a=current_a,
            tolerance_a=budget("brake_tolerance_of_current") * current_a,
            settle_scans=math.ceil(budget("settle_of_time_constant") * bench.lock_brake.time_constant_s / period_s),
            limit_scans=scans("lock_current_s"),
        ),
        control=_control(recipe, bench),
        release_torque_nm=release.max_torque_nm,
        ready_scans=scans("ready_s"),
        enable_scans=scans("enable_s"),
        homing_scans=scans("homing_s"),
        mode_scans=scans("mode_s"),
        release_scans=scans("release_s"),
        unload_limit_scans=math.ceil((peak_nm / unload_nm_s * 3.0 + budget("ramp_limit_extra_s")) / period_s),
        settle_scans=scans("settle_s"),
    )
