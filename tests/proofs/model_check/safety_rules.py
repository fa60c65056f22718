"""What the controller must never do, written down a second time and independently of its tables.

`CONDITIONS` says for every interlock how it shows, where it must be seen, how quickly, and how hard the bench must
react at least. `ALLOWED` says which states may follow each other, `RULES` names the rules that every walk checks.
"""

from __future__ import annotations

import math
from typing import NamedTuple, NoReturn

from controller.loading import Loading
from controller.preparation import Home
from definitions.image import AGE_NEVER, Command, DriveState, Link, NmtState, Orders, Reaction, State
from definitions.jog import JogPhase

S, R = State, Reaction
RUNNING = (S.HOME, S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD, S.RELEASE, S.JOG)
ALWAYS = (*RUNNING, S.FAULT)
LOCKED = (S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD)
LOADED = (S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG)


class Condition(NamedTuple):
    """A dangerous condition: how it shows in the image, where it must be seen, in how many scans, with what effect."""

    shown: dict[str, float]
    states: tuple[State, ...]
    within_scans: int
    reaction: Reaction
    established_in: tuple[State, ...] = ()
    """States in which it must be seen once they have established what it contradicts, see `ESTABLISHED`."""
    on_the_way_back: bool = True
    """Whether it must be seen after a reset too."""


ESTABLISHED: dict[State, tuple[int, ...]] = {
    S.HOME: (Home.HOMING, Home.TORQUE_MODE),
    S.LOCK: (Loading.RUN,),
    S.UNLOAD: (Loading.RUN,),
    S.JOG: (JogPhase.TURNING,),
}
"""Phases of a state in which the drive has been enabled, and the lock, if the state wants one, closed."""

CONDITIONS: dict[str, Condition] = {
    "estop": Condition({"estop_released": 0}, ALWAYS, 1, R.POWER_OFF),
    "guard_open": Condition({"guard_closed": 0}, ALWAYS, 1, R.QUICK_STOP),
    "operator_quick_stop": Condition({"command": Command.QUICK_STOP}, (S.IDLE, *ALWAYS), 1, R.QUICK_STOP),
    "can_lost": Condition({"links_lost": Link.CAN}, ALWAYS, 1, R.POWER_OFF),
    "other_controller": Condition({"links_lost": Link.CAN_SHARED}, ALWAYS, 1, R.POWER_OFF),
    "drive_heartbeat_lost": Condition({"drive_heartbeat_age_scans": 101}, ALWAYS, 1, R.POWER_OFF),
    "drive_data_stale": Condition({"drive_age_scans": 11}, ALWAYS, 1, R.POWER_OFF),
    "drive_data_stale (stopped)": Condition({"drive_nmt_state": NmtState.STOPPED}, ALWAYS, 1, R.POWER_OFF),
    "amplifier_lost": Condition({"links_lost": Link.AMPLIFIER}, ALWAYS, 1, R.QUICK_STOP),
    "sample_stale": Condition({"sample_age_scans": AGE_NEVER}, ALWAYS, 1, R.QUICK_STOP),
    "sample_late": Condition({"sample_age_scans": 6}, LOADED, 1, R.HOLD),
    "sample_frozen": Condition({"sample_counter": 7}, RUNNING, 4, R.QUICK_STOP),
    "brake_link_lost": Condition({"brake_age_scans": AGE_NEVER}, ALWAYS, 1, R.UNLOAD),
    "brake_link_lost (link)": Condition({"links_lost": Link.BRAKE}, ALWAYS, 1, R.UNLOAD),
    "remote_io_lost": Condition({"io_age_scans": AGE_NEVER}, ALWAYS, 1, R.QUICK_STOP),
    "remote_io_lost (link)": Condition({"links_lost": Link.REMOTE_IO}, ALWAYS, 1, R.QUICK_STOP),
    "drive_fault": Condition({"drive_state": DriveState.FAULT}, ALWAYS, 1, R.POWER_OFF),
    "drive_emergency": Condition({"drive_emcy_code": 0x8130}, ALWAYS, 1, R.QUICK_STOP),
    "drive_dropped_out": Condition(
        {"drive_state": DriveState.SWITCH_ON_DISABLED}, (S.LOCK, *LOADED), 1, R.POWER_OFF, (S.HOME, S.UNLOAD, S.JOG)
    ),
    "drive_mode_refused": Condition({"drive_mode": -1}, (S.LOCK, *LOADED), 3, R.QUICK_STOP, (S.UNLOAD, S.JOG)),
    "drive_internal_limit": Condition(
        {"drive_internal_limit": 1}, (S.LOCK, *LOADED), 2, R.UNLOAD, (S.HOME, S.UNLOAD, S.JOG)
    ),
    "torque_out_trip": Condition({"torque_out_nm": -4.5}, ALWAYS, 1, R.QUICK_STOP),
    "torque_in_trip": Condition({"torque_in_nm": 4.5}, ALWAYS, 1, R.QUICK_STOP),
    "torque_out_alarm": Condition({"torque_out_nm": -3.5}, LOADED, 3, R.HOLD),
    "overspeed": Condition({"drive_velocity_rad_s": -1.6}, ALWAYS, 3, R.QUICK_STOP),
    "over_travel": Condition({"angle_in_rad": -1.1}, ALWAYS, 1, R.QUICK_STOP),
    "lock_slip": Condition({"angle_out_rad": 0.3}, LOADED, 3, R.UNLOAD, (S.LOCK, S.UNLOAD)),
    "brake_current_lost": Condition({"brake_current_a": 1.0}, LOADED, 3, R.UNLOAD, (S.LOCK, S.UNLOAD)),
    "brake_current_lost (off)": Condition({"brake_on": 0}, LOADED, 3, R.UNLOAD, (S.LOCK, S.UNLOAD)),
    "housing_temperature": Condition({"housing_temp_c": 61.0}, RUNNING, 11, R.UNLOAD),
    "missed_periods": Condition({"missed_periods": 3}, RUNNING, 1, R.UNLOAD),
    "sensor_not_a_number": Condition({"torque_out_nm": math.nan}, ALWAYS, 1, R.QUICK_STOP),
    "sensor_not_a_number (in)": Condition({"torque_in_nm": math.inf}, ALWAYS, 1, R.QUICK_STOP),
    "sensor_saturated": Condition({"sample_status": 2}, ALWAYS, 3, R.QUICK_STOP),
    "sample_not_ready": Condition({"sample_status": 4}, ALWAYS, 3, R.QUICK_STOP),
    "drive_not_following": Condition({"drive_follows_command": 0}, LOADED, 3, R.QUICK_STOP, (S.UNLOAD, S.JOG)),
    "angle_channels_disagree": Condition(
        {"drive_angle_rad": 0.4}, (S.LOCK, *LOADED), 3, R.QUICK_STOP, (S.UNLOAD,), on_the_way_back=False
    ),
    "brake_stays_closed": Condition({"brake_on": 1, "brake_current_a": 6.0}, (S.HOME, S.JOG), 1, R.POWER_OFF),
}
"""Brake and drive conditions are asked for where what they contradict has been established."""

AGREEMENT_STATES = (*LOCKED, S.RELEASE, S.FAULT)
"""Where two torque channels that contradict each other must be seen; a small ramp is too short for it."""

ALLOWED: dict[State, tuple[State, ...]] = {
    S.IDLE: (S.HOME, S.JOG, S.STOPPED, S.FAULT),
    S.HOME: (S.LOCK, S.RELEASE, S.FAULT),
    S.LOCK: (S.CALIBRATE, S.RAMP_POS, S.UNLOAD, S.FAULT),
    S.CALIBRATE: (S.RAMP_POS, S.UNLOAD, S.FAULT),
    S.RAMP_POS: (S.REVERSE, S.UNLOAD, S.FAULT),
    S.REVERSE: (S.RAMP_POS, S.RAMP_NEG, S.UNLOAD, S.FAULT),
    S.RAMP_NEG: (S.REVERSE, S.UNLOAD, S.FAULT),
    S.UNLOAD: (S.RELEASE, S.FAULT),
    S.RELEASE: (S.COMPLETE, S.STOPPED, S.FAULT),
    S.COMPLETE: (S.IDLE,),
    S.STOPPED: (S.IDLE,),
    S.FAULT: (S.UNLOAD,),
    S.JOG: (S.STOPPED, S.FAULT),
}
"""States that may follow a state."""

RULES: tuple[str, ...] = (
    "no step raises",
    "states follow each other as designed",
    "no order enables the drive in fault but the controlled unload",
    "a quick stop or power off leaves no torque and no enabling order",
    "the lock opens only with the drive off and the torque proven low",
    "set-points stay within limits",
    "set-points stay within their slew",
    "no torque without a closed and proven lock, and a tare",
    "nothing is enabled without a start, nor after the end",
    "an unacknowledged fault never clears, nor one whose cause is there",
    "every condition is seen in time and has its reaction",
    "every state reaches its end, whatever the devices do",
    "a trip leads to fault from every state",
    "in a jog nothing turns without a key held and an enabling device pressed after it, nor with the lock closed",
)


WAITING_FOR_HANDS = (JogPhase.RELEASE_DEVICE, JogPhase.HOLD_KEY, JogPhase.PRESS_DEVICE)


def waits_for_hands(orders: Orders) -> bool:
    """Whether a jog waits for a person, with the drive off: that may last for ever."""
    return orders.state == S.JOG and orders.phase in WAITING_FOR_HANDS


class BrokenRuleError(AssertionError):
    """A rule of `RULES` does not hold."""

    def __init__(self, rule: str, found: str) -> None:
        super().__init__(rule, found)
        self.rule = rule

    def __str__(self) -> str:
        """The rule and what was found instead."""
        return ": ".join(self.args)


def broken(rule: int, found: str) -> NoReturn:
    """Raise `BrokenRuleError` for rule number `rule`."""
    raise BrokenRuleError(RULES[rule], found)


def require(rule: int, found: str, *, holds: bool) -> None:
    """Raise `BrokenRuleError` for rule number `rule` unless it holds."""
    if not holds:
        broken(rule, found)
