"""The inner step of the plant and its sensors, compiled by numba, and the names of the numbers they work on.

Lumped and quasi-static to a few hundred hertz. Semi-implicit: forces from the old positions, speeds, new positions,
then the reducer's torque. Dahl and LuGre friction use their closed forms on the monotone branch of one step, so a long
step is safe; the fixture in series with the reducer is solved by one Newton step whose remainder the next step takes.

Parameters, controls and state are one float64 array each; `P`, `C` and `S` name their elements. `CH` names the columns
of the table of sensors. Suffixes give the unit;
`driven` is the shaft that the servo turns, `locked` the one that the brake holds. Torques and angles inside the reducer
are written at the output, in N·m and arcmin, whichever side is driven. The names stand in this file because numba's
cache is renewed only when the file of the compiled function changes.
"""

from __future__ import annotations

from enum import IntEnum
from math import exp, floor, pi

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

ARCMIN_RAD = pi / 10800.0
"""One arc minute in rad."""

STEP_NS = 25_000
"""Inner step. The stiffest mode (a reversal, where Dahl and LuGre bristles act together) is near 3000 rad/s."""

SAMPLE_NS = 100_000
"""Sampling period of the measuring amplifier: all channels are latched together."""

STEPS_PER_SAMPLE = SAMPLE_NS // STEP_NS

NOISE_ROWS = 4096
"""Samples whose noise is drawn together; sample number n has row n modulo this of its block."""


class P(IntEnum):
    """Constants of one bench with one unit in it."""

    DRIVEN_RATIO = 0  # turns of the driven shaft per turn of the output
    LOCKED_RATIO = 1  # turns of the locked shaft per turn of the output
    DRIVEN_INERTIA_KGM2 = 2
    UNIT_INERTIA_KGM2 = 3  # the part of it behind the driven shaft's torque sensor
    LOCKED_INERTIA_KGM2 = 4
    LOCKED_DRAG_NMS_RAD = 5
    LOCKED_FRICTION_NM = 6  # what holds the locked shaft when the brake has no current
    FIXTURE_NM_ARCMIN = 7  # of the lock, seen from the output
    DAHL_STIFFNESS_NM_ARCMIN = 8
    DAHL_FORCE_NM = 9
    BRISTLE_STIFFNESS_NM_RAD = 10
    BRISTLE_DAMPING_NMS_RAD = 11
    VISCOUS_NMS_RAD = 12
    FRICTION_LOADING_NM = 13
    FRICTION_UNLOADING_NM = 14
    FRICTION_LOADING_PER_NM = 15  # per N·m of torque that arrives at the driven shaft
    FRICTION_UNLOADING_PER_NM = 16
    FRICTION_BEHIND_SENSOR = 17  # 1: the driven shaft's sensor feels the friction
    DRIFT_ARCMIN = 18
    DRIFT_TIME_S = 19
    BRAKE_NM_PER_A = 20
    BRAKE_TIME_S = 21
    BRAKE_HYSTERESIS = 22
    BRAKE_HOLDS = 23  # what is left of the brake's torque: 1 healthy
    GEAR_RATIO = 24  # motor turns per turn of the driven shaft
    TORQUE_LOOP_RAD_S = 25
    VELOCITY_P_NMS_RAD = 26
    VELOCITY_I_NM_RAD = 27
    VELOCITY_II_NM_RADS = 28
    LAG_TORQUE_DRIVEN_S = 29
    LAG_TORQUE_LOCKED_S = 30
    LAG_ANGLE_DRIVEN_S = 31
    LAG_ANGLE_LOCKED_S = 32
    TABLE_START_ARCMIN = 33
    TABLE_STEP_ARCMIN = 34
    TORQUE_UNIT_NM = 35  # motor torque of one count of the drive
    COUNTS_PER_RAD = 36  # motor
    COUNTS_S_PER_RAD_S = 37  # motor


class C(IntEnum):
    """What the drive and the brake supply tell the plant."""

    MODE = 0  # DriveLoop
    TORQUE_NM = 1  # motor
    VELOCITY_RAD_S = 2  # motor
    TORQUE_LIMIT_NM = 3  # motor
    SPEED_LIMIT_RAD_S = 4  # motor
    TORQUE_SLOPE_NM_S = 5  # motor
    BRAKE_CURRENT_A = 6


class DriveLoop(IntEnum):
    """Which of the drive's loops is closed."""

    OFF = 0
    TORQUE = 1
    VELOCITY = 2


class S(IntEnum):
    """What changes from step to step."""

    STEP = 0
    DRIVEN_RAD = 1
    DRIVEN_RAD_S = 2
    LOCKED_RAD = 3  # the lock's body, before the fixture's compliance
    LOCKED_RAD_S = 4
    WINDUP_ARCMIN = 5
    DAHL_NM = 6
    BRISTLE_RAD = 7
    TORQUE_NM = 8  # in the reducer, at the output
    MOTOR_NM = 9
    MOTOR_REFERENCE_NM = 10
    SPEED_ERROR_RAD = 11
    SPEED_ERROR_RADS = 12
    LAST_MODE = 13
    LIMITED = 14  # latched until somebody reads and clears it
    BRAKE_NM = 15
    BRAKE_LAST_A = 16
    BRAKE_RISING = 17
    LAG_TORQUE_DRIVEN_NM = 18
    LAG_TORQUE_LOCKED_NM = 19
    LAG_ANGLE_DRIVEN_RAD = 20
    LAG_ANGLE_LOCKED_RAD = 21
    SAMPLE_COUNTER = 22
    SAMPLE_TORQUE_DRIVEN_NM = 23
    SAMPLE_TORQUE_LOCKED_NM = 24
    SAMPLE_ANGLE_DRIVEN_RAD = 25
    SAMPLE_ANGLE_LOCKED_RAD = 26
    DRIFT_ARCMIN = 27


class CH(IntEnum):
    """Columns of the sensor table, one row per channel."""

    SOURCE = 0  # element of the state: of the latched sample
    GAIN = 1
    ZERO = 2
    NOISE = 3  # rms
    QUANTUM = 4
    LIMIT = 5  # saturates here; 0 never
    FAULT_OFFSET = 6
    STUCK = 7
    STUCK_AT = 8


CHANNEL_COUNT = 4
STATE_END = len(S)
CONTROL_END = STATE_END + len(C)
PARAMS_END = CONTROL_END + len(P)
CHANNELS_END = PARAMS_END + CHANNEL_COUNT * len(CH)
CHANNELS_SHAPE = (CHANNEL_COUNT, len(CH))


@njit(cache=True)
def parts_of(numbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return state, control, parameters, channels (a row each) and elastic table: parts of one array, not copies."""
    return (
        numbers[:STATE_END],
        numbers[STATE_END:CONTROL_END],
        numbers[CONTROL_END:PARAMS_END],
        numbers[PARAMS_END:CHANNELS_END].reshape(CHANNELS_SHAPE),
        numbers[CHANNELS_END:],
    )


DT = STEP_NS * 1e-9
OFF = int(DriveLoop.OFF)
VELOCITY = int(DriveLoop.VELOCITY)


Measured = tuple[float, float, float, float, int]
"""Torques [N·m] and angles [rad] of the channels in their order, and the bits of saturated torques."""

Seen = tuple[int, int, int, float, float, float, float, float, int]
"""Motor torque, position and speed in counts of the drive, not 0 when a limit has acted, and what is `Measured`."""


def _advance(state: FloatArray, params: FloatArray, control: FloatArray, table: FloatArray, steps: int) -> None:  # noqa: C901, PLR0912, PLR0915
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
    a_drift = 1.0 - exp(-DT / params[P.DRIFT_TIME_S])
    a_brake = 1.0 - exp(-DT / params[P.BRAKE_TIME_S])
    a_motor = 1.0 - exp(-DT * params[P.TORQUE_LOOP_RAD_S])
    a_torque_d = 1.0 - exp(-DT / params[P.LAG_TORQUE_DRIVEN_S])
    a_torque_l = 1.0 - exp(-DT / params[P.LAG_TORQUE_LOCKED_S])
    a_angle_d = 1.0 - exp(-DT / params[P.LAG_ANGLE_DRIVEN_S])
    a_angle_l = 1.0 - exp(-DT / params[P.LAG_ANGLE_LOCKED_S])
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
            z_new = z_end + (z - z_end) * exp(-s0 * abs(w) * DT / level)
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
        tangent = (table[cell + 1] - table[cell]) / table_step + sigma * (1.0 - f_h * side / f_c)
        moved = gap * k_fix / (k_fix + tangent)
        phi += moved
        f_h = side * f_c + (f_h - side * f_c) * exp(-sigma * abs(moved) / f_c)
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


advance_kernel = njit(cache=True)(_advance)


def _measure(state: FloatArray, channels: FloatArray, noise: FloatArray, row: int) -> Measured:
    """Return what the four channels show of the latched sample, and which torques are saturated.

    A row of `channels` gives an element of the sample its gain, zero, noise, saturation and quantum.
    """
    torque_in = torque_out = angle_in = angle_out = 0.0
    saturated = 0
    for channel in range(4):
        value = state[int(channels[channel, CH.SOURCE])] * channels[channel, CH.GAIN]
        value += channels[channel, CH.ZERO] + channels[channel, CH.NOISE] * noise[row, channel]
        value += channels[channel, CH.FAULT_OFFSET]
        limit = channels[channel, CH.LIMIT]
        if limit > 0.0 and abs(value) >= limit:
            value = limit if value > 0.0 else -limit
            saturated += 1 + channel
        quantum = channels[channel, CH.QUANTUM]
        if quantum > 0.0:
            value = floor(value / quantum + 0.5) * quantum
        if channels[channel, CH.STUCK] != 0.0:
            value = channels[channel, CH.STUCK_AT]
        if channel == 0:
            torque_in = value
        elif channel == 1:
            torque_out = value
        elif channel == 2:
            angle_in = value
        else:
            angle_out = value
    return torque_in, torque_out, angle_in, angle_out, saturated


measure_kernel = njit(cache=True)(_measure)


def _look(numbers: FloatArray, noise: FloatArray, steps: int) -> Seen:
    """Advance the plant, and return all that a scan looks at.

    One call with all `numbers` in one array, as `parts_of` shares it out: a call costs as much as five steps, and so do
    the arrays that it is given.
    """
    state, control, params, channels, table = parts_of(numbers)
    advance_kernel(state, params, control, table, steps)
    gear = params[P.GEAR_RATIO]
    torque_in, torque_out, angle_in, angle_out, saturated = measure_kernel(
        state, channels, noise, int(state[S.SAMPLE_COUNTER]) % NOISE_ROWS
    )
    return (
        int(np.rint(state[S.MOTOR_NM] / params[P.TORQUE_UNIT_NM])),
        int(np.rint(state[S.DRIVEN_RAD] * gear * params[P.COUNTS_PER_RAD])),
        int(np.rint(state[S.DRIVEN_RAD_S] * gear * params[P.COUNTS_S_PER_RAD_S])),
        state[S.LIMITED],
        torque_in,
        torque_out,
        angle_in,
        angle_out,
        saturated,
    )


look_kernel = njit(cache=True)(_look)
