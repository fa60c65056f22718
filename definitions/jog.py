"""Jog: a technician turns the loaded shaft slowly, with an enabling device in one hand and a key held by the other.

One row for each phase, with what a person reads and does in it; the controller steps through them (`controller.jog`),
and what the page, the command and the record say of a jog is read off these rows.

The order is part of the protection. The key is held first, on the page or at the terminal; then the enabling device is
pressed, at the shaft. So the contact has been seen open before every movement, and a stuck one moves nothing. Each
movement takes a new press: neither a key nor a contact that comes back starts the shaft again.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from definitions.image import Command

TOKEN_EVERY_S = 0.05
"""Whoever holds the key gives a token this often; how long one counts is `jog_token_s` of the budgets."""

DIRECTIONS: dict[int, int] = {Command.JOG_POSITIVE: 1, Command.JOG_NEGATIVE: -1}
"""Commands that are tokens of a jog, with the direction in which the shaft shall turn."""


class JogPhase(IntEnum):
    """Phases of the state JOG, as recorded in `phase`."""

    RELEASE_DEVICE = 1
    HOLD_KEY = 2
    PRESS_DEVICE = 3
    ENABLING = 4
    TURNING = 5
    STOPPING = 6
    SWITCHING_OFF = 7


class PhaseRow(NamedTuple):
    """One phase: what happens, what the person does next, and whether the drive may be on."""

    phase: JogPhase
    words: str
    next_action: str
    drive_on: bool = False


P = JogPhase


class Protection(NamedTuple):
    """What keeps a jog safe, what proves it, and what happens without it."""

    what: str
    proof: str
    without: str


PROTECTIONS: tuple[Protection, ...] = (
    Protection("three-position enabling device (IEC 60204-1), an input of the remote I/O",
               "Looked at in every scan. Seen open before each movement; pressed for too long: enabling_device_stuck",
               "A bench whose profile of the remote I/O has no `enabling_device` has no jog"),
    Protection("token of a held key, sent again every 50 ms; a token older than 100 ms is a stop",
               "Its age is counted in scans, missed ones included; recorded with every scan",
               "A page that hangs, a closed browser or a broken network would leave the shaft turning"),
    Protection("a stop on a ramp, then the drive off",
               "The shaft stands within 0.3 s, else the drive's power goes: jog_not_stopped",
               "A drive that ignores its set-point would go on"),
    Protection("the drive ends its torque when the program dies",
               "`lostmotion bench watchdogs`, once: a jog is refused, as a run is, until it has passed",
               "A program that dies in a jog would leave the shaft turning"),
    Protection("little speed and torque, in the drive itself: 0x6080 and 0x6072",
               "Written and read back before every jog; watched in every scan (overspeed, torque_in_trip)",
               "A wrong set-point would act with the speed and torque of a run"),
    Protection("the lock is open",
               "Watched in every scan (brake_stays_closed)",
               "A jog would wind the unit up"),
)  # fmt: skip


PHASES: tuple[PhaseRow, ...] = (
    PhaseRow(P.RELEASE_DEVICE, "enabling device pressed before the key", "Release the enabling device"),
    PhaseRow(P.HOLD_KEY, "drive off", "Hold the key of a direction, then press the enabling device"),
    PhaseRow(P.PRESS_DEVICE, "key held, drive off", "Press the enabling device to its middle position"),
    PhaseRow(P.ENABLING, "drive is being switched on", "Keep both: the shaft turns in a moment", drive_on=True),
    PhaseRow(P.TURNING, "shaft turns", "Let go of key or enabling device to stop", drive_on=True),
    PhaseRow(P.STOPPING, "shaft is being stopped", "Wait until the shaft stands", drive_on=True),
    PhaseRow(P.SWITCHING_OFF, "drive is being switched off", "Wait until the drive is off", drive_on=True),
)
"""Every phase, in the order of its number."""

PHASE_ROWS: dict[int, PhaseRow] = {row.phase: row for row in PHASES}
