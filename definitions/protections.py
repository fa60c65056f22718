"""What protects people and units: of the drive and of the bench, what proves each, and what happens without it.

One row per protection. The drive's rows name the ways in which a drive may have it, as profiles call them; of a drive
without it, the set-up, every result and its report say so. The page on safety is made of these rows.
"""

from __future__ import annotations

from typing import NamedTuple

NONE = "none"
"""Way of a protection that a drive does not have."""


class Protection(NamedTuple):
    """One protection. `ways`: name in a drive's profile and the objects that it means; empty for one of the bench.

    `proof`: what shows that it works. `without`: what happens then.
    """

    name: str
    meaning: str
    ways: tuple[tuple[str, str], ...]
    proof: str
    without: str

    @property
    def objects(self) -> str:
        """The objects of all its ways."""
        return " or ".join(objects for _, objects in self.ways)


# fmt: off
DRIVE_PROTECTIONS: tuple[Protection, ...] = (
    Protection("controller_heartbeat", "supervision of the controller's heartbeat",
               (("consumer_heartbeat", "0x1016:1"),),
               "Read back before every run. That the drive acts on it: `lostmotion bench watchdogs`, once",
               "A dead controller is noticed by the time-out of set-points alone"),
    Protection("setpoint_timeout", "time-out of set-points",
               (("rpdo_timeout", "0x1400:5"),),
               "Read back before every run. Some drives do not act on it: `lostmotion bench watchdogs`, once",
               "A scan that stands still is noticed by the controller's heartbeat alone"),
    Protection("drive_heartbeat", "heartbeat of the drive",
               (("producer_heartbeat", "0x1017"),),
               "Read back before every run; watched in every scan (drive_heartbeat_lost)",
               "A dead drive would be noticed by its missing process data alone"),
    Protection("abort_connection", "reaction to a lost controller",
               (("option_code", "0x6007"),),
               "Read back before every run. What the drive then does: `lostmotion bench watchdogs`, once",
               "The drive reacts to a lost controller in its own way, which the fault reaction or its maker decides"),
    Protection("quick_stop", "quick stop option",
               (("option_code", "0x605A"),),
               "Read back before every run",
               "How the drive ends its torque in a quick stop is its maker's choice"),
    Protection("fault_reaction", "fault reaction option",
               (("option_code", "0x605E"),),
               "Read back before every run",
               "How the drive ends its torque in a fault is its maker's choice"),
    Protection("torque_limit", "largest torque of the drive",
               (("max_torque", "0x6072"), ("torque_limits", "0x60E0 and 0x60E1"), ("max_current", "0x6073")),
               "Read back before every run",
               "A wrong set-point acts with all the torque of the motor; only the controller's interlocks limit it"),
    Protection("speed_limit", "largest speed of the drive",
               (("max_motor_speed", "0x6080"),),
               "Read back before every run",
               "A motor whose shaft is free runs as fast as it can until the controller's interlock stops it"),
    Protection("torque_slope", "largest change of torque in the drive",
               (("torque_slope", "0x6087"),),
               "Read back before every run",
               "A jump of the set-point is a jump of the torque; only the controller's rate limits it"),
    Protection("follows_command", "the drive says that it follows the set-point",
               (("status_bit_12", "0x6041 bit 12"),),
               "Watched in every scan in which a torque or speed is ordered (drive_not_following); not while the"
               " lock is verified",
               "A drive that is enabled and ignores its set-point is noticed by the torque that does not come, as"
               " late as the longest time of a ramp"),
)
"""What the drive itself enforces or tells, also when this program is dead."""
# fmt: on

BY_NAME = {row.name: row for row in DRIVE_PROTECTIONS}

NOT_TRIED = "this profile was not tried on hardware"
"""What is said of a profile that was written from a drive's documents alone."""

UNPROVEN = (
    "not measured: whether this drive removes its torque when the control program fails. Its settings were read "
    "back, but some drives do not act on them. Measure it once: lostmotion bench watchdogs."
)
"""What every result says of a bench on real wires, where nobody knows what the drive does."""

MISSING = "protection missing: "
"""How the note of a result begins that names a protection which the bench's drive does not have."""


def missing_text(protection: Protection) -> str:
    """Return what a result says of a protection that the drive does not have."""
    return (
        f"{MISSING}{protection.meaning} (object {protection.objects} of the drive). Without it: {protection.without}."
    )


# fmt: off
WITHOUT_INTERLOCK: dict[str, str] = {
    "estop": "Safe torque off, wired in hardware, still removes the torque; set-points would continue",
    "guard_open": "Only hardware wired to the guard stops the drive; a ramp would continue with the guard open",
    "operator_quick_stop": "Only the emergency stop is left for a person to stop the bench",
    "can_lost": "The drive stops by itself when set-points and heartbeat are missing (drive objects 0x1400:5, 0x1016)",
    "drive_heartbeat_lost": "A drive that lost its power shows as missing process data (drive_data_stale)",
    "drive_data_stale": "Angle and torque from the drive no longer change, unnoticed; its heartbeat may continue",
    "amplifier_lost": "Torque and angle no longer change; the interlock for their age reacts (sample_stale)",
    "sample_stale": "The torque control uses an old value: torque rises until a limit of the drive stops it (0x6072)",
    "sample_frozen": "Torque rises to the limit of the drive: answers look new, but repeat an old torque value",
    "brake_link_lost": "An open lock is detected only when the locked shaft turns (lock_slip)",
    "remote_io_lost": "Emergency stop and guard are no longer read; only their hardware wiring reacts",
    "drive_fault": "The drive removes its torque by itself; the run would wait for a torque that never comes",
    "drive_emergency": "The run continues; only the drive's own reaction to its error is left",
    "drive_dropped_out": "Set-points continue; when the drive is enabled again, the torque jumps",
    "drive_mode_refused": "The drive would read a torque set-point as a speed, or ignore it",
    "drive_internal_limit": "The torque lags behind the ramp; the validity checks reject the wrong measurement",
    "torque_out_trip": "Only the torque limits of the drive are left (0x6072); the unit may not withstand them",
    "torque_in_trip": "Only the torque limits of the drive at the loaded shaft are left (0x6072)",
    "torque_out_alarm": "The torque may rise further, to its trip limit",
    "overspeed": "Only the speed limit of the drive is left (0x6080)",
    "over_travel": "Only the speed limit is left; if a coupling is broken, the motor keeps turning",
    "lock_slip": "The locked shaft turns under load and the torque falls; the validity checks reject the run",
    "brake_current_lost": "An open lock is detected only when the locked shaft turns (lock_slip)",
    "housing_temperature": "The unit exceeds the temperature of its lubricant, and its stiffness changes",
    "missed_periods": "The drive keeps its old set-point for longer; only the drive's time-out is left (0x1400:5)",
    "sensor_not_a_number": "The torque control has no valid torque; only the limits of the drive are left",
    "sensor_saturated": "The true torque is above the measured torque, and the torque control continues",
    "torque_channels_disagree": "With a frozen sensor value, the torque rises to the limit of the drive (0x6072)",
    "sample_late": "A ramp continues while samples are late, until they are too old (sample_stale)",
    "brake_stays_closed": "The lock counts as open while it holds a wound-up unit, and a person may reach in",
    "sample_not_ready": "Values of a sensor that is switched off or in calibration count as measured",
    "drive_not_following": "Detected only when a ramp does not reach its torque within its longest time",
    "angle_channels_disagree": "The angle sensor's slip makes the stiffness wrong; validity checks reject most runs",
    "other_controller": "The drive follows whoever spoke last; its own limits are left, and validity checks of the run",
}
"""What happens without each interlock of the controller, by its id: what is left then."""
# fmt: on
