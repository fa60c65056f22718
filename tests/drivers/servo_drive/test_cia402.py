"""CiA 402 tables: total over all status words and all commands, and unambiguous."""

from __future__ import annotations

import pytest

from definitions.image import DriveCommand, DriveMode, DriveState
from drivers.servo_drive.cia402 import (
    CONTROL_WORDS,
    STATE_ROWS,
    control_word,
    decode_state,
    follows_command,
    homing_attained,
    homing_error,
    internal_limit,
)

# Status words as real drives send them (voltage enabled, remote, target reached set at random), with their states.
SEEN = [
    (0x0000, DriveState.NOT_READY_TO_SWITCH_ON),
    (0x0250, DriveState.SWITCH_ON_DISABLED),
    (0x0260, DriveState.SWITCH_ON_DISABLED),
    (0x0231, DriveState.READY_TO_SWITCH_ON),
    (0x0233, DriveState.SWITCHED_ON),
    (0x1637, DriveState.OPERATION_ENABLED),
    (0x0217, DriveState.QUICK_STOP_ACTIVE),
    (0x021F, DriveState.FAULT_REACTION_ACTIVE),
    (0x0218, DriveState.FAULT),
    (0x0238, DriveState.FAULT),
    (0x0201, DriveState.UNKNOWN),
    (0x0213, DriveState.UNKNOWN),
]


@pytest.mark.parametrize(("statusword", "state"), SEEN)
def test_status_words_of_drives(statusword: int, state: DriveState) -> None:
    assert decode_state(statusword) is state


def test_every_status_word_has_one_state_or_none() -> None:
    for statusword in range(0x10000):
        states = [row.state for row in STATE_ROWS if statusword & row.mask == row.value]
        assert len(states) <= 1
        assert decode_state(statusword) is (states[0] if states else DriveState.UNKNOWN)


def test_every_state_has_a_row_and_a_word() -> None:
    assert {row.state for row in STATE_ROWS} == set(DriveState) - {DriveState.UNKNOWN}
    assert {decode_state(word) for word in range(0x80)} == set(DriveState)


def test_every_command_has_a_control_word() -> None:
    assert set(CONTROL_WORDS) == set(DriveCommand)
    assert CONTROL_WORDS[DriveCommand.START_HOMING] == 0x1F
    for command in DriveCommand:
        word = control_word(int(command))
        resets = command is DriveCommand.FAULT_RESET
        assert bool(word & 0x80) is resets
        assert not word & 0x100, "halt would hide a set-point"


def test_only_enabling_commands_leave_the_drive_enabled() -> None:
    enabling = {command for command, word in CONTROL_WORDS.items() if word & 0x0F == 0x0F}
    assert enabling == {DriveCommand.ENABLE_OPERATION, DriveCommand.START_HOMING}


def test_a_number_that_is_no_command_takes_the_power_away() -> None:
    assert control_word(99) == control_word(DriveCommand.DISABLE_VOLTAGE) == 0


def test_bits_mean_what_the_mode_says() -> None:
    cyclic = {DriveMode.CYCLIC_SYNC_TORQUE, DriveMode.CYCLIC_SYNC_VELOCITY}
    for mode in DriveMode:
        for word in range(0x10000):
            bit_11, bit_12, bit_13 = word >> 11 & 1, word >> 12 & 1, word >> 13 & 1
            assert internal_limit(word) == bit_11
            assert follows_command(word, mode) == (bit_12 if mode in cyclic else 0)
            assert homing_attained(word, mode) == (bit_12 if mode is DriveMode.HOMING else 0)
            assert homing_error(word, mode) == (bit_13 if mode is DriveMode.HOMING else 0)
