"""The clocks that a run can have been made by, as its record names them.

wall: deadlines of the wall clock against wires; the only clock of real hardware. scan: over the same wires, but the
virtual bench waits for the scan, so a late period is stretched and never missed. virtual: in process, without wires.
Records made before there were three call the first one "real".
"""

from __future__ import annotations

from typing import NamedTuple

WALL, SCAN, VIRTUAL = "wall", "scan", "virtual"
CLOCKS = (WALL, SCAN, VIRTUAL)
_BEFORE = {"real": WALL}

CLOCK_TEXTS = {
    WALL: "wall clock",
    SCAN: "scan clock: the virtual bench waited for each scan of the controller",
    VIRTUAL: "virtual time",
}


class Pacing(NamedTuple):
    """The clock of a run over wires; `fast`: by the scan clock, without waiting for deadlines."""

    clock: str
    fast: bool = False


BY_WALL_CLOCK = Pacing(WALL)


def clock_of(name: str | None) -> str:
    """Return the clock that a manifest, a result or a proof of timing names; an empty text where it names none."""
    return _BEFORE.get(name or "", name or "")
