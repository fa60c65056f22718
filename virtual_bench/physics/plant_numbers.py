"""The numbers that the plant works on, by name: parameters, controls, state and the table of sensors.

All stand in one float64 array. `P`, `C` and `S` name the elements of its parts, `CH` the columns of the table of
sensors. Suffixes give the unit; `driven` is the shaft that the servo turns, `locked` the one that the brake holds.
"""

from __future__ import annotations

from enum import IntEnum
from math import pi
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

ARCMIN_RAD = pi / 10800.0
"""One arc minute in rad."""

STEP_NS = 25_000
"""Inner step. The stiffest mode (a reversal, where Dahl and LuGre bristles act together) is near 3000 rad/s."""

SAMPLE_NS = 100_000
"""Sampling period of the measuring amplifier: all channels are latched together."""

STEPS_PER_SAMPLE = SAMPLE_NS // STEP_NS

SEEN_COUNTS, SEEN_VALUES = 4, 5
"""What a look at the plant writes down. Counts: the motor's torque, position and speed in counts of the drive, and the
bits of saturated torques. Values: not 0 when a limit has acted, then torques [N·m] and angles [rad] of the channels."""

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


class Parts(NamedTuple):
    """The parts of a plant's numbers, none of them a copy; `channels` has a row for each channel."""

    state: FloatArray
    control: FloatArray
    params: FloatArray
    channels: FloatArray
    table: FloatArray  # elastic torque over the wind-up [N·m]


def parts_of(numbers: FloatArray) -> Parts:
    """Share a plant's numbers out."""
    return Parts(
        numbers[:STATE_END],
        numbers[STATE_END:CONTROL_END],
        numbers[CONTROL_END:PARAMS_END],
        numbers[PARAMS_END:CHANNELS_END].reshape(CHANNEL_COUNT, len(CH)),
        numbers[CHANNELS_END:],
    )
