"""How a run left the bench, read from its last record: torque at the output, lock, drive, and what a person does."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

from definitions.image import DriveState, Link
from station.documents.events import LeftState
from station.records.program_file import StoredProgram
from station.records.samples.table import Table
from station.records.samples.zeroes import output_torque_nm

OLD_S = 0.2
"""Values older than this are said as what was heard last, not as what is."""

CLOSED_CURRENT_A = 0.05
"""Above this current in the lock brake the lock counts as closed."""

ENERGISED = (DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE)


def left_state(table: Table, program: StoredProgram, *, to_its_end: bool = True) -> LeftState | None:
    """Return how the bench was left; None when there is no record.

    Args:
        table: all records of the run.
        program: the run's own: period, sensors and the torque at which the lock may open.
        to_its_end: False when the scan was torn off: nobody has seen what the bench did after the last record.

    """
    if not len(table):
        return None
    image = table[-1]["image"]
    old = OLD_S / float(program.period_s)
    links = int(image["links_lost"])
    torque = float(output_torque_nm(table[-1], has_torque_out=program.has_torque_out))
    current_a = float(image["brake_current_a"])
    heard_torque = int(image["sample_age_scans"]) <= old and not links & Link.AMPLIFIER
    heard_lock = int(image["brake_age_scans"]) <= old and not links & Link.BRAKE
    left = LeftState(
        torque_nm=round(torque, 2) if isfinite(torque) else None,
        torque_known=to_its_end and bool(heard_torque) and isfinite(torque),
        lock="open" if not image["brake_on"] and current_a <= CLOSED_CURRENT_A else "closed",
        lock_known=to_its_end and bool(heard_lock) and isfinite(current_a),
        drive="on" if int(image["drive_state"]) in ENERGISED else "off",
        drive_known=to_its_end
        and bool(int(image["drive_age_scans"]) <= old and not links & (Link.CAN | Link.CAN_SHARED)),
        release_torque_nm=round(float(program.release_torque_nm), 3),
    )
    return replace(left, text=left_text(left), next_action=left_action(left))


def _said(text: str, *, known: bool) -> str:
    return text if known else f"{text} (last known)"


def left_text(left: LeftState) -> str:
    """Return how the bench was left as one sentence without a full stop."""
    torque = "" if left.torque_nm is None else f"{left.torque_nm:+.1f}".replace("-", "−")
    parts = (
        _said(f"{torque} N·m at the output", known=left.torque_known) if torque else "unknown torque at the output",
        _said(f"lock {left.lock}", known=left.lock_known),
        _said(f"drive {left.drive}", known=left.drive_known),
    )
    return f"left with {', '.join(parts)}"


def left_action(left: LeftState) -> str:
    """Return what a person does before touching the unit."""
    if left.torque_nm is None or not (left.torque_known and left.lock_known and left.drive_known):
        return (
            "treat the unit as wound up: switch the drive's power off, keep out of reach of the shafts, "
            "and read the torque again before the lock is opened"
        )
    if left.drive == "on":
        return "the servo drive is still on: switch its power off, and keep out of reach of the shafts until it is off"
    stored = abs(left.torque_nm) > left.release_torque_nm
    if stored and left.lock == "closed":
        return (
            "the unit is still wound up: with the drive off, turn the loaded shaft back by hand until the torque "
            "is near zero, and only then open the lock"
        )
    if stored:
        return "the lock is open and the sensor still shows torque: check for a jam, then the zero of the torque sensor"
    if left.lock == "closed":
        return "the stored torque is negligible: open the lock, then remove the unit"
    return "no torque is stored and the lock is open: the unit can be removed"
