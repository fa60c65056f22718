"""The table of exits: how each is provoked, its bound, who brings the torque to zero, what becomes of the lock."""

from __future__ import annotations

from typing import NamedTuple

from definitions.faults import FAULTS
from definitions.image import Reaction
from faultlab.rows import UNLOADING_S
from station.scan.supervisor_watch import LONGEST_SILENCE_S

RATED_NM = 412.0
LOAD_NM = 100.0
QUICK_S = 1.0


class Exit(NamedTuple):
    """Row of the table: `bound_s` from the cause until the torque is low, or has come down to what friction keeps."""

    id: str
    how: str
    bound_s: float
    who: str
    lock: str


CONTROLLER = "controller: unloading ramp"
DRIVE = "drive: quick stop ramp or power off, then friction"
UNIT = "no device: drive and brake have no current, and the unit turns back"

EXITS: tuple[Exit, ...] = (
    Exit("finish", "the recipe comes to its end", UNLOADING_S, CONTROLLER, "opened"),
    Exit("operator_stop", "Ctrl-C in a ramp", UNLOADING_S, CONTROLLER, "opened"),
    Exit("abort", "Ctrl-C twice in a ramp, 0.1 s apart", QUICK_S, DRIVE, "stays closed"),
    Exit(
        "lost_supervisor",
        "no sign of life from the supervisor process",
        LONGEST_SILENCE_S + UNLOADING_S,
        CONTROLLER,
        "opened",
    ),
    Exit("lost_scan", "the scan process is gone: no set-points, no heartbeat", QUICK_S, DRIVE, "stays closed"),
    Exit("power_failure", "drive, brake and computer lose their supply", QUICK_S, UNIT, "open without current"),
    *(
        Exit(
            fault.id,
            f"fault: {fault.text}",
            UNLOADING_S if fault.reaction == Reaction.UNLOAD else QUICK_S,
            CONTROLLER if fault.reaction == Reaction.UNLOAD else DRIVE,
            "stays closed",
        )
        for fault in FAULTS
        if fault.reaction >= Reaction.UNLOAD
    ),
)
"""Reactions below UNLOAD end no run."""
