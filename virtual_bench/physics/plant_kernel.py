"""The inner step of the plant and its sensors, as numba compiles it; `virtual_bench.physics.machine_code` has it run.

Lumped and quasi-static to a few hundred hertz. Semi-implicit: forces from the old positions, speeds, new positions,
then the reducer's torque. Dahl and LuGre friction use their closed forms on the monotone branch of one step, so a long
step is safe; the fixture in series with the reducer is solved by one Newton step whose remainder the next step takes.

Torques and angles inside the reducer are written at the output, in N·m and arcmin, whichever side is driven. Nothing
here may raise or allocate: what is compiled needs no Python beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor
from typing import Any

import numpy as np
from numba import carray, cfunc, njit, types  # type: ignore[attr-defined]
from numba.extending import register_jitable

from virtual_bench.physics import decay
from virtual_bench.physics.plant_numbers import (
    ARCMIN_RAD,
    CH,
    CHANNEL_COUNT,
    CHANNELS_END,
    CONTROL_END,
    NOISE_ROWS,
    PARAMS_END,
    SEEN_COUNTS,
    SEEN_VALUES,
    STATE_END,
    STEP_NS,
    STEPS_PER_SAMPLE,
    C,
    DriveLoop,
    FloatArray,
    P,
    S,
)

DT = STEP_NS * 1e-9
COLUMNS = len(CH)
OFF = int(DriveLoop.OFF)
VELOCITY = int(DriveLoop.VELOCITY)
register_jitable(decay.series)
decay_of: Callable[[float], float] = njit(error_model="numpy")(decay.decay_of)


@njit(error_model="numpy")
def advance(state: FloatArray, params: FloatArray, control: FloatArray, table: FloatArray, steps: int) -> None:  # noqa: C901, PLR0912, PLR0915
    """Advance the plant by `steps` inner steps, in place.

    `table` is the elastic torque over the wind-up [N·m].
    """
    n_d = params[P.DRIVEN_RATIO]
    n_l = params[P.LOCKED_RATIO]
    j_d = params[P.DRIVEN_INERTIA_KGM2]
    j_unit = params[P.UNIT_INERTIA_KGM2]
    j_l = params[P.LOCKED_INERTIA_KGM2]
    drag_l = params[P.LOCKED_DRAG_NMS_RAD]
    hold_l = params[P.LOCKED_FRICTION_NM]
    k_fix = params[P.FIXTURE_NM_ARCMIN]
    sigma = params[P.DAHL_STIFFNESS_NM_ARCMIN]
    f_c = params[P.DAHL_FORCE_NM]
    s0 = params[P.BRISTLE_STIFFNESS_NM_RAD]
    s1 = params[P.BRISTLE_DAMPING_NMS_RAD]
    s2 = params[P.VISCOUS_NMS_RAD]
    t_cl = params[P.FRICTION_LOADING_NM]
    t_cu = params[P.FRICTION_UNLOADING_NM]
    mu_l = params[P.FRICTION_LOADING_PER_NM]
    mu_u = params[P.FRICTION_UNLOADING_PER_NM]
    felt = params[P.FRICTION_BEHIND_SENSOR]
    drift_end = params[P.DRIFT_ARCMIN]
    k_b = params[P.BRAKE_NM_PER_A]
    brake_hysteresis = params[P.BRAKE_HYSTERESIS]
    brake_holds = params[P.BRAKE_HOLDS]
    gear = params[P.GEAR_RATIO]
    v_p = params[P.VELOCITY_P_NMS_RAD]
    v_i = params[P.VELOCITY_I_NM_RAD]
    v_ii = params[P.VELOCITY_II_NM_RADS]
    table_start = params[P.TABLE_START_ARCMIN]
    table_step = params[P.TABLE_STEP_ARCMIN]
    a_drift = 1.0 - decay_of(DT / params[P.DRIFT_TIME_S])
    a_brake = 1.0 - decay_of(DT / params[P.BRAKE_TIME_S])
    a_motor = 1.0 - decay_of(DT * params[P.TORQUE_LOOP_RAD_S])
    a_torque_d = 1.0 - decay_of(DT / params[P.LAG_TORQUE_DRIVEN_S])
    a_torque_l = 1.0 - decay_of(DT / params[P.LAG_TORQUE_LOCKED_S])
    a_angle_d = 1.0 - decay_of(DT / params[P.LAG_ANGLE_DRIVEN_S])
    a_angle_l = 1.0 - decay_of(DT / params[P.LAG_ANGLE_LOCKED_S])
    last = table.shape[0] - 2

    target_torque = control[C.TORQUE_NM]
    target_velocity = control[C.VELOCITY_RAD_S]
    torque_limit = control[C.TORQUE_LIMIT_NM]
    speed_limit = control[C.SPEED_LIMIT_RAD_S]
    slope_step = control[C.TORQUE_SLOPE_NM_S] * DT
    current = control[C.BRAKE_CURRENT_A]
    off = control[C.MODE] == OFF
    velocity_mode = control[C.MODE] == VELOCITY

    step = state[S.STEP]
    th = state[S.DRIVEN_RAD]
    w = state[S.DRIVEN_RAD_S]
    p = state[S.LOCKED_RAD]
    w_l = state[S.LOCKED_RAD_S]
    phi = state[S.WINDUP_ARCMIN]
    f_h = state[S.DAHL_NM]
    z = state[S.BRISTLE_RAD]
    torque = state[S.TORQUE_NM]
    motor = state[S.MOTOR_NM]
    reference = state[S.MOTOR_REFERENCE_NM]
    e1 = state[S.SPEED_ERROR_RAD]
    e2 = state[S.SPEED_ERROR_RADS]
    limited = state[S.LIMITED]
    brake = state[S.BRAKE_NM]
    drift = state[S.DRIFT_ARCMIN]
    lag_td = state[S.LAG_TORQUE_DRIVEN_NM]
    lag_tl = state[S.LAG_TORQUE_LOCKED_NM]
    lag_ad = state[S.LAG_ANGLE_DRIVEN_RAD]
    lag_al = state[S.LAG_ANGLE_LOCKED_RAD]

    if current != state[S.BRAKE_LAST_A]:
        state[S.BRAKE_RISING] = 1.0 if current > state[S.BRAKE_LAST_A] else -1.0
        state[S.BRAKE_LAST_A] = current
    brake_target = k_b * current * (1.0 - brake_hysteresis * state[S.BRAKE_RISING]) * brake_holds

    if velocity_mode and state[S.LAST_MODE] != VELOCITY:
        e1 = 0.0
        e2 = reference / v_ii  # takes over the torque that is there
    state[S.LAST_MODE] = control[C.MODE]

    in_sample = int(step) % STEPS_PER_SAMPLE
    for _ in range(steps):
        step += 1.0
        in_sample += 1
        brake += (brake_target - brake) * a_brake
        drift += (drift_end - drift) * a_drift

        if off:
            reference = 0.0
            motor = 0.0
        else:
            w_m = w * gear
            if velocity_mode:
                e0 = target_velocity - w_m
                wanted = v_p * e0 + v_i * e1 + v_ii * e2
                if -torque_limit < wanted < torque_limit:
                    e1 += e0 * DT
                    e2 += e1 * DT
            else:
                wanted = target_torque
            if wanted > torque_limit:
                wanted = torque_limit
                limited = 1.0
            elif wanted < -torque_limit:
                wanted = -torque_limit
                limited = 1.0
            if velocity_mode:
                reference = wanted
            else:
                reference += min(max(wanted - reference, -slope_step), slope_step)
            allowed = reference
            if w_m > speed_limit:
                allowed = min(reference, v_p * (speed_limit - w_m))
                limited = 1.0
            elif w_m < -speed_limit:
                allowed = max(reference, v_p * (-speed_limit - w_m))
                limited = 1.0
            motor += (allowed - motor) * a_motor

        # Friction of the driven shaft (LuGre, level by load and direction).
        load = torque / n_d
        level = (t_cl + mu_l * abs(load)) if w * load > 0.0 else (t_cu + mu_u * abs(load))
        if w != 0.0:
            z_end = level / s0 if w > 0.0 else -level / s0
            z_new = z_end + (z - z_end) * decay_of(s0 * abs(w) * DT / level)
        else:
            z_new = z
        friction = s0 * z_new + s1 * (z_new - z) / DT + s2 * w
        z = z_new

        acceleration = (motor * gear - friction - load) / j_d
        w += acceleration * DT
        th += w * DT

        # The locked shaft: held by Coulomb friction of the brake, slips above it, free when the brake is open.
        hold = brake + hold_l
        push = torque / n_l
        if w_l == 0.0:
            if push > hold:
                w_l = (push - hold) * DT / j_l
            elif push < -hold:
                w_l = (push + hold) * DT / j_l
            reaction = min(max(push, -hold), hold)
        else:
            side = 1.0 if w_l > 0.0 else -1.0
            reaction = hold * side + drag_l * w_l
            w_new = (w_l + (push - hold * side) * DT / j_l) / (1.0 + drag_l * DT / j_l)
            w_l = 0.0 if w_new * side <= 0.0 else w_new
        p += w_l * DT

        # The reducer: elastic table and Dahl hysteresis, in series with the fixture.
        gap = th / (n_d * ARCMIN_RAD) - p / (n_l * ARCMIN_RAD) - drift - phi - torque / k_fix
        side = 1.0 if gap >= 0.0 else -1.0
        at = (phi - table_start) / table_step
        cell = min(max(int(at), 0), last)
        tangent = (table[cell + 1] - table[cell]) / table_step + sigma * (1.0 - f_h / f_c * side)
        moved = gap * k_fix / (k_fix + tangent)
        phi += moved
        f_h = side * f_c + (f_h - side * f_c) * decay_of(sigma * abs(moved) / f_c)
        at = (phi - table_start) / table_step
        cell = min(max(int(at), 0), last)
        torque = table[cell] + (table[cell + 1] - table[cell]) * (at - cell) + f_h

        # Sensors: first-order lag, all latched together.
        lag_td += (torque / n_d + felt * friction + j_unit * acceleration - lag_td) * a_torque_d
        lag_tl += (reaction - lag_tl) * a_torque_l
        lag_ad += (th - lag_ad) * a_angle_d
        lag_al += (p + torque / k_fix * ARCMIN_RAD * n_l - lag_al) * a_angle_l
        if in_sample == STEPS_PER_SAMPLE:
            in_sample = 0
            state[S.SAMPLE_COUNTER] += 1.0
            state[S.SAMPLE_TORQUE_DRIVEN_NM] = lag_td
            state[S.SAMPLE_TORQUE_LOCKED_NM] = lag_tl
            state[S.SAMPLE_ANGLE_DRIVEN_RAD] = lag_ad
            state[S.SAMPLE_ANGLE_LOCKED_RAD] = lag_al

    state[S.STEP] = step
    state[S.DRIVEN_RAD] = th
    state[S.DRIVEN_RAD_S] = w
    state[S.LOCKED_RAD] = p
    state[S.LOCKED_RAD_S] = w_l
    state[S.WINDUP_ARCMIN] = phi
    state[S.DAHL_NM] = f_h
    state[S.BRISTLE_RAD] = z
    state[S.TORQUE_NM] = torque
    state[S.MOTOR_NM] = motor
    state[S.MOTOR_REFERENCE_NM] = reference
    state[S.SPEED_ERROR_RAD] = e1
    state[S.SPEED_ERROR_RADS] = e2
    state[S.LIMITED] = limited
    state[S.BRAKE_NM] = brake
    state[S.DRIFT_ARCMIN] = drift
    state[S.LAG_TORQUE_DRIVEN_NM] = lag_td
    state[S.LAG_TORQUE_LOCKED_NM] = lag_tl
    state[S.LAG_ANGLE_DRIVEN_RAD] = lag_ad
    state[S.LAG_ANGLE_LOCKED_RAD] = lag_al


@njit(error_model="numpy")
def measure(
    state: FloatArray, channels: FloatArray, noise: FloatArray, row: int
) -> tuple[float, float, float, float, int]:
    """Return what the four channels show of the latched sample, and which torques are saturated.

    A row of `channels` gives an element of the sample its gain, zero, noise, saturation and quantum.
    """
    torque_in = torque_out = angle_in = angle_out = 0.0
    saturated = 0
    for channel in range(CHANNEL_COUNT):
        first = channel * COLUMNS
        value = state[int(channels[first + CH.SOURCE])] * channels[first + CH.GAIN]
        value += channels[first + CH.ZERO] + channels[first + CH.NOISE] * noise[row, channel]
        value += channels[first + CH.FAULT_OFFSET]
        limit = channels[first + CH.LIMIT]
        if limit > 0.0 and abs(value) >= limit:
            value = limit if value > 0.0 else -limit
            saturated += 1 + channel
        quantum = channels[first + CH.QUANTUM]
        if quantum > 0.0:
            value = floor(value / quantum + 0.5) * quantum
        if channels[first + CH.STUCK] != 0.0:
            value = channels[first + CH.STUCK_AT]
        if channel == 0:
            torque_in = value
        elif channel == 1:
            torque_out = value
        elif channel == 2:
            angle_in = value
        else:
            angle_out = value
    return torque_in, torque_out, angle_in, angle_out, saturated


NUMBERS, COUNTS = types.CPointer(types.float64), types.CPointer(types.int64)  # type: ignore[no-untyped-call]


@cfunc(types.void(NUMBERS, types.int64, NUMBERS, types.int64, COUNTS, NUMBERS), error_model="numpy")
def look(numbers_at: Any, size: int, noise_at: Any, steps: int, counts_at: Any, values_at: Any) -> None:  # noqa: PLR0917 - C knows no names
    """Advance the plant by `steps`, and write down all that a scan looks at; of 0 steps it only looks.

    numbers_at: the plant's `size` numbers. noise_at: `NOISE_ROWS` rows of a standard normal number for each channel.
    counts_at, values_at: where `SEEN_COUNTS` and `SEEN_VALUES` go. All in one call without an array: a call costs as
    much as five steps.
    """
    numbers = carray(numbers_at, (size,))
    noise = carray(noise_at, (NOISE_ROWS, CHANNEL_COUNT))
    counts = carray(counts_at, (SEEN_COUNTS,))
    values = carray(values_at, (SEEN_VALUES,))
    state = numbers[:STATE_END]
    params = numbers[CONTROL_END:PARAMS_END]
    if steps > 0:
        advance(state, params, numbers[STATE_END:CONTROL_END], numbers[CHANNELS_END:], steps)
    gear = params[P.GEAR_RATIO]
    row = int(state[S.SAMPLE_COUNTER]) % NOISE_ROWS
    torque_in, torque_out, angle_in, angle_out, saturated = measure(state, numbers[PARAMS_END:CHANNELS_END], noise, row)
    counts[0] = int(np.rint(state[S.MOTOR_NM] / params[P.TORQUE_UNIT_NM]))
    counts[1] = int(np.rint(state[S.DRIVEN_RAD] * gear * params[P.COUNTS_PER_RAD]))
    counts[2] = int(np.rint(state[S.DRIVEN_RAD_S] * gear * params[P.COUNTS_S_PER_RAD_S]))
    counts[3] = saturated
    values[0] = state[S.LIMITED]
    values[1] = torque_in
    values[2] = torque_out
    values[3] = angle_in
    values[4] = angle_out
