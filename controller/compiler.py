"""Turns a recipe and a bench into a `Program`. The only place where recipe times become scans.

What the recipe does not say is in `BUDGETS`, one row each, with its reason.
"""

from __future__ import annotations

import math
from typing import TypeVar

from controller.image import State
from controller.program import Limits, Lock, Program, Segment, Tare, TorqueControl
from recipes import Bench, Recipe
from recipes.sequence_schema import (
    Calibrate,
    FatigueCycles,
    Home,
    SpeedCycles,
    StepCycles,
    TorqueCycles,
    Unload,
)
from recipes.sequence_schema import Lock as LockStep
from recipes.sequence_schema import Release as ReleaseStep

ARCMIN_PER_RAD = 10800.0 / math.pi

BUDGETS: dict[str, tuple[float, str]] = {
    "ready_s": (3.0, "devices answer within this time after the start"),
    "enable_s": (2.0, "the drive walks from switch on disabled to operation enabled"),
    "homing_s": (10.0, "longest homing"),
    "mode_s": (0.5, "the drive shows the ordered mode of operation"),
    "release_s": (3.0, "brake current gone and drive off"),
    "settle_s": (0.3, "tail that is recorded after the last step, and the rest after a reaction"),
    "proof_s": (1.0, "a ramp to the proof torque takes this long"),
    "lock_current_s": (3.0, "brake supply reaches its current"),
    "ramp_limit_factor": (3.0, "a ramp may take this many times its planned duration"),
    "ramp_limit_extra_s": (10.0, "and this long on top: friction is crossed at each reversal"),
    "reversal_s": (1.3, "planned time to cross the friction at a reversal of a ramp by torque"),
    "window_of_rated": (0.02, "the reference runs ahead of the torque by no more than this"),
    "tolerance_of_rated": (0.005, "a target counts as reached within this"),
    "rate_acceleration_s": (0.15, "a ramp by torque comes to its full rate in this time"),
    "gain_per_s": (15.0, "integral gain: crossover at 2.4 to 4 Hz, a decade below the first resonance"),
    "tare_spread_of_full_scale": (0.01, "noise of a healthy channel is a fiftieth of its full scale or less"),
    "agreement_of_rated": (0.25, "input and output torque fit together within this"),
    "agreement_ratio": (1.7, "and within this factor of the gear ratio: an unloading reducer multiplies by 1.4"),
    "brake_tolerance_of_current": (0.05, "brake current counts as reached within this"),
    "settle_of_time_constant": (5.0, "the brake's torque has settled after this many time constants"),
    "slew_of_peak_per_s": (0.5, "the drive's torque never changes faster than this share of its limit per second"),
}


StepT = TypeVar("StepT")


def _budget(name: str) -> float:
    return BUDGETS[name][0]


class _Profile:
    """Collects segments and keeps where the torque stands."""

    def __init__(self, recipe: Recipe, bench: Bench, period_s: float) -> None:
        self.recipe, self.bench, self.period_s = recipe, bench, period_s
        self.segments: list[Segment] = [
            Segment(0, State.IDLE, "none", 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0),
        ]
        self.level_nm = 0.0
        self.block = 0

    def scans(self, seconds: float) -> int:
        return max(0, math.ceil(seconds / self.period_s - 1e-9))

    def ramp(
        self,
        state: State,
        role: str,
        target_nm: float,
        *,
        cycle: int = 0,
        rate_nm_s: float = 0.0,
        speed: SpeedCycles | None = None,
    ) -> None:
        span_nm = abs(target_nm - self.level_nm)
        speed_rad_s = acceleration_rad_s2 = 0.0
        if speed is not None:
            speed_rad_s = speed.speed_rad_s / self.bench.drive.gear_ratio
            acceleration_rad_s2 = speed.acceleration_rad_s2 / self.bench.drive.gear_ratio
            span_rad = span_nm / self.stiffness_nm_per_rad()
            planned_s = span_rad / speed_rad_s + speed_rad_s / acceleration_rad_s2
            limit_s = speed.time_limit_s
        else:
            reversing = self.level_nm != 0.0 and (target_nm - self.level_nm) * self.level_nm < 0
            planned_s = span_nm / rate_nm_s + _budget("rate_acceleration_s")
            planned_s += _budget("reversal_s") if reversing and self.recipe.loading == "input" else 0.0
            limit_s = planned_s * _budget("ramp_limit_factor") + _budget("ramp_limit_extra_s")
        direction = 1 if target_nm > self.level_nm else -1
        self.segments.append(
            Segment(
                len(self.segments),
                state,
                role,
                direction,
                cycle,
                self.block,
                self.level_nm,
                target_nm,
                rate_nm_s,
                speed_rad_s,
                acceleration_rad_s2,
                0,
                self.scans(limit_s),
                self.scans(planned_s),
            ),
        )
        self.level_nm = target_nm

    def dwell(self, state: State, seconds: float, cycle: int = 0, role: str = "dwell", direction: int = 0) -> None:
        scans = max(1, self.scans(seconds))
        self.segments.append(
            Segment(
                len(self.segments),
                state,
                role,
                direction,
                cycle,
                self.block,
                self.level_nm,
                self.level_nm,
                0.0,
                0.0,
                0.0,
                scans,
                scans,
                scans,
            ),
        )

    def stiffness_nm_per_rad(self) -> float:
        """Planned torque per angle of the loaded shaft."""
        unit = self.recipe.unit_under_test
        at_output = unit.stiffness_nm_per_arcmin * ARCMIN_PER_RAD
        return at_output / unit.ratio if self.recipe.loading == "input" else at_output

    def swing(self, role: str, target_nm: float, cycle: int, step: TorqueCycles | SpeedCycles | FatigueCycles) -> None:
        state = State.RAMP_POS if target_nm > self.level_nm else State.RAMP_NEG
        if isinstance(step, SpeedCycles):
            self.ramp(state, role, target_nm, cycle=cycle, speed=step)
        else:
            self.ramp(state, role, target_nm, cycle=cycle, rate_nm_s=step.torque_rate_nm_s)
        self.dwell(State.REVERSE, 0.0 if isinstance(step, FatigueCycles) else step.dwell_s, cycle)

    def stairs(self, role: str, target_nm: float, cycle: int, step: StepCycles) -> None:
        state = State.RAMP_POS if target_nm > self.level_nm else State.RAMP_NEG
        direction = 1 if target_nm > self.level_nm else -1
        height_nm = step.peak_torque_nm / step.steps
        count = round(abs(target_nm - self.level_nm) / height_nm)
        start_nm = self.level_nm
        for number in range(1, count + 1):
            level_nm = start_nm + direction * number * height_nm if number < count else target_nm
            self.ramp(state, role, level_nm, cycle=cycle, rate_nm_s=step.torque_rate_nm_s)
            if number < count:
                self.dwell(state, step.dwell_s, cycle, role, direction)
        self.dwell(State.REVERSE, step.dwell_s, cycle)

    def cycles(self, step: TorqueCycles | SpeedCycles | StepCycles | FatigueCycles) -> None:
        """From wherever the torque stands to +peak, then `count` times to -peak and back to +peak."""
        self.block += 1
        peak_nm = step.peak_torque_nm
        role = "fatigue" if isinstance(step, FatigueCycles) else "measure"
        move = self.stairs if isinstance(step, StepCycles) else self.swing
        if self.level_nm != peak_nm:
            # from zero or from another block's peak: not a closed loop yet
            move("virgin" if self.level_nm == 0.0 else "approach", peak_nm, 0, step)  # type: ignore[arg-type]
        for cycle in range(1, step.count + 1):
            move(role, -peak_nm, cycle, step)  # type: ignore[arg-type]
            move(role, peak_nm, cycle, step)  # type: ignore[arg-type]


def _step(recipe: Recipe, kind: type[StepT]) -> StepT:
    return next(step for step in recipe.sequence if isinstance(step, kind))


def _segments(recipe: Recipe, bench: Bench, period_s: float) -> tuple[Segment, ...]:
    profile = _Profile(recipe, bench, period_s)
    unload = _step(recipe, Unload)
    for step in recipe.sequence:
        if isinstance(step, LockStep):
            rate_nm_s = step.proof_torque_nm / _budget("proof_s")
            for target_nm in (step.proof_torque_nm, -step.proof_torque_nm):
                profile.ramp(State.LOCK, "proof", target_nm, rate_nm_s=rate_nm_s)
                profile.dwell(State.LOCK, step.proof_time_s)
            profile.ramp(State.LOCK, "proof", 0.0, rate_nm_s=rate_nm_s)
        elif isinstance(step, Calibrate):
            for target_nm in (step.peak_torque_nm, -step.peak_torque_nm):
                profile.ramp(State.CALIBRATE, "calibrate", target_nm, rate_nm_s=step.torque_rate_nm_s)
                profile.dwell(State.CALIBRATE, step.dwell_s)
            profile.ramp(State.CALIBRATE, "calibrate", 0.0, rate_nm_s=step.torque_rate_nm_s)
        elif isinstance(step, TorqueCycles | SpeedCycles | StepCycles | FatigueCycles):
            profile.cycles(step)
    profile.ramp(State.UNLOAD, "unload", 0.0, rate_nm_s=unload.torque_rate_nm_s)
    return tuple(profile.segments)


def _limits(recipe: Recipe, period_s: float) -> Limits:
    interlocks, rated_nm = recipe.interlocks, recipe.unit_under_test.rated_torque_nm
    lock = _step(recipe, LockStep)

    def scans(seconds: float) -> int:
        return max(1, round(seconds / period_s))

    return Limits(
        torque_out_alarm_nm=interlocks.torque_out_alarm_nm,
        torque_out_trip_nm=interlocks.torque_out_trip_nm,
        torque_in_trip_nm=interlocks.torque_in_trip_nm,
        speed_rad_s=interlocks.speed_rad_s,
        travel_rad=interlocks.travel_rad,
        lock_slip_rad=interlocks.lock_slip_rad,
        lock_proof_motion_rad=lock.max_motion_rad,
        housing_temperature_c=interlocks.housing_temperature_c,
        # held up at half of what trips: a short hiccup pauses the ramp, a long one stops it
        sample_late_scans=max(2, scans(interlocks.sample_age_s) // 2),
        sample_stale_scans=scans(interlocks.sample_age_s),
        drive_stale_scans=scans(interlocks.drive_age_s),
        heartbeat_scans=scans(interlocks.drive_heartbeat_s),
        io_stale_scans=scans(interlocks.io_age_s),
        brake_stale_scans=scans(interlocks.brake_age_s),
        missed_in_a_row=interlocks.missed_in_a_row,
        internal_limit_scans=scans(interlocks.internal_limit_s),
        torque_agreement_nm=_budget("agreement_of_rated") * rated_nm,
        torque_agreement_ratio=_budget("agreement_ratio"),
    )


def _tare(recipe: Recipe, bench: Bench, period_s: float) -> Tare:
    home, sensors = _step(recipe, Home), bench.sensors
    share = _budget("tare_spread_of_full_scale")
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
    stored = [item for item in bench.calibrations if item.model == recipe.unit_under_test.model]
    if recipe.measurement.calibration != "stored" or not stored:
        return line.slope, line.offset_nm
    newest = max(stored, key=lambda item: item.due)
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
        gain_per_s=_budget("gain_per_s"),
        window_nm=_budget("window_of_rated") * unit.rated_torque_nm,
        tolerance_nm=_budget("tolerance_of_rated") * unit.rated_torque_nm,
        rate_acceleration_s=_budget("rate_acceleration_s"),
        slew_nm_s=_budget("slew_of_peak_per_s") * limit_nm,
        torque_limit_nm=limit_nm,
        stiffness_nm_per_rad=stiffness / unit.ratio if at_input else stiffness,
    )


def compile_program(recipe: Recipe, bench: Bench) -> Program:
    """The program of a checked recipe on a bench; `recipes.check` has found nothing against the pair."""
    period_s = recipe.sampling.period_ns * 1e-9
    segments = _segments(recipe, bench, period_s)
    current_a = _step(recipe, LockStep).holding_torque_nm / bench.brake.torque_constant_nm_per_a
    release = _step(recipe, ReleaseStep)
    unload_nm_s = _step(recipe, Unload).torque_rate_nm_s
    peak_nm = max(abs(segment.target_nm) for segment in segments)

    def scans(budget: str) -> int:
        return math.ceil(_budget(budget) / period_s)

    return Program(
        name=recipe.recipe.name,
        period_s=period_s,
        loading_input=recipe.loading == "input",
        ratio=recipe.unit_under_test.ratio,
        has_torque_in=bench.sensors.torque_in is not None,
        has_torque_out=bench.sensors.torque_out is not None,
        segments=segments,
        unload_segment=len(segments) - 1,
        limits=_limits(recipe, period_s),
        tare=_tare(recipe, bench, period_s),
        lock=Lock(
            current_a=current_a,
            tolerance_a=_budget("brake_tolerance_of_current") * current_a,
            settle_scans=math.ceil(_budget("settle_of_time_constant") * bench.brake.time_constant_s / period_s),
            limit_scans=scans("lock_current_s"),
        ),
        control=_control(recipe, bench),
        release_torque_nm=release.max_torque_nm,
        ready_scans=scans("ready_s"),
        enable_scans=scans("enable_s"),
        homing_scans=scans("homing_s"),
        mode_scans=scans("mode_s"),
        release_scans=scans("release_s"),
        unload_limit_scans=math.ceil((peak_nm / unload_nm_s * 3.0 + _budget("ramp_limit_extra_s")) / period_s),
        settle_scans=scans("settle_s"),
    )
