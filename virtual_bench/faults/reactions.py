"""What each reaction orders: one table from reactions to orders, states and contacts.

A reaction says how hard the bench answers an alarm (`definitions.faults` gives each fault its own); what then goes to
the devices has other names: `power_off` orders the drive `disable_voltage`. The controller carries reactions out in
code of its own; scenarios and the fault matrix are judged by this table, so that the two hold each other.
"""

from __future__ import annotations

from typing import NamedTuple

from definitions.image import DriveCommand, Reaction, State


class ReactionRow(NamedTuple):
    """Row of the table.

    `orders`: drive commands of which one goes out in the scan in which the reaction comes into force, the usual one
    first; none where the drive is left alone. `then`: the drive command that follows when the torque is gone. `state`:
    the controller's state from that scan on, None where it stays. `contacts`: inputs of the remote I/O, by their names
    in the vocabulary of faults, that bring it about when they open. `what`: what happens, in words.

    The lock's contact, the output of the brake supply, is kept by every reaction: it opens during the recovery only.
    """

    orders: tuple[DriveCommand, ...]
    then: DriveCommand | None
    state: State | None
    contacts: tuple[str, ...]
    what: str


C = DriveCommand

REACTIONS: dict[Reaction, ReactionRow] = {
    Reaction.WARN: ReactionRow((), None, None, (), "a note in the record; nothing else changes"),
    Reaction.HOLD: ReactionRow(
        (C.ENABLE_OPERATION,), None, None, (), "the ramp stands still until the alarm is gone, then it goes on"
    ),
    Reaction.UNLOAD: ReactionRow(
        (C.ENABLE_OPERATION, C.QUICK_STOP), C.DISABLE_VOLTAGE, State.FAULT, (),
        "the torque is ramped to zero; quick_stop where the drive is not enabled or the lock is open",
    ),
    Reaction.QUICK_STOP: ReactionRow(
        (C.QUICK_STOP,), C.DISABLE_VOLTAGE, State.FAULT, ("io.guard",), "the drive stops by its own ramp"
    ),
    Reaction.POWER_OFF: ReactionRow(
        (C.DISABLE_VOLTAGE,), None, State.FAULT, ("io.estop",), "the drive has no torque from the next scan on"
    ),
}  # fmt: skip
"""Every reaction that can come into force, from the mildest to the strongest; the strongest of all active ones wins."""

REACTION_NAMES = tuple(reaction.name.lower() for reaction in REACTIONS)


def reaction_of(name: str) -> Reaction:
    """Return the reaction that a scenario names. Raises KeyError for one that is not in the table."""
    return Reaction[name.upper()]
