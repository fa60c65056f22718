"""The jog of a bench: a program without a recipe, and the bench with as little speed and torque as a jog needs.

The drive gets its limits from the second: 0x6072 and 0x6080 are written and read back before every jog as before every
run, so that the drive holds speed and torque down by itself, whatever this program does.
"""

from __future__ import annotations

import math

from definitions.faults import LIMITS, Limit
from definitions.image import State
from definitions.program import Jog, Limits, Lock, Program, Segment, Tare, TorqueControl
from recipes.compiler.budgets import budget
from recipes.schema.bench_schema import Bench, JogSection

PERIOD_NS = 1_000_000
"""Scan period of a jog: the one of the shipped recipes."""

PERIOD_S = PERIOD_NS * 1e-9
ENABLING_DEVICE = "enabling_device"
"""Field that the profile of the remote I/O has where an enabling device is wired to it."""


def _scans(name: str) -> int:
    return math.ceil(budget(name) / PERIOD_S)


def jog_section(bench: Bench) -> JogSection:
    """Return the limits of a jog on this bench, those filled in that its file leaves out."""
    return bench.jog or JogSection()


def jog_speed_rad_s(bench: Bench) -> float:
    """Return the largest speed of a jog at the loaded shaft [rad/s]."""
    return jog_section(bench).max_speed_rad_s or budget("jog_speed_of_largest") * bench.max_loading_speed_rad_s


def jog_torque_nm(bench: Bench) -> float:
    """Return the largest torque of the servo in a jog at the loaded shaft [N·m]."""
    drive = bench.drive
    return jog_section(bench).max_torque_nm or budget("jog_torque_of_rated") * drive.rated_torque_nm * drive.gear_ratio


def jog_bench(bench: Bench) -> Bench:
    """Return the bench with a drive that has no more torque and speed than a jog."""
    drive = bench.drive
    slow = {
        "max_torque_nm": min(drive.max_torque_nm, jog_torque_nm(bench) / drive.gear_ratio),
        "max_speed_rad_s": min(
            drive.max_speed_rad_s, budget("jog_drive_speed_over_limit") * jog_speed_rad_s(bench) * drive.gear_ratio
        ),
    }
    return bench.model_copy(update={"drive": drive.model_copy(update=slow)})


def compile_jog(bench: Bench, speed_rad_s: float) -> Program:
    """Return the program of a jog at this speed of the loaded shaft, which is no larger than `jog_speed_rad_s`."""
    torque_nm = jog_torque_nm(bench)
    brake_a = budget("jog_brake_current") * bench.lock_brake.max_current_a
    return Program(
        name="jog",
        period_s=PERIOD_S,
        loading_input=bench.bench.loading == "input",
        ratio=1.0,
        has_torque_in=bench.sensors.torque_in is not None,
        has_torque_out=bench.sensors.torque_out is not None,
        segments=(_segment(0, State.IDLE, "none", 0.0), _segment(1, State.UNLOAD, "unload", torque_nm)),
        unload_segment=1,
        limits=_limits(bench, torque_nm),
        tare=Tare(1, *[math.inf] * 4),
        lock=Lock(current_a=0.0, tolerance_a=brake_a, settle_scans=1, limit_scans=1),
        control=_control(bench, torque_nm),
        release_torque_nm=torque_nm,
        ready_scans=_scans("ready_s"),
        enable_scans=_scans("enable_s"),
        homing_scans=_scans("homing_s"),
        mode_scans=_scans("mode_s"),
        release_scans=_scans("release_s"),
        unload_limit_scans=_scans("ramp_limit_extra_s"),
        settle_scans=_scans("settle_s"),
        jog=Jog(
            speed_rad_s=speed_rad_s,
            acceleration_rad_s2=speed_rad_s / budget("jog_start_s"),
            deceleration_rad_s2=speed_rad_s / budget("jog_ramp_down_s"),
            token_scans=_scans("jog_token_s"),
            longest_press_scans=math.ceil(jog_section(bench).longest_press_s / PERIOD_S),
            stop_scans=_scans("jog_stop_s"),
        ),
    )


def _limits(bench: Bench, torque_nm: float) -> Limits:
    """Return the limits of the interlocks: those of a jog where it has any, else what a recipe gets without asking."""
    sensors, trip = bench.sensors, budget("jog_torque_over_limit") * torque_nm
    share = budget("jog_torque_out_of_full_scale")
    own = {
        "torque_in_trip_nm": trip if sensors.torque_in and bench.bench.loading == "input" else math.inf,
        "torque_out_trip_nm": share * sensors.torque_out.full_scale_nm if sensors.torque_out else math.inf,
        "torque_out_alarm_nm": math.inf,
        "speed_rad_s": budget("jog_speed_over_limit") * jog_speed_rad_s(bench),
        "travel_rad": math.inf,
        "lock_slip_rad": math.inf,
        "housing_temperature_c": math.inf,
    }

    def limit(row: Limit) -> float:
        if row.option in own:
            return own[row.option]
        assert row.default is not None  # noqa: S101 - a test holds that every other row has one
        return max(1, round(row.default / PERIOD_S)) if row.in_scans else row.default

    limits: dict[str, float] = {row.in_program: limit(row) for row in LIMITS}
    return Limits(
        **limits,
        lock_proof_motion_rad=math.inf,
        sample_late_scans=max(2, round(limits["sample_stale_scans"]) // 2),
        torque_agreement_nm=math.inf,
        torque_agreement_ratio=budget("agreement_ratio"),
        angle_agreement_rad=math.inf,
        angle_lag_scans=0.0,
        coupling_rad_per_nm=0.0,
    )


def _control(bench: Bench, torque_nm: float) -> TorqueControl:
    """Return how torque would be controlled: a jog ramps none, and a reaction to its faults has no more than this."""
    return TorqueControl(
        controlled_from_input=bench.sensors.torque_out is None,
        measure_ratio=False,
        slope=1.0,
        offset_nm=0.0,
        gain_per_s=bench.torque_control.gain_per_s,
        window_nm=budget("window_of_rated") * torque_nm,
        tolerance_nm=budget("tolerance_of_rated") * torque_nm,
        rate_acceleration_s=budget("rate_acceleration_s"),
        slew_nm_s=budget("slew_of_peak_per_s") * torque_nm,
        torque_limit_nm=torque_nm,
        stiffness_nm_per_rad=1.0,
    )


def _segment(index: int, state: State, role: str, rate_nm_s: float) -> Segment:
    return Segment(
        index=index,
        state=state,
        role=role,
        direction=0,
        cycle=0,
        block=0,
        start_nm=0.0,
        target_nm=0.0,
        rate_nm_s=rate_nm_s,
        speed_rad_s=0.0,
        acceleration_rad_s2=0.0,
        dwell_scans=0,
        limit_scans=_scans("ramp_limit_extra_s"),
        planned_scans=0,
    )
