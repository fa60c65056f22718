"""States and transitions. Everything that may change the state of the bench is in this file.

Rules, in plain words:
- Torque only with a proven lock: the ramps are reached through LOCK alone.
- From every state a trip leads to FAULT. These rows stand first.
- FAULT is left by a person only (reset, after the acknowledgement and with the cause gone), and then through UNLOAD, so
  that whatever is still wound up is brought to zero before the lock opens.
- A stop by the operator is not a fault: UNLOAD, RELEASE, STOPPED.
- A jog is no run: it is reached from IDLE alone and left to STOPPED or FAULT, and never leads to torque on a unit.
- The lock opens in RELEASE alone, which is reached from HOME (lock still open) and UNLOAD.

At most one trigger is fired per scan, never from a callback. `transitions` runs the table with `queued=False` (a queue
would answer True always and lose an abort when an exception clears it) and `auto_transitions=False`.
"""

from __future__ import annotations

from typing import NamedTuple

from transitions import Machine

from definitions.image import State

S = State


class Transition(NamedTuple):
    """Row of the transition table: a trigger takes the bench from one state to another."""

    trigger: str
    source: State
    dest: State


TRANSITIONS: tuple[Transition, ...] = (
    # safety rows first
    Transition("trip", S.IDLE, S.FAULT),
    Transition("trip", S.HOME, S.FAULT),
    Transition("trip", S.LOCK, S.FAULT),
    Transition("trip", S.CALIBRATE, S.FAULT),
    Transition("trip", S.RAMP_POS, S.FAULT),
    Transition("trip", S.REVERSE, S.FAULT),
    Transition("trip", S.RAMP_NEG, S.FAULT),
    Transition("trip", S.UNLOAD, S.FAULT),
    Transition("trip", S.RELEASE, S.FAULT),
    Transition("trip", S.COMPLETE, S.FAULT),
    Transition("trip", S.STOPPED, S.FAULT),
    Transition("trip", S.JOG, S.FAULT),
    # the operator's stop
    Transition("stop", S.IDLE, S.STOPPED),
    Transition("stop", S.HOME, S.RELEASE),
    Transition("stop", S.LOCK, S.UNLOAD),
    Transition("stop", S.CALIBRATE, S.UNLOAD),
    Transition("stop", S.RAMP_POS, S.UNLOAD),
    Transition("stop", S.REVERSE, S.UNLOAD),
    Transition("stop", S.RAMP_NEG, S.UNLOAD),
    # the sequence
    Transition("start", S.IDLE, S.HOME),
    Transition("close_lock", S.HOME, S.LOCK),
    Transition("calibrate", S.LOCK, S.CALIBRATE),
    Transition("ramp_pos", S.LOCK, S.RAMP_POS),
    Transition("ramp_pos", S.CALIBRATE, S.RAMP_POS),
    Transition("reverse", S.RAMP_POS, S.REVERSE),
    Transition("reverse", S.RAMP_NEG, S.REVERSE),
    Transition("ramp_neg", S.REVERSE, S.RAMP_NEG),
    Transition("ramp_pos", S.REVERSE, S.RAMP_POS),
    Transition("unload", S.REVERSE, S.UNLOAD),
    Transition("release", S.UNLOAD, S.RELEASE),
    Transition("complete", S.RELEASE, S.COMPLETE),
    Transition("stopped", S.RELEASE, S.STOPPED),
    Transition("rearm", S.COMPLETE, S.IDLE),
    Transition("rearm", S.STOPPED, S.IDLE),
    # the jog, in place of a run
    Transition("jog", S.IDLE, S.JOG),
    Transition("stopped", S.JOG, S.STOPPED),
    # the recovery
    Transition("reset", S.FAULT, S.UNLOAD),
)

TRIGGER_INTO: dict[State, str] = {
    S.LOCK: "close_lock",
    S.CALIBRATE: "calibrate",
    S.RAMP_POS: "ramp_pos",
    S.REVERSE: "reverse",
    S.RAMP_NEG: "ramp_neg",
    S.UNLOAD: "unload",
    S.RELEASE: "release",
}
"""The trigger by which the running sequence enters a state."""


class Sequence:
    """The state of the bench, moved through `TRANSITIONS` by `transitions.Machine`."""

    state: State

    def __init__(self) -> None:
        self._machine = Machine(
            model=self,
            states=list(State),
            initial=State.IDLE,
            transitions=[{"trigger": row.trigger, "source": row.source, "dest": row.dest} for row in TRANSITIONS],
            auto_transitions=False,
            queued=False,
            send_event=False,
        )
        self._fire = {row.trigger: getattr(self, row.trigger) for row in TRANSITIONS}

    def fire(self, trigger: str) -> None:
        """Move by `trigger`; raises `transitions.MachineError` and stays where it is when the table has no such row."""
        self._fire[trigger]()
