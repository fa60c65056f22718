"""The states of a run: one row for each, with its words and with what holds in it.

Who may follow whom is said by `controller.states`. Sets of states are read off the rows: whoever asks where something
counts names a set, and lists no states.
"""

from __future__ import annotations

from typing import NamedTuple

from definitions.image import State

S = State


class StateRow(NamedTuple):
    """One state.

    words: what an operator reads while it lasts. running: between the start and the end of a run. locked: the lock is
    closed, or is being closed and verified. loaded: the recipe puts torque on the unit, which is what is evaluated.
    ended: what is said of a run whose last state it is. way_back: what is said of it during the recovery from a fault.
    """

    state: State
    words: str
    running: bool = False
    locked: bool = False
    loaded: bool = False
    ended: str = ""
    way_back: str = ""


STATES: tuple[StateRow, ...] = (
    StateRow(S.IDLE, "waiting for the devices", ended="Nothing has moved"),
    StateRow(S.HOME, "taking zeroes, referencing", running=True),
    StateRow(S.LOCK, "closing and verifying the lock", running=True, locked=True),
    StateRow(S.CALIBRATE, "measuring the torque ratio", running=True, locked=True, loaded=True),
    StateRow(S.RAMP_POS, "loading", running=True, locked=True, loaded=True),
    StateRow(S.REVERSE, "turning point", running=True, locked=True, loaded=True),
    StateRow(S.RAMP_NEG, "loading", running=True, locked=True, loaded=True),
    StateRow(S.UNLOAD, "bringing the torque to zero", running=True, locked=True,
             way_back="bringing the torque to zero behind the closed lock"),
    StateRow(S.RELEASE, "opening the lock", running=True,
             way_back="torque is near zero: verified, drive off, then the lock opens"),
    StateRow(S.COMPLETE, "done", ended="The run was complete"),
    StateRow(S.STOPPED, "stopped",
             ended="The run was stopped: if anything had moved, the torque was brought to zero and the lock opened",
             way_back="the lock is open and the drive is off"),
    StateRow(S.FAULT, "fault", ended="The run ended in a fault: check the bench before you touch the unit"),
    StateRow(S.JOG, "turning the shaft by hand control", running=True),
)  # fmt: skip
"""Every state, in the order of its numbers."""

RUNNING = frozenset(row.state for row in STATES if row.running)
LOCKED = frozenset(row.state for row in STATES if row.locked)
LOADED = frozenset(row.state for row in STATES if row.loaded)
OVER = frozenset({S.COMPLETE, S.STOPPED})
"""States in which a run is over without a fault."""


def row_of(state: State) -> StateRow:
    """Return the row of a state."""
    return STATES[state]
