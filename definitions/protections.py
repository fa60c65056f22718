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
               "Watched in every scan (drive_not_following)",
               "A drive that is enabled and ignores its set-point is noticed by the torque that does not come"),
)
"""What the drive itself enforces or tells, also when this program is dead."""
# fmt: on

BY_NAME = {row.name: row for row in DRIVE_PROTECTIONS}

NOT_TRIED = "not tried on hardware"
"""What is said of a profile that was written from a drive's documents alone."""

UNPROVEN = (
    "not measured: whether this drive removes its torque when the program dies. Its settings were read back; some "
    "drives hold"
    " them and do not act on them. Measure it once: lostmotion bench watchdogs."
)
"""What every result says of a bench on real wires, where nobody knows what the drive does."""

MISSING = "protection missing: "
"""How the note of a result begins that names a protection which the bench's drive does not have."""


def missing_text(protection: Protection) -> str:
    """Return what a result says of a protection that the drive does not have."""
    return f"{MISSING}{protection.meaning} ({protection.objects}). {protection.without}."
