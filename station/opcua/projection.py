"""States of the controller as other standards name them: PackML, and state and operation mode of OPC 40001-1.

A projection: nothing here is decided, and no state can be asked for.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from definitions.image import State

S = State


class PackMl(IntEnum):
    """States of PackML with their numbers (ANSI/ISA-TR88.00.02)."""

    CLEARING = 1
    STOPPED = 2
    STARTING = 3
    IDLE = 4
    SUSPENDED = 5
    EXECUTE = 6
    STOPPING = 7
    ABORTING = 8
    ABORTED = 9
    HOLDING = 10
    HELD = 11
    UNHOLDING = 12
    SUSPENDING = 13
    UNSUSPENDING = 14
    RESETTING = 15
    COMPLETING = 16
    COMPLETE = 17

    @property
    def title(self) -> str:
        """Name of the state as the standard writes it."""
        return self.name.capitalize()


class UnitMode(IntEnum):
    """Unit modes of PackML."""

    PRODUCTION = 1
    MAINTENANCE = 2
    MANUAL = 3


class ItemState(IntEnum):
    """States of MachineryItemState_StateMachineType (OPC 40001-1, 12.2), with their nodes."""

    NOT_AVAILABLE = 5005
    OUT_OF_SERVICE = 5004
    NOT_EXECUTING = 5007
    EXECUTING = 5006

    @property
    def title(self) -> str:
        """Name of the state as the standard writes it."""
        return "".join(word.capitalize() for word in self.name.split("_"))


class OperationMode(IntEnum):
    """States of MachineryOperationModeStateMachineType (OPC 40001-1, 13.2), with their nodes."""

    NONE = 5024
    MAINTENANCE = 5025
    PROCESSING = 5026
    SETUP = 5027

    @property
    def title(self) -> str:
        """Name of the mode as the standard writes it."""
        return self.name.capitalize()


class Projected(NamedTuple):
    """What a state of the controller is elsewhere."""

    packml: PackMl
    item: ItemState
    operation: OperationMode
    mode: UnitMode = UnitMode.PRODUCTION


_MEASURES = (ItemState.EXECUTING, OperationMode.PROCESSING)
_WAITS = (ItemState.NOT_EXECUTING, OperationMode.PROCESSING)

PROJECTION: dict[State, Projected] = {
    S.IDLE: Projected(PackMl.IDLE, *_WAITS),
    S.HOME: Projected(PackMl.STARTING, *_MEASURES),
    S.LOCK: Projected(PackMl.STARTING, *_MEASURES),
    S.CALIBRATE: Projected(PackMl.EXECUTE, *_MEASURES),
    S.RAMP_POS: Projected(PackMl.EXECUTE, *_MEASURES),
    S.REVERSE: Projected(PackMl.EXECUTE, *_MEASURES),
    S.RAMP_NEG: Projected(PackMl.EXECUTE, *_MEASURES),
    S.UNLOAD: Projected(PackMl.COMPLETING, *_MEASURES),
    S.RELEASE: Projected(PackMl.COMPLETING, *_MEASURES),
    S.COMPLETE: Projected(PackMl.COMPLETE, *_WAITS),
    S.STOPPED: Projected(PackMl.STOPPED, *_WAITS),
    S.FAULT: Projected(PackMl.ABORTED, ItemState.OUT_OF_SERVICE, OperationMode.NONE),
    S.JOG: Projected(PackMl.EXECUTE, ItemState.EXECUTING, OperationMode.SETUP, UnitMode.MANUAL),
}
"""Every state of the controller."""

NOTHING_KNOWN = Projected(PackMl.STOPPED, ItemState.NOT_AVAILABLE, OperationMode.NONE)
"""While nothing is known of the bench: no run was made, or the newest cannot be read."""


def projected(state: State | None, *, settled: bool = True) -> Projected:
    """Return what a state is elsewhere; None: nothing is known. settled: the reaction to a fault has ended."""
    if state is None:
        return NOTHING_KNOWN
    row = PROJECTION[state]
    return row if settled or state is not State.FAULT else row._replace(packml=PackMl.ABORTING)
