"""A short program for the timelines: one calibration, one measured cycle, a few thousand scans."""

from __future__ import annotations

import math

from definitions.faults import LIMITS as TABLE
from definitions.image import State
from definitions.program import Limits, Lock, Program, Segment, Tare, TorqueControl

PEAK_NM = 453.2
ARCMIN = math.pi / 10800.0
S = State

# state, role, direction, cycle, start, target, rate [N·m/s], speed [rad/s], dwell [scans]
ROWS: tuple[tuple[State, str, int, int, float, float, float, float, int], ...] = (
    (S.IDLE, "none", 0, 0, 0.0, 0.0, 0.0, 0.0, 0),
    (S.LOCK, "proof", 1, 0, 0.0, 41.0, 400.0, 0.0, 0),
    (S.LOCK, "dwell", 0, 0, 41.0, 41.0, 0.0, 0.0, 100),
    (S.LOCK, "proof", -1, 0, 41.0, -41.0, 400.0, 0.0, 0),
    (S.LOCK, "proof", 1, 0, -41.0, 0.0, 400.0, 0.0, 0),
    (S.CALIBRATE, "calibrate", 1, 0, 0.0, PEAK_NM, 800.0, 0.0, 0),
    (S.CALIBRATE, "dwell", 0, 0, PEAK_NM, PEAK_NM, 0.0, 0.0, 50),
    (S.CALIBRATE, "calibrate", -1, 0, PEAK_NM, -PEAK_NM, 800.0, 0.0, 0),
    (S.CALIBRATE, "dwell", 0, 0, -PEAK_NM, -PEAK_NM, 0.0, 0.0, 50),
    (S.CALIBRATE, "calibrate", 1, 0, -PEAK_NM, 0.0, 800.0, 0.0, 0),
    (S.RAMP_POS, "virgin", 1, 0, 0.0, PEAK_NM, 800.0, 0.0, 0),
    (S.REVERSE, "dwell", 0, 0, PEAK_NM, PEAK_NM, 0.0, 0.0, 50),
    (S.RAMP_NEG, "measure", -1, 1, PEAK_NM, -PEAK_NM, 800.0, 0.0, 0),
    (S.REVERSE, "dwell", 0, 1, -PEAK_NM, -PEAK_NM, 0.0, 0.0, 50),
    (S.RAMP_POS, "measure", 1, 1, -PEAK_NM, PEAK_NM, 800.0, 0.0, 0),
    (S.REVERSE, "dwell", 0, 1, PEAK_NM, PEAK_NM, 0.0, 0.0, 50),
    (S.UNLOAD, "unload", -1, 0, PEAK_NM, 0.0, 800.0, 0.0, 0),
)


def limits(**given: float) -> Limits:
    """Limits of a program; those that a recipe may leave out are the table's, at a period of 1 ms, unless given."""
    rows = ((row, row.default) for row in TABLE if row.default is not None)
    left_out = {row.in_program: round(default * 1000) if row.in_scans else default for row, default in rows}
    return Limits(**left_out | given)


LIMITS = limits(
    torque_out_alarm_nm=470.0,
    torque_out_trip_nm=494.0,
    torque_in_trip_nm=5.4,
    speed_rad_s=6.28,
    travel_rad=1.05,
    lock_slip_rad=0.5 * ARCMIN,
    lock_proof_motion_rad=0.2 * ARCMIN,
    housing_temperature_c=60.0,
    sample_late_scans=5,
    sample_stale_scans=10,
    drive_stale_scans=10,
    heartbeat_scans=100,
    io_stale_scans=100,
    brake_stale_scans=100,
    missed_in_a_row=20,
    internal_limit_scans=50,
    torque_agreement_nm=103.0,
    torque_agreement_ratio=1.7,
    angle_agreement_rad=6.0 * ARCMIN,
    angle_lag_scans=1.0,
    coupling_rad_per_nm=0.0,
)


def short_program(*, from_input: bool = False, speed_rad_s: float = 0.0) -> Program:
    """Program of about 10 s; `speed_rad_s` turns the cycle's ramps into ramps at constant speed."""
    segments = []
    for index, (state, role, direction, cycle, start, target, rate, _, dwell) in enumerate(ROWS):
        by_speed = speed_rad_s > 0.0 and role in ("virgin", "measure")
        planned = dwell or (round(abs(target - start) / rate * 1000) + 150 if rate else 0)
        segments.append(
            Segment(
                index, state, role, direction, cycle, 1, start, target,
                0.0 if by_speed else rate, speed_rad_s if by_speed else 0.0, 2.0 if by_speed else 0.0,
                dwell, planned * 3 + 5000, planned,
            ),
        )  # fmt: skip
    control = TorqueControl(
        controlled_from_input=from_input,
        measure_ratio=from_input,
        slope=94.7,
        offset_nm=-13.9,
        gain_per_s=15.0,
        window_nm=8.24,
        tolerance_nm=2.06,
        rate_acceleration_s=0.15,
        slew_nm_s=11.0,
        torque_limit_nm=5.5,
        stiffness_nm_per_rad=100.0 / ARCMIN / 121.0,
    )
    return Program(
        name="short",
        period_s=1e-3,
        loading_input=True,
        ratio=121.0,
        has_torque_in=True,
        has_torque_out=True,
        segments=tuple(segments),
        unload_segment=len(segments) - 1,
        limits=LIMITS,
        tare=Tare(50, 0.05, 5.0, 0.05, 10.0),
        lock=Lock(6.0, 0.3, 100, 1000),
        control=control,
        release_torque_nm=8.24,
        ready_scans=200,
        enable_scans=200,
        homing_scans=500,
        mode_scans=100,
        release_scans=1000,
        unload_limit_scans=5000,
        settle_scans=50,
    )
