"""CiA 402 without I/O: status word to state, command to control word, and the bits that matter to a torque test.

The state rows are the standard's (CiA 402-2, status word 0x6041): a state is (status word & mask) == value.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple

from definitions.image import DriveCommand, DriveMode, DriveState


class StateRow(NamedTuple):
    """One state's pattern in the status word."""

    state: DriveState
    mask: int
    value: int


STATE_ROWS: tuple[StateRow, ...] = (
    StateRow(DriveState.NOT_READY_TO_SWITCH_ON, 0x4F, 0x00),
    StateRow(DriveState.SWITCH_ON_DISABLED, 0x4F, 0x40),
    StateRow(DriveState.READY_TO_SWITCH_ON, 0x6F, 0x21),
    StateRow(DriveState.SWITCHED_ON, 0x6F, 0x23),
    StateRow(DriveState.OPERATION_ENABLED, 0x6F, 0x27),
    StateRow(DriveState.QUICK_STOP_ACTIVE, 0x6F, 0x07),
    StateRow(DriveState.FAULT_REACTION_ACTIVE, 0x4F, 0x0F),
    StateRow(DriveState.FAULT, 0x4F, 0x08),
)

CONTROL_WORDS = MappingProxyType(
    {
        DriveCommand.DISABLE_VOLTAGE: 0x00,
        DriveCommand.SHUTDOWN: 0x06,
        DriveCommand.SWITCH_ON: 0x07,
        DriveCommand.ENABLE_OPERATION: 0x0F,
        DriveCommand.QUICK_STOP: 0x02,  # bit 2 is active low
        DriveCommand.FAULT_RESET: 0x80,  # acts on the rising edge of bit 7, so one command resets once
        DriveCommand.START_HOMING: 0x1F,  # enable operation with bit 4
    }
)

INTERNAL_LIMIT_BIT = 1 << 11
MODE_BIT_12 = 1 << 12
MODE_BIT_13 = 1 << 13

_WORDS = {int(command): word for command, word in CONTROL_WORDS.items()}
_STATE_MASK = 0x6F
_CYCLIC_MODES = frozenset({int(DriveMode.CYCLIC_SYNC_VELOCITY), int(DriveMode.CYCLIC_SYNC_TORQUE)})


def _state_of(bits: int) -> DriveState:
    for row in STATE_ROWS:
        if bits & row.mask == row.value:
            return row.state
    return DriveState.UNKNOWN


_STATES = tuple(_state_of(bits) for bits in range(_STATE_MASK + 1))


def decode_state(statusword: int) -> DriveState:
    """State in a status word (any u16); UNKNOWN when its bits fit no state."""
    return _STATES[statusword & _STATE_MASK]


def control_word(command: int) -> int:
    """Control word 0x6040 of a `DriveCommand`; a number that is none disables the voltage."""
    return _WORDS.get(command, 0x00)


def internal_limit(statusword: int) -> int:
    """1 while the drive limits what it is asked for (bit 11)."""
    return 1 if statusword & INTERNAL_LIMIT_BIT else 0


def follows_command(statusword: int, mode: int, *, has_bit: bool = True) -> int:
    """1 while the drive follows the set-point: bit 12 in the cyclic modes, 0 in the others.

    Of a drive that has no such bit nothing more is known than that its operation is enabled.
    """
    if mode not in _CYCLIC_MODES:
        return 0
    if has_bit:
        return 1 if statusword & MODE_BIT_12 else 0
    return 1 if decode_state(statusword) == DriveState.OPERATION_ENABLED else 0


def homing_attained(statusword: int, mode: int) -> int:
    """1 when the reference is found: bit 12 in homing mode, 0 in the others."""
    return 1 if statusword & MODE_BIT_12 and mode == DriveMode.HOMING else 0


def homing_error(statusword: int, mode: int) -> int:
    """1 when homing failed: bit 13 in homing mode, 0 in the others."""
    return 1 if statusword & MODE_BIT_13 and mode == DriveMode.HOMING else 0
