"""CiA 402 as tables: states, commands, transitions, status words, option codes and error registers.

Written from the profile itself and not shared with the controller's code, so that one checks the other.
`cia402_machine` applies these tables; nothing else decides a transition.
"""

from __future__ import annotations

from enum import Enum, IntEnum


class PowerState(IntEnum):
    """States of the drive's power machine."""

    NOT_READY_TO_SWITCH_ON = 0
    SWITCH_ON_DISABLED = 1
    READY_TO_SWITCH_ON = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION_ACTIVE = 6
    FAULT = 7

    @property
    def text(self) -> str:
        """Name as the profile writes it."""
        return self.name.lower().replace("_", " ")


class PowerCommand(IntEnum):
    """What a control word asks of the power machine."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3
    ENABLE_OPERATION = 4
    FAULT_RESET = 5


class Mode(IntEnum):
    """Modes of operation that this drive has; object 0x6060."""

    NONE = 0
    HOMING = 6
    CYCLIC_SYNC_VELOCITY = 9
    CYCLIC_SYNC_TORQUE = 10


SUPPORTED_MODES = sum(1 << (mode - 1) for mode in Mode if mode)
"""Object 0x6502."""

COMMANDS: tuple[tuple[int, int, PowerCommand], ...] = (
    # mask, pattern, command; the first that fits counts
    (0x0002, 0x0000, PowerCommand.DISABLE_VOLTAGE),
    (0x0006, 0x0002, PowerCommand.QUICK_STOP),
    (0x0007, 0x0006, PowerCommand.SHUTDOWN),
    (0x000F, 0x0007, PowerCommand.SWITCH_ON),
    (0x000F, 0x000F, PowerCommand.ENABLE_OPERATION),
)
"""Control word to command. A fault reset is the rising edge of bit 7 and is not a level."""

FAULT_RESET_BIT = 0x0080
START_HOMING_BIT = 0x0010
HALT_BIT = 0x0100

TRANSITIONS: dict[tuple[PowerState, PowerCommand], PowerState] = {
    (PowerState.SWITCH_ON_DISABLED, PowerCommand.SHUTDOWN): PowerState.READY_TO_SWITCH_ON,  # 2
    (PowerState.READY_TO_SWITCH_ON, PowerCommand.SWITCH_ON): PowerState.SWITCHED_ON,  # 3
    (PowerState.SWITCHED_ON, PowerCommand.ENABLE_OPERATION): PowerState.OPERATION_ENABLED,  # 4
    (PowerState.OPERATION_ENABLED, PowerCommand.SWITCH_ON): PowerState.SWITCHED_ON,  # 5
    (PowerState.SWITCHED_ON, PowerCommand.SHUTDOWN): PowerState.READY_TO_SWITCH_ON,  # 6
    (PowerState.READY_TO_SWITCH_ON, PowerCommand.DISABLE_VOLTAGE): PowerState.SWITCH_ON_DISABLED,  # 7
    (PowerState.READY_TO_SWITCH_ON, PowerCommand.QUICK_STOP): PowerState.SWITCH_ON_DISABLED,  # 7
    (PowerState.OPERATION_ENABLED, PowerCommand.SHUTDOWN): PowerState.READY_TO_SWITCH_ON,  # 8
    (PowerState.OPERATION_ENABLED, PowerCommand.DISABLE_VOLTAGE): PowerState.SWITCH_ON_DISABLED,  # 9
    (PowerState.SWITCHED_ON, PowerCommand.DISABLE_VOLTAGE): PowerState.SWITCH_ON_DISABLED,  # 10
    (PowerState.SWITCHED_ON, PowerCommand.QUICK_STOP): PowerState.SWITCH_ON_DISABLED,  # 10
    (PowerState.OPERATION_ENABLED, PowerCommand.QUICK_STOP): PowerState.QUICK_STOP_ACTIVE,  # 11
    (PowerState.QUICK_STOP_ACTIVE, PowerCommand.DISABLE_VOLTAGE): PowerState.SWITCH_ON_DISABLED,  # 12
    (PowerState.FAULT, PowerCommand.FAULT_RESET): PowerState.SWITCH_ON_DISABLED,  # 15
    (PowerState.QUICK_STOP_ACTIVE, PowerCommand.ENABLE_OPERATION): PowerState.OPERATION_ENABLED,  # 16
}
"""Transitions that a control word can make, with their numbers in the profile. What is not here is refused.

0, 1 (start), 12 (quick stop done), 13 (fault) and 14 (reaction done) are made by the drive itself. 16 also needs a
quick stop option that stays in the state.
"""

STATUS_BITS: dict[PowerState, int] = {
    PowerState.NOT_READY_TO_SWITCH_ON: 0x0000,
    PowerState.SWITCH_ON_DISABLED: 0x0040,
    PowerState.READY_TO_SWITCH_ON: 0x0021,
    PowerState.SWITCHED_ON: 0x0023,
    PowerState.OPERATION_ENABLED: 0x0027,
    PowerState.QUICK_STOP_ACTIVE: 0x0007,
    PowerState.FAULT_REACTION_ACTIVE: 0x000F,
    PowerState.FAULT: 0x0008,
}

VOLTAGE_ENABLED = 1 << 4
WARNING = 1 << 7
REMOTE = 1 << 9
TARGET_REACHED = 1 << 10
INTERNAL_LIMIT = 1 << 11
FOLLOWS_COMMAND = 1 << 12  # in homing mode: reference found
HOMING_ATTAINED = 1 << 12
HOMING_ERROR = 1 << 13

ENERGIZED = frozenset({PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION_ACTIVE})
"""States in which the motor may have torque."""


class Stop(Enum):
    """How the motor is stopped."""

    COAST = "power off at once"
    RAMP = "slow down on the slow-down ramp"
    QUICK_RAMP = "slow down on the quick stop ramp"


QUICK_STOP_OPTIONS: dict[int, tuple[Stop, bool]] = {
    # 0x605A: how, and whether the drive then stays in quick stop active
    0: (Stop.COAST, False),
    1: (Stop.RAMP, False),
    2: (Stop.QUICK_RAMP, False),
    5: (Stop.RAMP, True),
    6: (Stop.QUICK_RAMP, True),
}
SHUTDOWN_OPTIONS: dict[int, Stop] = {0: Stop.COAST, 1: Stop.RAMP}  # 0x605B
DISABLE_OPTIONS: dict[int, Stop] = {0: Stop.COAST, 1: Stop.RAMP}  # 0x605C
HALT_OPTIONS: dict[int, Stop] = {1: Stop.RAMP, 2: Stop.QUICK_RAMP}  # 0x605D
FAULT_REACTION_OPTIONS: dict[int, Stop] = {0: Stop.COAST, 1: Stop.RAMP, 2: Stop.QUICK_RAMP}  # 0x605E


class AbortConnection(IntEnum):
    """Object 0x6007: what the drive does when it loses its controller."""

    NOTHING = 0
    FAULT = 1
    DISABLE_VOLTAGE = 2
    QUICK_STOP = 3


HOMING_METHODS = (35, 37)
"""The current position becomes the home position."""

COMMUNICATION_LOST = 0x8100
HEARTBEAT_LOST = 0x8130
SETPOINT_TIMEOUT = 0x8250

ERROR_REGISTER_GENERIC = 0x01
ERROR_REGISTER: tuple[tuple[int, int, int], ...] = (
    # mask, class of error code, bit of 0x1001 beside the generic one
    (0xF000, 0x2000, 0x02),  # current
    (0xF000, 0x3000, 0x04),  # voltage
    (0xF000, 0x4000, 0x08),  # temperature
    (0xFF00, 0x8100, 0x10),  # communication
    (0xFF00, 0x8200, 0x10),  # protocol
    (0xF000, 0x8000, 0x20),  # monitoring, by device profile
    (0xF000, 0x7000, 0x20),  # additional modules
    (0xF000, 0x5000, 0x80),  # hardware
)


def error_register(code: int) -> int:
    """Return the error register 0x1001 that goes with an error code; 0 for no error."""
    if code == 0:
        return 0
    extra = next((bit for mask, pattern, bit in ERROR_REGISTER if code & mask == pattern), 0)
    return ERROR_REGISTER_GENERIC | extra


def decode_command(controlword: int) -> PowerCommand:
    """Return the command in a control word's low bits; every value has one."""
    return next(command for mask, pattern, command in COMMANDS if controlword & mask == pattern)


SHORT_MASK, LONG_MASK = 0x4F, 0x6F
SHORT_STATES = frozenset(
    {
        PowerState.NOT_READY_TO_SWITCH_ON,
        PowerState.SWITCH_ON_DISABLED,
        PowerState.FAULT_REACTION_ACTIVE,
        PowerState.FAULT,
    }
)
"""States whose status word does not tell by bit 5 (CiA 402, status word)."""


def state_of(statusword: int) -> PowerState:
    """Return the state that a status word shows; one that fits none counts as not ready."""
    for state, bits in STATUS_BITS.items():
        mask = SHORT_MASK if state in SHORT_STATES else LONG_MASK
        if statusword & mask == bits & mask:
            return state
    return PowerState.NOT_READY_TO_SWITCH_ON
