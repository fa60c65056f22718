"""What happened in a run: the lines of `events.jsonl`, the alarms of a result, and how the bench was left."""

from __future__ import annotations

from dataclasses import dataclass

from station.documents.entries import Count, Number, left_out

NOTES = ("warn", "hold")
"""Reactions of alarms that end no run: notes to whoever looks after the bench."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """What the controller or its supervisor has to say at a scan."""

    scan: Count
    kind: str
    state: str = ""
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmValues:
    """What was measured when an alarm came: torques tared."""

    torque_out_nm: Number | None = None
    torque_in_nm: Number | None = None
    reference_torque_nm: Number | None = None
    brake_current_a: Number | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """An alarm with its cause and what to do; `first`: the one that ended the run. `detail`: what the drive said."""

    scan: Count
    kind: str = "alarm"
    state: str
    id: str
    reaction: str
    text: str
    cause: str
    next_action: str
    values: AlarmValues = AlarmValues()
    detail: str | None = left_out()
    first: bool = False
    t_s: Number

    @property
    def is_note(self) -> bool:
        """Whether it only held or warned: it ends no run and is shown without alarm."""
        return self.reaction in NOTES


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRow:
    """One line of events.jsonl: a command, a note, a transition `to` a state; an alarm has its own entries too."""

    scan: Count
    kind: str
    state: str
    to: str | None = left_out()
    id: str | None = left_out()
    reaction: str | None = left_out()
    text: str | None = left_out()
    cause: str | None = left_out()
    next_action: str | None = left_out()
    values: AlarmValues | None = left_out()
    detail: str | None = left_out()
    first: bool | None = left_out()
    t_s: Number


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftState:
    """How a run left the bench; `known` is false for what was not heard of at the end of the record.

    `torque_nm` is null where the sensor gave no number.
    """

    torque_nm: Number | None
    torque_known: bool
    lock: str
    lock_known: bool
    drive: str
    drive_known: bool
    release_torque_nm: Number
    text: str = ""
    next_action: str = ""
