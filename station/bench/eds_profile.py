"""A drive profile drafted from the maker's EDS or DCF file, and what the drive lacks.

`canopen` reads the file. What an EDS tells is which objects a drive has, of which type and access, what may be mapped,
and defaults; not whether an object does what its name says. So a draft is marked as not tried, and what the file does
not tell is left open: a profile with an open place is refused wherever it is used.
"""

from __future__ import annotations

import math
import re
from configparser import Error as ConfigError
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

import canopen
from canopen import objectdictionary
from canopen.objectdictionary import datatypes

from definitions.number_formats import IGNORED, SIZES
from definitions.profiles.drive import OPTIONAL_OBJECTS, PDO_BYTES, RECEIVE_OBJECTS, TRANSMIT_OBJECTS
from definitions.protections import DRIVE_PROTECTIONS, MISSING, NONE, NOT_TRIED, missing_text
from drivers.servo_drive.objects import PROTECTIONS
from recipes import Problem, RecipeError

ENDINGS = (".eds", ".dcf")
OBJECTS = {
    "controlword": 0x6040,
    "mode": 0x6060,
    "target_torque": 0x6071,
    "target_velocity": 0x60FF,
    "statusword": 0x6041,
    "mode_display": 0x6061,
    "actual_torque": 0x6077,
    "actual_position": 0x6064,
    "actual_velocity": 0x606C,
    "error_register": 0x1001,
}
"""Objects that the scan exchanges with every drive, by their names in a profile; digital ones are added by hand."""

LAYOUT = {
    "receive": (("controlword", "mode", "target_torque"), ("target_velocity",)),
    "transmit": (
        ("statusword", "mode_display", "actual_torque", "error_register"),
        ("actual_position", "actual_velocity"),
    ),
}
"""What goes into which PDO where the drive lets itself be mapped."""

TYPES = {
    datatypes.INTEGER8: "i8",
    datatypes.INTEGER16: "i16",
    datatypes.INTEGER32: "i32",
    datatypes.UNSIGNED8: "u8",
    datatypes.UNSIGNED16: "u16",
    datatypes.UNSIGNED32: "u32",
}
TYPE_OF_BITS = {8: "u8", 16: "u16", 32: "u32"}

RPM = 0x00B44700
"""0x60A9 for revolutions per minute, without a power of ten (CiA 303-2)."""

RPM_PER_RAD_S = 60 / (2 * math.pi)
NODE_ID = 1
"""Node for which `$NODEID` of the file is computed; COB-IDs of a draft are those of the predefined connection set."""

NOT_NEEDED = re.compile(r"^\[(?:dummyusage|comments)\][^\[]*", re.IGNORECASE | re.MULTILINE)
"""Sections that many files have incomplete, and that say nothing of the drive."""

LOST_WITHOUT = {
    0x1018: "A run cannot detect that a different drive is connected",
    0x6076: "The unit of the drive's torque is not known",
    0x6502: "It is not known whether the drive has the cyclic modes",
}
"""Objects without which the set-up refuses a drive, and why."""


@dataclass
class Draft:
    """A drafted profile: its text, what the drive lacks, what the file does not tell, and why it cannot be used."""

    source: Path
    name: str
    text: str = ""
    lacks: list[str] = field(default_factory=list)
    open_places: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)


def eds_files(place: Path) -> list[Path]:
    """Return the EDS and DCF files of a folder and of all in it, or the one file that is named."""
    if place.is_dir():
        return sorted(path for path in place.rglob("*") if path.suffix.lower() in ENDINGS)
    return [place]


def read_eds(path: Path) -> objectdictionary.ObjectDictionary:
    """Return the object dictionary of an EDS or DCF file.

    Raises:
        RecipeError: the file cannot be read, or is no EDS.

    """
    try:
        text = StringIO(NOT_NEEDED.sub("", path.read_text(encoding="utf-8-sig", errors="replace")))
        text.name = path.name if path.suffix.lower() in ENDINGS else f"{path.name}.eds"
        found = canopen.import_od(text, NODE_ID)
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    except (ConfigError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise _unreadable(path, f"this is not an EDS file: {error}") from error
    if not len(found):
        raise _unreadable(path, "no parameters (objects) of a drive in this file")
    return found


def draft(path: Path) -> Draft:
    """Return the profile drafted from an EDS or DCF file; RecipeError when it cannot be read."""
    dictionary = read_eds(path)
    return _Drafting(path, dictionary).run()


def _unreadable(path: Path, found: str) -> RecipeError:
    return RecipeError(
        [Problem(str(path), 0, 0, "file", found, "an EDS or DCF file (CiA 306)", "Ask the drive's maker for it.")]
    )


class _Drafting:
    """One file on its way to a profile."""

    def __init__(self, path: Path, dictionary: objectdictionary.ObjectDictionary) -> None:
        self._od = dictionary
        name = re.sub(r"[^a-z0-9]+", "-", path.stem.lower()).strip("-") or "drive"
        self.draft = Draft(path, name)
        self._ways = {row.name: self._way(row.name) for row in DRIVE_PROTECTIONS}

    def run(self) -> Draft:
        """Draft every section, and say what is missing."""
        self._look_for_what_is_needed()
        receive = self._pdos("receive", 0x1400, 0x1600)
        transmit = self._pdos("transmit", 0x1800, 0x1A00)
        lines = [
            f"# Drafted from {self.draft.source.name}; {NOT_TRIED}. Compare every value with the drive's manual.",
            "profile:",
            f"  name: {self.draft.name}",
            "  kind: cia402-drive",
            f"  vendor_id: {self._identity(1, self._od.device_information.vendor_number)}",
            f"  product_code: {self._identity(2, self._od.device_information.product_number)}",
            "tried_on_hardware: false",
            *self._scaling(),
            f"homing_method: {37 if self._has(0x6098) else 0}",
            *self._protections(),
            "receive_pdos:",
            *receive,
            "transmit_pdos:",
            *transmit,
        ]
        self.draft.text = "\n".join(lines) + "\n"
        missing = [row for row in DRIVE_PROTECTIONS if self._ways[row.name] == NONE]
        self.draft.lacks = [missing_text(row).removeprefix(MISSING) for row in missing]
        if {"controller_heartbeat", "setpoint_timeout"} <= {row.name for row in missing}:
            self.draft.refused.append("Nothing in the drive notices a dead controller")
        return self.draft

    def _variable(self, index: int, subindex: int = 0) -> objectdictionary.ODVariable | None:
        found = self._od.get_variable(index, subindex) if index in self._od else None
        return found if isinstance(found, objectdictionary.ODVariable) else None

    def _has(self, index: int, subindex: int = 0) -> bool:
        return self._variable(index, subindex) is not None

    def _default(self, index: int, subindex: int = 0) -> int | None:
        found = self._variable(index, subindex)
        value = None if found is None else (found.value if found.value is not None else found.default)
        return value if isinstance(value, int) else None

    def _way(self, name: str) -> str:
        """Return the first way in which the drive has all objects of a protection."""
        if name == "setpoint_timeout":
            timer = self._variable(0x1400, 5)
            return "rpdo_timeout" if timer is not None and timer.writable else NONE
        if name == "follows_command":
            return "status_bit_12"
        ways: dict[str, list[bool]] = {}
        for row in PROTECTIONS:
            if row.name == name:
                ways.setdefault(row.way, []).append(self._has(row.index, row.subindex))
        return next((way for way, there in ways.items() if all(there)), NONE)

    def _look_for_what_is_needed(self) -> None:
        for index, why in LOST_WITHOUT.items():
            if index not in self._od:
                self.draft.refused.append(f"No object 0x{index:04X}. {why}")
        if self._ways["drive_heartbeat"] == NONE:
            self.draft.refused.append("No object 0x1017. Nothing would tell that the drive is dead")

    def _identity(self, subindex: int, told: int | None) -> str:
        value = self._default(0x1018, subindex) or told
        if value:
            return f"0x{value:08X}"
        what = "vendor id" if subindex == 1 else "product code"
        self.draft.open_places.append(
            f"The {what} (0x1018:{subindex}): the set-up refuses the drive and names what it read"
        )
        return f"0x00000000  # fill in: the {what}, 0x1018:{subindex}"

    def _scaling(self) -> list[str]:
        lines = [
            "scaling:",
            "  torque_counts_per_rated: 1000.0     # 0.1 % by CiA 402",
            "  rated_torque_counts_per_nm: 1000.0  # 0x6076 in mN·m by CiA 402; 1000000.0 where it is µN·m",
        ]
        increments, turns = self._default(0x608F, 1), self._default(0x608F, 2)
        if increments and turns:
            lines.append(f"  position_counts_per_motor_rev: {increments / turns!r}  # 0x608F, as delivered")
        else:
            self.draft.open_places.append(
                "The counts of 0x6064 per turn of the motor: in the drive's manual, or 0x608F"
            )
            lines.append("  # fill in: position_counts_per_motor_rev, the counts of 0x6064 per turn of the motor")
        if self._default(0x60A9) == RPM:
            lines.append(f"  velocity_counts_per_rad_s: {RPM_PER_RAD_S:.9f}  # rpm, by 0x60A9 as delivered")
        else:
            self.draft.open_places.append(
                "The counts of 0x606C per rad/s of the motor: in the drive's manual, or 0x60A9"
            )
            lines.append(
                "  # fill in: velocity_counts_per_rad_s, the counts of 0x606C per rad/s; 9.549296586 where they are rpm"
            )
        return lines

    def _protections(self) -> list[str]:
        elsewhere = ("setpoint_timeout", "drive_heartbeat")
        lines = ["protections:"]
        lines += [f"  {row.name}: {self._ways[row.name]}" for row in DRIVE_PROTECTIONS if row.name not in elsewhere]
        for one in PROTECTIONS:
            found = self._variable(one.index, one.subindex)
            if one.way == self._ways[one.name] and found is not None and not found.writable:
                told = f"0x{one.index:04X} can only be read: it must hold what the bench file says ({one.meaning})"
                self.draft.open_places.append(told)
        self.draft.open_places.append("Whether bit 12 of the status word means 'follows the set-point' in mode 10")
        return lines

    def _pdos(self, way: str, communication: int, mapping: int) -> list[str]:
        """Return the PDOs of one direction: mapped as the layout says, or the drive's own where that is fixed."""
        first = self._variable(mapping)
        if first is not None and not first.writable:
            return self._fixed_pdos(way, communication, mapping)
        lines: list[str] = []
        for number, names in enumerate(LAYOUT[way], start=1):
            there = [name for name in names if self._mappable(way, name)]
            if not there:
                continue
            if communication + number - 1 not in self._od:
                self.draft.refused.append(f"No PDO {number} to {way} {', '.join(there)}")
                continue
            lines += self._pdo(way, number, [(OBJECTS[name], 0, name) for name in there], fixed=False)
        return lines

    def _mappable(self, way: str, name: str) -> bool:
        index = OBJECTS[name]
        found = self._variable(index)
        types = RECEIVE_OBJECTS if way == "receive" else TRANSMIT_OBJECTS
        if found is not None and found.pdo_mappable and TYPES.get(found.data_type or 0) == types[name]:
            return True
        if name not in OPTIONAL_OBJECTS:
            why = "No object" if found is None else "Not mappable as " + types[name] + ":"
            self.draft.refused.append(f"{why} 0x{index:04X}, {name.replace('_', ' ')}")
        return False

    def _fixed_pdos(self, way: str, communication: int, mapping: int) -> list[str]:
        """Return the drive's own PDOs, as few of them as carry what is needed."""
        types = RECEIVE_OBJECTS if way == "receive" else TRANSMIT_OBJECTS
        by_index = {OBJECTS[name]: name for name in types if name in OBJECTS}
        wanted = {name for name in types if name not in OPTIONAL_OBJECTS}
        lines: list[str] = []
        for number in range(1, 9):
            entries = self._entries(mapping + number - 1)
            names = {by_index[index] for index, _, _ in entries if index in by_index}
            if not names & wanted or communication + number - 1 not in self._od:
                continue
            wanted -= names
            objects = [(index, subindex, by_index.get(index, f"{IGNORED} {bits}")) for index, subindex, bits in entries]
            lines += self._pdo(way, number, objects, fixed=True)
        self.draft.refused += [
            f"No fixed PDO carries 0x{OBJECTS[name]:04X}, {name.replace('_', ' ')}" for name in sorted(wanted)
        ]
        return lines

    def _entries(self, index: int) -> list[tuple[int, int, int]]:
        """Return a PDO's default mapping: index, subindex and bits of each entry."""
        count = self._default(index)
        found = [self._default(index, place) for place in range(1, (count or 0) + 1)]
        return [(one >> 16, one >> 8 & 0xFF, one & 0xFF) for one in found if one]

    def _pdo(self, way: str, number: int, objects: list[tuple[int, int, str]], *, fixed: bool) -> list[str]:
        types = RECEIVE_OBJECTS if way == "receive" else TRANSMIT_OBJECTS
        lines = [f"  - number: {number}", "    transmission_type: 1"]
        if way == "receive":
            torque = any(name == "target_torque" for _, _, name in objects)
            timeout = torque and self._ways["setpoint_timeout"] != NONE
            lines.append(f"    timeout: {'true' if timeout else 'false'}")
        if fixed:
            lines.append("    fixed_mapping: true")
        if number > 4:
            base = 0x200 if way == "receive" else 0x180
            self.draft.open_places.append(f"A COB-ID for PDO {number} that no other device uses, with its node id")
            lines.append(f"    cob_id: 0x{base + 0x20 + number:03X}  # fill in: one that no other device uses")
        lines.append("    objects:")
        size = 0
        for index, subindex, name in objects:
            called, _, bits = name.partition(" ")
            kind = types[called] if called in types else TYPE_OF_BITS.get(int(bits), "")
            size += SIZES.get(kind, PDO_BYTES + 1)
            lines.append(f"      - {{index: 0x{index:04X}, subindex: {subindex}, type: {kind}, name: {called}}}")
        if size > PDO_BYTES:
            self.draft.refused.append(f"PDO {number} to {way} maps what no number of 8, 16 or 32 bits holds")
        return lines
