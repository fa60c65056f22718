"""The fault table: what can go wrong, how hard the bench reacts, and what a person reads and does.

One row per fault. One with states is an interlock, looked at in every scan of them (`controller.interlocks`); the
others are raised by steps that wait for something. A row with a limit brings the recipe's option, the limit in the
program, and its test in every scan: an interlock that holds a channel against a limit is a row here, and no more.
Numbers are recorded (bit n of `alarms`) and printed in reports: they are never reused.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from definitions.image import Reaction, State
from definitions.states import LOADED, LOCKED, RUNNING
from definitions.units import ANGLE, NUMBER, PERIOD, SPEED, TEMPERATURE, TORQUE, TRAVEL, Kind, Range


class Beyond(Enum):
    """When a channel is beyond its limit."""

    MAGNITUDE = "its magnitude is larger"
    ABOVE = "it is larger"
    AGE = "it is larger, less the periods that the controller itself missed: nobody asked the devices then"


class Limit(NamedTuple):
    """The limit of an interlock: an option of the recipe, and what is held against it.

    `option` is the attribute of the recipe's section `interlocks`, with its unit; `range` is in the unit that people
    see, `default` in that of the attribute (None: a recipe must set it). `of_rated`: it may be written in percent of
    the rated torque. `name` is what the program calls it where that differs: ages and times become scans there.

    `channel` is held against the limit in every scan: a value that `controller.conditions.Measured` has, tared, or one
    of the image. Without a channel `controller.conditions` has a test of its own. `age` is the channel with the age of
    the device's values, where a value means nothing before the first of them.
    """

    option: str
    kind: Kind
    range: Range
    default: float | None = None
    of_rated: bool = False
    name: str = ""
    channel: str = ""
    beyond: Beyond = Beyond.MAGNITUDE
    age: str = ""

    @property
    def in_program(self) -> str:
        """Name in `definitions.program.Limits`."""
        return self.name or self.option

    @property
    def in_scans(self) -> bool:
        """Whether the option is a time, which becomes scans in the program."""
        return self.in_program.endswith("_scans")

    @property
    def whole(self) -> bool:
        """Whether the limit is a whole number in the program."""
        return self.in_scans or self.kind is NUMBER


class Time(NamedTuple):
    """A debounce that is a time: scans would be another time in every recipe.

    `limit` is a number of scans of the program's limits, `at_most_ms` bounds it; without `limit` the time is fixed. A
    time is counted up by each scan with the condition and down by each without: a sensor that is right now and then is
    still wrong. `starts_anew`: the first good scan disproves the condition, and the count starts from zero.
    """

    text: str
    at_most_ms: float | None = None
    limit: str = ""
    starts_anew: bool = False


class Fault(NamedTuple):
    """Row of the fault table.

    `number` is 1..63, `id` its name in records, `reaction` what the bench does, `debounce_scans` for how many scans in
    a row the condition may hold before it counts (0: it counts at once, or after `time`), `text` what happened, `cause`
    the usual reasons, `next_action` what the person does next. `live_in` are the states in which the interlock is
    looked at; a fault without any is raised by steps only.
    """

    number: int
    id: str
    reaction: Reaction
    debounce_scans: int
    text: str
    cause: str
    next_action: str
    live_in: frozenset[State] = frozenset()
    limit: Limit | None = None
    time: Time | None = None


R = Reaction
S = State
ALWAYS = RUNNING | {S.FAULT}

TORQUES = Range(0.0, 20_000.0, beyond_least=True)
AGES = Range(0.0, 10_000.0, beyond_least=True)
SAMPLES_BAD_MS = 20.0
"""Bad samples are borne no longer than this, however old the recipe lets good ones grow."""

WRONG_DIRECTION = "If the bench is new, a direction may be set wrong: run lostmotion bench direction"
"""What the faults say that a wrong sign of motor, torque or angle causes at the first start of a bench."""

# fmt: off
FAULTS: tuple[Fault, ...] = (
    # --- people first
    Fault(1, "estop", R.POWER_OFF, 0, "Emergency stop pressed",
          "The emergency stop chain is open",
          "Make the bench safe, release the emergency stop, then acknowledge",
          live_in=ALWAYS),
    Fault(2, "guard_open", R.QUICK_STOP, 0, "Guard opened",
          "The guard switch reports open while torque may be present",
          "Close the guard, then acknowledge",
          live_in=ALWAYS),
    Fault(3, "operator_quick_stop", R.QUICK_STOP, 0, "Quick stop by the operator",
          "The operator asked for a quick stop",
          "Look at the unit before the next run: torque may still be stored in it",
          live_in=ALWAYS | {S.IDLE}),
    # --- connections
    Fault(4, "can_lost", R.POWER_OFF, 0, "CAN bus lost",
          "The CAN interface is gone, or cannot send",
          "Check the CAN adapter, its cable and the terminating resistors",
          live_in=ALWAYS),
    Fault(5, "drive_heartbeat_lost", R.POWER_OFF, 0, "Servo drive silent: its heartbeat stopped",
          "Drive without power, cable broken, or drive firmware stopped",
          "Check the drive's supply, status LEDs and CAN plug",
          live_in=ALWAYS,
          limit=Limit("drive_heartbeat_s", PERIOD, AGES, 0.1, name="heartbeat_scans",
                channel="drive_heartbeat_age_scans", beyond=Beyond.AGE)),
    Fault(6, "drive_data_stale", R.POWER_OFF, 0, "Servo drive sends no process data",
          "Drive left its operational state, or messages are lost on the CAN bus",
          "Check the drive's CANopen (NMT) state and the CAN bus for errors",
          live_in=ALWAYS,
          limit=Limit("drive_age_s", PERIOD, AGES, 0.02,
                name="drive_stale_scans", channel="drive_age_scans", beyond=Beyond.AGE)),
    Fault(7, "amplifier_lost", R.QUICK_STOP, 0, "Connection to the measuring amplifier lost",
          "Network cable, amplifier without power, or connection closed by the amplifier",
          "Check the amplifier's supply and network cable",
          live_in=ALWAYS),
    Fault(8, "sample_stale", R.QUICK_STOP, 0, "No fresh torque and angle samples",
          "The measuring amplifier answers late, not at all, or with the same sample again and again",
          "Check the amplifier's network cable. If its replies come in time, restart the amplifier",
          live_in=ALWAYS,
          limit=Limit("sample_age_s", PERIOD, AGES, 0.02,
                name="sample_stale_scans", channel="sample_age_scans", beyond=Beyond.AGE)),
    Fault(9, "sample_frozen", R.QUICK_STOP, 0, "Torque and angle samples are frozen",
          "The amplifier answers, but its sample counter stands still",
          "Restart the measuring amplifier",
          live_in=RUNNING,
          # one new sample says that the counter does not stand, however rarely an amplifier has one
          time=Time("`sample_age`", SAMPLES_BAD_MS, "sample_stale_scans", starts_anew=True)),
    Fault(10, "brake_link_lost", R.UNLOAD, 0, "Connection to the brake supply lost",
          "Network cable, brake supply without power, or wrong address",
          "Check the brake supply and its cable. The lock brake may be open",
          live_in=ALWAYS,
          limit=Limit("brake_age_s", PERIOD, AGES, 0.1,
                name="brake_stale_scans", channel="brake_age_scans", beyond=Beyond.AGE)),
    Fault(11, "remote_io_lost", R.QUICK_STOP, 0, "Connection to the remote I/O lost: emergency stop and guard unknown",
          "Network cable, remote I/O without power, or wrong address",
          "Check the remote I/O and its cable",
          live_in=ALWAYS,
          limit=Limit("io_age_s", PERIOD, AGES, 0.1, name="io_stale_scans", channel="io_age_scans", beyond=Beyond.AGE)),
    # --- drive
    Fault(12, "drive_fault", R.POWER_OFF, 0, "Servo drive reports a fault",
          "The drive's own protection acted; its emergency code says which one",
          "Read the emergency code, remove its cause, acknowledge, then reset the drive",
          live_in=ALWAYS),
    Fault(13, "drive_emergency", R.QUICK_STOP, 0, "Servo drive sent an emergency message",
          "The drive reported an error that did not stop it",
          "Look the emergency code up in the alarm list and remove its cause",
          live_in=ALWAYS),
    Fault(14, "drive_dropped_out", R.POWER_OFF, 0, "Servo drive left operation by itself",
          "Safe torque off, main contactor, or a limit inside the drive",
          "Check the safety relay and the drive's power stage",
          live_in=RUNNING),
    Fault(15, "drive_mode_refused", R.QUICK_STOP, 0, "Servo drive did not change to the mode of operation",
          "Drive does not support the mode, or another program switched it",
          "Check in object 0x6502 which modes the drive supports, and that no other program is connected to it",
          live_in=RUNNING),
    Fault(16, "drive_internal_limit", R.UNLOAD, 0, "Servo drive is at an internal limit",
          "Torque or speed limit in the drive is active: the drive cannot follow the ramp",
          "Compare the peak torque of the recipe with the torque and speed limits of the drive (objects 0x6072, "
          "0x6080)",
          live_in=RUNNING,
          limit=Limit("internal_limit_s", PERIOD, AGES, 0.05, name="internal_limit_scans"),
          time=Time("`internal_limit` of the recipe", limit="internal_limit_scans")),
    Fault(17, "drive_enable_timeout", R.POWER_OFF, 0, "Servo drive could not be enabled",
          "Drive not ready: supply, safe torque off, or a pending fault",
          "Check main power and the safety relay, then start again"),
    Fault(18, "homing_failed", R.QUICK_STOP, 0, "Home position not found",
          "The drive refused or did not finish homing",
          "Check the homing method of the drive and its encoder"),
    # --- limits
    Fault(19, "torque_out_trip", R.QUICK_STOP, 0, "Output torque above its trip limit",
          "Overshoot, wrong torque ratio, or a jammed unit",
          "Inspect the unit; compare the limit with the peak torque of the recipe",
          live_in=ALWAYS,
          limit=Limit("torque_out_trip_nm", TORQUE, TORQUES, of_rated=True, channel="torque_out_nm")),
    Fault(20, "torque_in_trip", R.QUICK_STOP, 0, "Input torque above its trip limit",
          "Unit turns too heavily, or is jammed",
          "Inspect the unit: lubricant, preload, assembly",
          live_in=ALWAYS,
          limit=Limit("torque_in_trip_nm", TORQUE, TORQUES, channel="torque_in_nm")),
    Fault(21, "torque_out_alarm", R.HOLD, 2, "Output torque above its alarm limit",
          "Overshoot of a ramp, or an alarm limit too close to the peak torque",
          "Check the ramp rate and the alarm limit of the recipe",
          live_in=LOADED,
          limit=Limit("torque_out_alarm_nm", TORQUE, TORQUES, of_rated=True, channel="torque_out_nm")),
    Fault(22, "overspeed", R.QUICK_STOP, 2, "Loaded shaft turns too fast",
          "Lock open or slipping, coupling broken, or unit turns freely",
          "Check lock, couplings and unit",
          live_in=ALWAYS,
          limit=Limit("speed_rad_s", SPEED, Range(0.0, 6000.0, beyond_least=True), channel="speed_rad_s")),
    Fault(23, "over_travel", R.QUICK_STOP, 0, "Loaded shaft turned too far",
          "Lock slipping, coupling broken, a broken unit, or an angle sensor that jumps or counts backwards",
          "Check lock, couplings, unit and angle sensor; 'lostmotion recover' counts the angles from zero again",
          live_in=ALWAYS,
          limit=Limit("travel_rad", TRAVEL, Range(0.0, 36_000.0, beyond_least=True), channel="travel_rad")),
    Fault(24, "lock_slip", R.UNLOAD, 2, "Lock slipped: the locked shaft turned",
          "Lock brake too weak, worn or oily; clamping bolts loose",
          "Check the lock's clamping and the brake current before anything is measured on this bench",
          live_in=LOCKED,
          limit=Limit("lock_slip_rad", ANGLE, Range(0.0, 600.0, beyond_least=True))),
    Fault(25, "brake_current_lost", R.UNLOAD, 2, "Lock brake lost its current",
          "Brake supply switched off, wire broken, or supply limited",
          "Check the brake supply and its wiring",
          live_in=LOCKED | {S.FAULT}),
    Fault(26, "housing_temperature", R.UNLOAD, 10, "Unit's housing too warm",
          "Unit came warm from the line, or fatigue cycles heated it",
          "Let the unit cool down; results depend on temperature",
          live_in=ALWAYS,
          limit=Limit("housing_temperature_c", TEMPERATURE, Range(-40.0, 150.0),
                channel="housing_temp_c", beyond=Beyond.ABOVE, age="io_age_scans")),
    Fault(27, "missed_periods", R.UNLOAD, 0, "Controller program was late for too long",
          "Other programs kept the processor busy",
          "Close other programs, then check the timing of this computer: lostmotion doctor",
          live_in=RUNNING,
          limit=Limit("missed_in_a_row", NUMBER, Range(1.0, 1000.0), 40,
                channel="missed_periods", beyond=Beyond.ABOVE)),
    # --- plausibility
    Fault(28, "sensor_not_a_number", R.QUICK_STOP, 0, "A measured value is not a number",
          "Amplifier without sensor, broken cable, or wrong registers in the device profile",
          "Check sensor cables and the registers in the device profile",
          live_in=ALWAYS),
    Fault(29, "sensor_saturated", R.QUICK_STOP, 2, "Torque sensor saturated",
          "Torque beyond the measuring range, or a broken sensor cable",
          "Check the sensor's zero and the peak torque of the recipe",
          live_in=ALWAYS),
    Fault(30, "torque_channels_disagree", R.QUICK_STOP, 0, "Input and output torque do not agree",
          "A torque sensor is stuck or disconnected, a coupling is broken, the unit is jammed, or the ratio is wrong",
          "Check torque sensors, couplings and the recipe's ratio; a jammed unit stays wound up: turn it back by hand. "
          + WRONG_DIRECTION,
          live_in=LOCKED | {S.RELEASE, S.FAULT},
          time=Time("20 ms", 20.0)),
    # --- steps that did not end
    Fault(31, "devices_not_ready", R.POWER_OFF, 0, "Devices did not answer at the start",
          "A device is off, or its address is wrong",
          "Switch all devices on and check the bench file's addresses"),
    Fault(32, "tare_out_of_range", R.POWER_OFF, 0, "Zero offset of a torque sensor too large",
          "Unit still wound up, sensor overloaded, or mounted with strain",
          "Release the unit, check the sensor's zero, then start again"),
    Fault(33, "tare_unsteady", R.POWER_OFF, 0, "Torque sensor is not steady at rest",
          "Vibration, a loose cable, or somebody touches the bench",
          "Wait until the bench is at rest, check cables and shields"),
    Fault(34, "lock_not_closed", R.POWER_OFF, 0, "Lock brake did not reach its current",
          "Brake supply limited or wrong, or brake wiring open",
          "Check the brake supply's limit and wiring"),
    Fault(35, "lock_unproven", R.UNLOAD, 0, "Lock not verified: its test torque was not reached",
          "Lock open or slipping, coupling missing, or no unit on the bench",
          "Check that a unit is mounted, coupled and clamped. " + WRONG_DIRECTION),
    Fault(36, "target_not_reached", R.UNLOAD, 0, "Ramp did not reach its torque in time",
          "Unit slips, ramp too slow, or an alarm stopped the ramp",
          "Check the ramp's torque, rate and time limit in the recipe"),
    Fault(37, "calibration_failed", R.UNLOAD, 0, "Torque ratio could not be determined",
          "Too few points or no linear relation between input and output torque",
          "Check both torque sensors, then calibrate again"),
    Fault(38, "unload_failed", R.QUICK_STOP, 0, "Torque could not be brought to zero",
          "Drive cannot move the shaft back, or the torque sensor lost its zero",
          "The unit may hold energy: keep clear of its shafts, and release it as the bench maker's manual says"),
    Fault(39, "sample_late", R.HOLD, 0, "Torque and angle samples are late",
          "The measuring amplifier answered late",
          "If this is rare, do nothing; otherwise check the amplifier's network",
          live_in=LOADED),
    Fault(40, "brake_stays_closed", R.POWER_OFF, 0, "Lock brake did not open, or was closed before the start",
          "Brake supply does not switch off, or was switched on by hand",
          "Leave the lock closed: torque may be stored in the unit, and 'lostmotion recover' unloads it. Switch the "
          "brake supply off only after that, if it stays on",
          # a jog would wind up what a closed lock holds
          live_in=frozenset({S.HOME, S.JOG})),
    Fault(41, "sample_not_ready", R.QUICK_STOP, 0, "Measuring amplifier reports that its samples are not ready",
          "Amplifier in start-up, in calibration, or a sensor channel off",
          "Check the amplifier's display and sensor channels",
          live_in=ALWAYS,
          time=Time("half of `sample_age`", SAMPLES_BAD_MS, "sample_late_scans")),
    Fault(42, "drive_not_following", R.QUICK_STOP, 0, "Servo drive does not follow its set-point",
          "The drive ignores the cyclic set-points although it is enabled",
          "Check the drive's mode, its process data (PDO mapping), and that no other program sends set-points",
          live_in=LOADED | {S.UNLOAD, S.JOG},
          time=Time("10 ms", 10.0)),
    Fault(43, "angle_channels_disagree", R.QUICK_STOP, 0, "Drive and angle sensor of the loaded shaft do not agree",
          "Angle sensor stuck, drifting or slipping on its shaft, broken coupling, or wrong gear_ratio in the bench "
          "file",
          "Check the angle sensor, its mounting and the couplings; compare gear_ratio in the bench file with the "
          "type plate. "
          + WRONG_DIRECTION,
          # not in FAULT, nor during the recovery (`angles_compared`): a torque goes to zero there, by torque sensors
          # that watch each other, and a dead angle sensor must not stand against it
          live_in=LOCKED,
          time=Time("20 ms", 20.0)),
    Fault(46, "other_controller", R.POWER_OFF, 0, "Another controller commands on the CAN bus",
          "A set-point, a SYNC, an NMT command, a heartbeat of the controller or an SDO request that writes came from "
          "somebody else: another program, a hand-held tool or a second controller is connected",
          "Keep clear of the shafts: the drive may follow the other one. End the other program or disconnect it, then "
          "acknowledge",
          live_in=ALWAYS),
    # --- jog
    Fault(44, "enabling_device_stuck", R.QUICK_STOP, 0, "Enabling device pressed for too long",
          "Contact stuck, wire short-circuited, or the enabling device was tied down",
          "Release the enabling device; check that its contact opens in both end positions"),
    Fault(45, "jog_not_stopped", R.POWER_OFF, 0, "Shaft did not stop after a jog",
          "Drive does not follow the speed, or does not switch off",
          "Keep clear of the shaft; check the drive's status and its speed set-point before the next jog"),
)

# fmt: on

FAULT_BY_ID: dict[str, Fault] = {fault.id: fault for fault in FAULTS}
FAULT_BY_NUMBER: dict[int, Fault] = {fault.number: fault for fault in FAULTS}


LIMITS: tuple[Limit, ...] = tuple(fault.limit for fault in FAULTS if fault.limit)
"""The limits of interlocks that a recipe has options for."""


def bit_of(fault_id: str) -> int:
    """Return the bit of a fault in a mask of alarms; `KeyError` for one that is not in the table."""
    return 1 << FAULT_BY_ID[fault_id].number


def cause_among(alarms: int) -> Fault:
    """Return the fault that counts as the cause of those raised together: the most severe, of equals the lowest number.

    `alarms` is a bit mask, bit n for fault number n, with at least one fault of the table; else ValueError.
    """
    raised = (fault for fault in FAULTS if alarms >> fault.number & 1)
    return max(raised, key=lambda fault: (fault.reaction, -fault.number))
