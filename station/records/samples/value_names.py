"""What the numbers in a record's columns stand for: one name per value, or one per bit, by group and field."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import NamedTuple

from definitions.faults import FAULTS
from definitions.image import (
    Command,
    DriveCommand,
    DriveMode,
    DriveState,
    Link,
    NmtState,
    Reaction,
    SampleStatus,
    State,
)

Names = Mapping[int, str]
NO_NAMES: Names = MappingProxyType({})

STATUSWORD_BITS: Names = {
    0: "ready_to_switch_on",
    1: "switched_on",
    2: "operation_enabled",
    3: "fault",
    4: "voltage_enabled",
    5: "no_quick_stop",
    6: "switch_on_disabled",
    7: "warning",
    9: "remote",
    10: "target_reached",
    11: "internal_limit",
    12: "follows_command, or homing_attained in homing mode",
    13: "following_error, or homing_error in homing mode",
}
"""Status word 0x6041 of CiA 402."""


class Coded(NamedTuple):
    """Names of a column's numbers: by value, or by the number of the bit, from 0."""

    values: Names = NO_NAMES
    bits: Names = NO_NAMES

    def as_json(self) -> dict[str, dict[str, str]]:
        """Return `values` or `bits` as JSON has them, number and name; nothing for a channel without names."""
        both = {"values": self.values, "bits": self.bits}
        return {kind: {str(number): name for number, name in of.items()} for kind, of in both.items() if of}


def _values(kind: Iterable[IntEnum]) -> Coded:
    return Coded(values={int(one): one.name.lower() for one in kind})


def _bits(kind: Iterable[IntEnum]) -> Coded:
    return Coded(bits={int(one).bit_length() - 1: one.name.lower() for one in kind})


CODED: Mapping[tuple[str, str], Coded] = {
    ("image", "command"): _values(Command),
    ("image", "drive_state"): _values(DriveState),
    ("image", "drive_statusword"): Coded(bits=STATUSWORD_BITS),
    ("image", "drive_mode"): _values(DriveMode),
    ("image", "drive_nmt_state"): _values(NmtState),
    ("image", "sample_status"): _bits(SampleStatus),
    ("image", "links_lost"): _bits(Link),
    ("orders", "drive_command"): _values(DriveCommand),
    ("orders", "drive_mode"): _values(DriveMode),
    ("orders", "state"): _values(State),
    ("orders", "reaction"): _values(Reaction),
    ("orders", "fault"): Coded(values={0: "none"} | {fault.number: fault.id for fault in FAULTS}),
    ("orders", "alarms"): Coded(bits={fault.number: fault.id for fault in FAULTS}),
}
"""Group and name of a field, and its names; other columns are quantities, counters, or 0 and 1."""
