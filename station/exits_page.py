"""The table of exits as a page of the documentation."""

from __future__ import annotations

from station.exit_rows import EXITS, LOAD_NM, RATED_NM, Exit
from station.exits import Measured
from station.fault_matrix import LOW_SHARE_OF_RATED
from station.fault_rows import REST_SHARE_OF_RATED

HEAD = f"""# Exits

This page is written by `lostmotion faults exits --page docs/exits.md`.

Every way in which a run can end, provoked in the middle of a ramp at more than {LOAD_NM:.0f} N·m (unit P1, rated
{RATED_NM:.0f} N·m) in virtual time. Times count from the cause, for a fault from its alarm: *down* until the torque in
the reducer stays below {REST_SHARE_OF_RATED:.0%} of rated torque, *low* until it stays below {LOW_SHARE_OF_RATED:.0%}.

Where the drive stops by its own quick stop or loses its power, friction keeps a rest of 3 to 6 % of rated torque in
the unit: it is never *low*, the lock stays closed, and `lostmotion recover` brings it to zero before the lock opens.
*Lock* gives the torque in the reducer when the lock was ordered open. Without brake current a powder brake holds
nothing: after a power failure the unit turns back by itself, so keep clear of the shafts.

What happens between the processes (a killed desk, a killed scan, everything at once) is drilled over real wires by
`make kill-tests` and `make power-cuts`.

"""
COLUMNS = (
    "exit",
    "how",
    "who brings the torque to zero",
    "bound",
    "down",
    "low",
    "rest",
    "lock",
    "ends in",
    "provoked by",
)
NOT_IN_A_RAMP = "no row of the fault matrix raises it in a ramp: it belongs to the time before the torque"


def page(found: dict[str, Measured | None]) -> str:
    """Return the page for what was measured, all exits in the order of their table."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|" + " --- |" * len(COLUMNS)]
    lines += [f"| {' | '.join(_cells(row, found[row.id]))} |" for row in EXITS]
    return HEAD + "\n".join(lines) + "\n"


def _cells(row: Exit, one: Measured | None) -> tuple[str, ...]:
    head = (f"`{row.id}`", row.how, row.who, f"{row.bound_s:g} s")
    if one is None:
        return (*head, "", "", "", row.lock, "fault", NOT_IN_A_RAMP)
    lock = row.lock if one.opened_nm is None else f"{row.lock} at {one.opened_nm:.1f} N·m"
    return (*head, _time(one.down_s), _time(one.low_s), f"{one.rest_nm:.1f} N·m", lock, one.state, one.by)


def _time(seconds: float | None) -> str:
    return "no" if seconds is None else f"{seconds:.3f} s"
