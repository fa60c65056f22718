"""Emergency messages of the drive: code, cause, and what to do next.

Codes by CiA 301 and CiA 402-1. A code that has no row of its own is explained by its class (its upper bits); the
texts are for the person at the bench, who has no drive manual at hand.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple

DRIVE_ALARMS = frozenset({"drive_fault", "drive_emergency", "drive_dropped_out"})
"""Faults of the controller by their ids that the drive's emergency code explains."""


class EmcyText(NamedTuple):
    """Cause and next action of an emergency code."""

    cause: str
    next_action: str


EMCY_TEXTS = MappingProxyType(
    {
        0x2310: EmcyText(
            "over-current at the drive's output", "check the motor cable and the current loop's tuning, then reset"
        ),
        0x2320: EmcyText(
            "short circuit or short to earth at the drive's output",
            "switch off, measure motor cable and winding to earth",
        ),
        0x3210: EmcyText(
            "DC link over-voltage", "the wound-up unit feeds energy back: slower unloading, check the braking resistor"
        ),
        0x3220: EmcyText("DC link under-voltage", "check mains, contactor and e-stop chain, then reset"),
        0x4310: EmcyText("drive too hot", "let it cool, check its fan and the duty of the recipe"),
        0x5410: EmcyText("output stage fault", "check that the enable and STO inputs are wired, then reset"),
        0x7121: EmcyText(
            "motor blocked", "check the unit's mounting and that the recipe's torque suits the motor, then reset"
        ),
        0x7300: EmcyText("encoder fault", "check the encoder cable and its connectors, home again after the reset"),
        0x8100: EmcyText(
            "the drive lost its connection", "check CAN cable, termination and who set the drive's NMT state"
        ),
        0x8110: EmcyText("CAN overrun, the drive lost messages", "check bus load: longer scan period or fewer nodes"),
        0x8120: EmcyText("CAN error passive", "check termination, cable and bit rate"),
        0x8130: EmcyText(
            "the drive missed the controller's heartbeat", "the controller stopped or the CAN link was cut: check both"
        ),
        0x8140: EmcyText("the drive recovered from bus-off", "check termination, cable and bit rate"),
        0x8210: EmcyText("set-point message too short", "the mapping in the drive profile does not fit: check profile"),
        0x8220: EmcyText("set-point message too long", "the mapping in the drive profile does not fit: check profile"),
        0x8250: EmcyText(
            "set-points stayed away longer than allowed", "check the CAN link and the timing of the last run"
        ),
        0x8700: EmcyText("the drive missed SYNC", "check bus load and the timing of the last run"),
        0x8311: EmcyText(
            "torque above the drive's limit", "check the unit for jamming and the recipe's peak torque, then reset"
        ),
        0x8331: EmcyText("torque fault", "check motor phases and the torque loop's tuning"),
        0x84F0: EmcyText("speed deviation too large", "check the lock, the coupling and the speed loop's tuning"),
        0x84FF: EmcyText(
            "speed above the drive's limit", "the load gave way: check lock, coupling and unit before the next run"
        ),
        0x8611: EmcyText("following error too large", "check the coupling and the acceleration in the recipe"),
    }
)
"""Codes with a cause of their own."""

EMCY_CLASSES = MappingProxyType(
    {
        0x1000: EmcyText("generic error", "read the drive's error history 0x1003"),
        0x2000: EmcyText("current fault", "check motor cable and winding"),
        0x2100: EmcyText("current fault at the drive's input", "check mains and fuses"),
        0x2200: EmcyText("current fault inside the drive", "switch off and on; replace the drive if it comes back"),
        0x2300: EmcyText("current fault at the drive's output", "check motor cable and winding"),
        0x3000: EmcyText("voltage fault", "check mains and supply"),
        0x3100: EmcyText("mains voltage fault", "check mains, fuses and contactor"),
        0x3200: EmcyText("DC link voltage fault", "check mains and the braking resistor"),
        0x3300: EmcyText("output voltage fault", "check the motor cable"),
        0x4000: EmcyText("temperature fault", "let drive and motor cool, check ventilation"),
        0x4100: EmcyText("ambient too hot", "check the cabinet's ventilation"),
        0x4200: EmcyText("drive too hot", "let it cool, check its fan"),
        0x4300: EmcyText("drive or motor too hot", "let it cool, check its fan and the duty of the recipe"),
        0x5000: EmcyText("drive hardware fault", "switch off and on; replace the drive if it comes back"),
        0x6000: EmcyText("drive software fault", "switch off and on; check the firmware's version"),
        0x6300: EmcyText("drive parameter fault", "load the drive's parameter set again"),
        0x7000: EmcyText("fault of an additional module", "check motor, brake, encoder and their cables"),
        0x7100: EmcyText("power module or motor fault", "check motor and braking chopper"),
        0x7300: EmcyText("sensor fault", "check the encoder and its cable"),
        0x8000: EmcyText("monitoring fault", "read the drive's error history 0x1003"),
        0x8100: EmcyText("communication fault", "check the CAN cable, termination and bit rate"),
        0x8200: EmcyText("protocol error", "check the drive profile against the drive"),
        0x8300: EmcyText("torque control fault", "check the unit for jamming and the recipe's peak torque"),
        0x8400: EmcyText("speed control fault", "check lock and coupling"),
        0x8600: EmcyText("position control fault", "check the coupling and the encoder"),
        0x9000: EmcyText("external fault input", "check what is wired to the drive's fault input"),
        0xF000: EmcyText("additional function fault", "look the code up in the drive's manual"),
        0xFF00: EmcyText("fault defined by the vendor", "look the code up in the drive's manual"),
    }
)
"""Causes by class, for codes without a row of their own."""

_CLASS_MASKS = (0xFF00, 0xF000)
_UNKNOWN = EmcyText("unknown emergency code", "look the code up in the drive's manual")
_NO_ERROR = EmcyText("no error, or the error was reset", "none")


def explain_emcy(code: int) -> EmcyText:
    """Cause and next action of any 16-bit emergency code: its own row, else its class, else unknown."""
    if code & 0xFF00 == 0:
        return _NO_ERROR
    if code in EMCY_TEXTS:
        return EMCY_TEXTS[code]
    for mask in _CLASS_MASKS:
        if code & mask in EMCY_CLASSES:
            return EMCY_CLASSES[code & mask]
    return _UNKNOWN


def emcy_sentence(code: int) -> str:
    """Return an emergency code with its cause and what to do, without a full stop; '' where there is none."""
    if not code:
        return ""
    told = explain_emcy(code)
    return f"emergency code 0x{code:04X}: {told.cause}; {told.next_action}"


def drive_said(fault: str, code: int) -> str:
    """Return what the drive's emergency code says of a fault by its id; '' where it says nothing of it."""
    return emcy_sentence(code) if fault in DRIVE_ALARMS else ""
