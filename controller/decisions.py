"""Versions of what the controller decides: a new one whenever the same inputs give other outputs.

Every run keeps the version it was made by. A replay compares it with today's, so that a record is never called wrong
because the controller has changed since.
"""

from __future__ import annotations

DECISIONS: dict[int, str] = {
    1: "as recorded first",
    2: "the comparison of drive and angle sensor allows for the age of the sample, counted from its request, and for "
    "the largest speed in that time; the recovery after a fault also unloads a residual torque that is just small "
    "enough to open the lock",
    3: "a complete run ends after the zeroes of both torque sensors were read again with the lock open; "
    "the fault reset bit of the drive is set until the drive leaves the fault, for 100 ms at most. It is set again "
    "after a pause of 100 ms",
}
"""Version, and what the controller decides otherwise than in the one before."""

DECISIONS_VERSION = max(DECISIONS)


def changes_since(version: int) -> list[str]:
    """Return what the controller decides otherwise than in a version, one text for each version after it."""
    return [f"{number}: {text}" for number, text in DECISIONS.items() if number > version]
