"""Programs of a few scans, and a bench whose every device may obey, lag, lie or fail in each scan.

Coarse time and a coarse lattice: one scan is one second, torques are whole N·m, the slope is 1 and rates are 1 N·m/s,
so that set-points take a handful of values and the whole space of states can be walked through.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from bench_model import READY
from programs import limits

from definitions.image import Command, DriveCommand, DriveMode, DriveState, Image, Orders, State
from definitions.jog import DIRECTIONS
from definitions.program import Jog, Lock, Program, Segment, Sweep, Tare, TorqueControl

S, D, C = State, DriveState, DriveCommand
PROOF_NM, PEAK_NM, TORQUE_LIMIT_NM, SLEW_NM, RELEASE_NM, WILD_NM = 1.0, 2.0, 2.0, 1.0, 1.0, 50.0
"""Whole numbers, so that torques stay whole; 1 N·m is low enough to open the lock, but not yet a small rest."""

OFFSET_NM = 0.4
"""Friction by the loading line: an unloading may lead the drive 2.5 times that past zero, which is 1 N·m."""

LOCK_A, LOCK_TOLERANCE_A = 6.0, 0.3
ZERO_NM = 0.125
"""What the output torque sensor shows at rest; a tare takes it away without rounding."""

# state, role, direction, start, target, dwell [scans]
ROWS: tuple[tuple[State, str, int, float, float, int], ...] = (
    (S.IDLE, "none", 0, 0.0, 0.0, 0),
    (S.LOCK, "proof", 1, 0.0, PROOF_NM, 0),
    (S.LOCK, "proof", -1, PROOF_NM, -PROOF_NM, 0),
    (S.LOCK, "proof", 1, -PROOF_NM, 0.0, 0),
    (S.CALIBRATE, "calibrate", 1, 0.0, PEAK_NM, 0),
    (S.CALIBRATE, "calibrate", -1, PEAK_NM, 0.0, 0),
    (S.RAMP_POS, "virgin", 1, 0.0, PEAK_NM, 0),
    (S.REVERSE, "dwell", 0, PEAK_NM, PEAK_NM, 1),
    (S.RAMP_NEG, "measure", -1, PEAK_NM, -PEAK_NM, 0),
    (S.REVERSE, "dwell", 0, -PEAK_NM, -PEAK_NM, 1),
    (S.RAMP_POS, "measure", 1, -PEAK_NM, PEAK_NM, 0),
    (S.REVERSE, "dwell", 0, PEAK_NM, PEAK_NM, 1),
    (S.REVERSE, "sweep", 0, PEAK_NM, PEAK_NM, 0),
    (S.UNLOAD, "unload", -1, PEAK_NM, 0.0, 0),
)
SWEEP = Sweep(amplitude_nm=0.0, from_hz=0.5, to_hz=0.5, period_scans=2, periods=1)
"""Its time, its holds and its end are walked. Without an amplitude, for a sine would leave the lattice of torques."""

LIMITS = limits(
    torque_out_alarm_nm=3.2, torque_out_trip_nm=4.2, torque_in_trip_nm=4.2, speed_rad_s=1.5, travel_rad=1.0,
    lock_slip_rad=0.2, lock_proof_motion_rad=0.1, housing_temperature_c=60.0, sample_late_scans=5,
    sample_stale_scans=10, drive_stale_scans=10, heartbeat_scans=100, io_stale_scans=100, brake_stale_scans=100,
    missed_in_a_row=2, internal_limit_scans=1, torque_agreement_nm=WILD_NM, torque_agreement_ratio=1.7,
    angle_agreement_rad=0.3, angle_lag_scans=0.0, coupling_rad_per_nm=0.0,
)  # fmt: skip
"""The two torque channels never disagree in the walks: each scan of their debounce would copy the space."""


JOG = Jog(
    speed_rad_s=1.0, acceleration_rad_s2=0.5, deceleration_rad_s2=0.5, token_scans=2, longest_press_scans=9,
    stop_scans=3,
)  # fmt: skip
"""Two scans to its speed and two back, so that there is a ramp."""


def small_program(*, by_speed: bool = False, loading_input: bool = True, jog: bool = False) -> Program:
    """A whole run in about fifty scans; `by_speed` makes the cycle's ramps run at constant speed. `jog`: no run."""
    segments = []
    for index, (state, role, direction, start, target, dwell) in enumerate(ROWS):
        speed = by_speed and role in ("virgin", "measure")
        ramp = role not in ("none", "dwell")
        segments.append(
            Segment(
                index, state, role, direction, 0, 1, start, target, 0.0 if speed or not ramp else 1.0,
                1.0 if speed else 0.0, 1.0 if speed else 0.0, dwell, dwell or 8, dwell or 4,
                SWEEP if role == "sweep" else None,
            ),
        )  # fmt: skip
    return Program(
        name="small", period_s=1.0, loading_input=loading_input, ratio=1.0, has_torque_in=True, has_torque_out=True,
        segments=tuple(segments), unload_segment=len(segments) - 1, limits=LIMITS,
        tare=Tare(1, 0.4, 0.4, 0.4, 0.4), lock=Lock(LOCK_A, LOCK_TOLERANCE_A, 1, 2),
        control=TorqueControl(
            controlled_from_input=False, measure_ratio=False, slope=1.0, offset_nm=OFFSET_NM, gain_per_s=1.0,
            window_nm=1000.0, tolerance_nm=0.25, rate_acceleration_s=1.0, slew_nm_s=SLEW_NM,
            torque_limit_nm=TORQUE_LIMIT_NM, stiffness_nm_per_rad=1.0,
        ),
        release_torque_nm=RELEASE_NM, ready_scans=2, enable_scans=5, homing_scans=1, mode_scans=1,
        release_scans=8, unload_limit_scans=8, settle_scans=1,
        jog=JOG if jog else None,
    )  # fmt: skip


NEXT_STATE = {
    (D.SWITCH_ON_DISABLED, C.SHUTDOWN): D.READY_TO_SWITCH_ON,
    (D.READY_TO_SWITCH_ON, C.SWITCH_ON): D.SWITCHED_ON,
    (D.SWITCHED_ON, C.ENABLE_OPERATION): D.OPERATION_ENABLED,
    (D.OPERATION_ENABLED, C.QUICK_STOP): D.QUICK_STOP_ACTIVE,
    (D.QUICK_STOP_ACTIVE, C.QUICK_STOP): D.SWITCH_ON_DISABLED,
    (D.FAULT, C.FAULT_RESET): D.SWITCH_ON_DISABLED,
}


Shown = tuple[tuple[str, float], ...]
"""What an image shows beside what the devices do: fields and their values."""


@dataclass(frozen=True)
class Choice:
    """What happens in one scan: what each device does, what the image shows beside, and what the operator wants."""

    name: str
    command: int = Command.NONE
    drive: str = "obeys"  # lags, drops (safe torque off), faults
    mode_lags: bool = False
    torque_stays: bool = False  # friction, or a stored rest
    brake_lags: bool = False
    homing: bool = True
    shown: Shown = ()


class BenchState(NamedTuple):
    """What the devices are, and the orders they have."""

    drive: int
    mode: int
    torque_out_nm: float
    brake_on: int
    orders: Orders


START = BenchState(D.SWITCH_ON_DISABLED, 0, 0.0, 0, Orders(*[0] * len(Orders._fields))._replace(state=S.IDLE))


class Devices(NamedTuple):
    """What the devices are once a scan's time has passed, and all of it that they show."""

    drive: int
    mode: int
    torque_out_nm: float
    brake_on: int
    motor_nm: float
    homing_attained: int
    speed_rad_s: float


def advance(bench: BenchState, choice: Choice) -> Devices:
    """Let one scan's time pass as `choice` says."""
    orders = bench.orders
    drive = bench.drive
    if choice.drive == "obeys":
        if orders.drive_command == C.DISABLE_VOLTAGE and drive != D.FAULT:
            drive = D.SWITCH_ON_DISABLED
        drive = NEXT_STATE.get((drive, orders.drive_command), drive)
    elif choice.drive == "drops":
        drive = D.SWITCH_ON_DISABLED if drive != D.FAULT else drive
    elif choice.drive == "faults":
        drive = D.FAULT
    mode = bench.mode if choice.mode_lags else orders.drive_mode
    brake_on = bench.brake_on if choice.brake_lags else orders.brake_on
    enabled = drive == D.OPERATION_ENABLED
    motor_nm = orders.drive_target_torque_nm if enabled and mode == DriveMode.CYCLIC_SYNC_TORQUE else 0.0
    torque_nm = bench.torque_out_nm
    if not brake_on:
        torque_nm = 0.0
    elif not choice.torque_stays:
        if enabled and mode == DriveMode.CYCLIC_SYNC_VELOCITY:
            torque_nm = min(PEAK_NM, max(-PEAK_NM, torque_nm + orders.drive_target_velocity_rad_s))
        else:
            torque_nm = motor_nm
    if mode == DriveMode.CYCLIC_SYNC_VELOCITY:
        motor_nm = torque_nm
    homing = int(choice.homing and enabled and orders.drive_command == C.START_HOMING)
    turns = enabled and mode == DriveMode.CYCLIC_SYNC_VELOCITY and not brake_on
    speed_rad_s = orders.drive_target_velocity_rad_s if turns else 0.0
    return Devices(drive, mode, torque_nm, brake_on, motor_nm, homing, speed_rad_s)


@cache
def look(devices: Devices, command: int, counter: int, shown: Shown) -> Image:
    """The image that a controller gets of the devices; there are few, so each is made once."""
    values: dict[str, Any] = {
        "command": command, "drive_state": devices.drive, "drive_mode": devices.mode,
        "drive_torque_nm": devices.motor_nm, "drive_homing_attained": devices.homing_attained,
        "drive_velocity_rad_s": devices.speed_rad_s,
        "torque_in_nm": devices.motor_nm, "torque_out_nm": devices.torque_out_nm + ZERO_NM, "sample_counter": counter,
        "brake_on": devices.brake_on, "brake_current_a": LOCK_A * devices.brake_on,
    }  # fmt: skip
    return READY._replace(**{**values, **dict(shown)})


WOUND_UP = START._replace(
    torque_out_nm=PEAK_NM, brake_on=1, orders=START.orders._replace(brake_on=1, brake_current_a=LOCK_A)
)
"""As a run before has left it: the lock holds a torque, and the brake supply keeps its order."""


STRONG: dict[str, dict[str, float]] = {
    "estop": {"estop_released": 0},
    "guard_open": {"guard_closed": 0},
    "brake_link_lost": {"links_lost": 4},
}
"""One condition per reaction; the other interlocks are probed from every place that is reached."""

PRESSED: Shown = (("enabling_device", 1),)

SILENT = {"drive": "lags", "mode_lags": True, "torque_stays": True, "brake_lags": True, "homing": False}


def choices() -> tuple[Choice, ...]:
    """Everything that may happen in one scan."""
    worlds: list[dict[str, Any]] = [
        {},
        {"torque_stays": True},
        dict(SILENT),
        {"shown": tuple(STRONG["estop"].items())},
        {"shown": tuple(STRONG["brake_link_lost"].items())},
    ]
    found = [
        Choice(f"{index}.{command.name}", command=command, **world)
        for index, world in enumerate(worlds)
        for command in Command
        if command not in DIRECTIONS
    ]
    wild = (("drive_torque_nm", WILD_NM),)
    single: dict[str, dict[str, Any]] = {
        "drive lags": {"drive": "lags"},
        "drive drops": {"drive": "drops"},
        "drive drops, torque stays": {"drive": "drops", "torque_stays": True},
        "drive faults": {"drive": "faults"},
        "mode lags": {"mode_lags": True},
        "brake lags": {"brake_lags": True},
        "no homing": {"homing": False},
        "a jog's key and enabling device": {"command": Command.JOG_POSITIVE, "shown": PRESSED},
        "guard opens": {"shown": tuple(STRONG["guard_open"].items())},
        "samples late": {"shown": (("sample_age_scans", 6),)},
        "drive reports a wild torque": {"shown": wild},
        "wild torque and brake link lost": {"shown": (*wild, *STRONG["brake_link_lost"].items())},
    }
    return (*found, *(Choice(name, **world) for name, world in single.items()))


LEFT_CHOICES = (
    Choice("left: samples late", torque_stays=True, shown=(("sample_age_scans", 6),)),
    Choice("left: lock without its current", torque_stays=True, shown=(("brake_current_a", 1.0),)),
)
"""What else may happen to a unit that stays wound up, and must keep its lock from being taken for proven."""


def jog_choices() -> tuple[Choice, ...]:
    """What else may happen in a jog: keys and enabling device in any order, and devices that fail under both."""
    held: dict[str, Any] = {"command": Command.JOG_POSITIVE, "shown": PRESSED}
    failing: dict[str, dict[str, Any]] = {
        "drive lags": {"drive": "lags"},
        "drive drops": {"drive": "drops"},
        "drive faults": {"drive": "faults"},
        "mode lags": {"mode_lags": True},
        "lock closes": {"shown": (*PRESSED, ("brake_current_a", LOCK_A))},
        "shaft turns on": {"shown": (*PRESSED, ("drive_velocity_rad_s", 1.0))},
        "guard opens": {"shown": (*PRESSED, *STRONG["guard_open"].items())},
        "periods missed": {"shown": (*PRESSED, ("missed_periods", 2))},
    }
    return (
        *(Choice(f"0.{Command(token).name}", command=token) for token in DIRECTIONS),
        *(Choice(f"device.{command.name}", command=command, shown=PRESSED) for command in Command),
        *(Choice(f"held, {name}", **{**held, **world}) for name, world in failing.items()),
        Choice("shaft turns on", shown=(("drive_velocity_rad_s", 1.0),)),
        Choice("device, drive lags", drive="lags", shown=PRESSED),
    )
