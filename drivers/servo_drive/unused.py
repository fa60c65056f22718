"""Protections that a drive has and its profile leaves out: their objects are read, and nothing is written.

A profile that leaves one out may be right: some drives hold an object and do not act on it. So this refuses nothing; it
says, before any power, what would otherwise be noticed when the watchdogs are measured.
"""

from __future__ import annotations

from typing import NamedTuple

from definitions.number_formats import IntegerType
from definitions.profiles.drive import DriveProfile
from definitions.protections import Protection
from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.servo_drive.objects import PROTECTIONS, missing_protections
from drivers.servo_drive.sdo import SdoFailure, SdoNode

SETPOINT_TIMEOUT = "setpoint_timeout"


class Missing(NamedTuple):
    """A protection that the profile leaves out. asked: whether it has objects that could be asked for.

    there: those by which the drive has it all the same, '' for none; entry: what the profile would then say of it.
    """

    protection: Protection
    asked: bool
    there: str
    entry: str

    @property
    def what(self) -> str:
        """What was found, a sentence."""
        meaning, objects = self.protection.meaning, self.protection.objects
        if self.there:
            return f"The drive has {self.there}, but its profile does not use it: {meaning}."
        return f"Protection missing: {meaning} (object {objects} of the drive)."

    def cure(self, profile: str) -> str:
        """Return what to do, a sentence; profile: its name."""
        if self.there:
            unless = f"Leave it out only if the drive holds {self.there} and does not act on it."
            return f"Write '{self.entry}' into profile {profile}. {unless}"
        return f"{self.protection.without}." if self.asked else "Compare the profile with the drive's manual."


def missing_on(link: CanLink, config: DriveConfig) -> list[Missing]:
    """Return what the profile leaves out, each with what the drive has of it."""
    node = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries)
    return [_missing(node, row, config.profile) for row in missing_protections(config.profile)]


def _missing(node: SdoNode, protection: Protection, profile: DriveProfile) -> Missing:
    asked = False
    for way, there in protection.ways:
        objects: list[tuple[int, int, IntegerType]]
        objects = [
            (row.index, row.subindex, row.type) for row in PROTECTIONS if (row.name, row.way) == (protection.name, way)
        ]
        entry = f"protections: {{{protection.name}: {way}}}"
        if protection.name == SETPOINT_TIMEOUT:
            objects, entry = [(0x1400 + profile.torque_pdo.number - 1, 5, "u16")], "timeout: true"
        asked |= bool(objects)
        if objects and all(_holds(node, *one) for one in objects):
            return Missing(protection, asked, there, entry)
    return Missing(protection, asked, "", "")


def _holds(node: SdoNode, index: int, subindex: int, kind: IntegerType) -> bool:
    try:
        node.read(index, subindex, kind)
    except SdoFailure:
        return False
    return True
