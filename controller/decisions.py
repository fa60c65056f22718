"""Versions of what the controller decides: a new one whenever the same inputs give other outputs.

Every run keeps the version it was made by. A replay compares it with today's, so that a record is never called wrong
because the controller has changed since.
"""

from __future__ import annotations

DECISIONS: dict[int, str] = {
    1: "as recorded first",
    2: "drive and angle sensor are compared by the age since the request and the largest speed in that time; "
    "the recovery after a fault also unloads a residual torque just below that at which the lock may open",
    3: "a complete run ends when both torque zeroes have been recorded again, with the lock open; "
    "the bit that resets a drive's fault is set until the drive leaves the fault, for 100 ms at most, and is set "
    "again 100 ms later",
}
"""Version, and what the controller decides otherwise than in the one before."""

DECISIONS_VERSION = max(DECISIONS)


def changes_since(version: int) -> list[str]:
    """Return what the controller decides otherwise than in a version, one text for each version after it."""
    return [f"{number}: {text}" for number, text in DECISIONS.items() if number > version]
