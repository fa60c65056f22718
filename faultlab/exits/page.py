"""The table of exits as a page of the documentation."""

from __future__ import annotations

from faultlab.exits.judge import Measured
from faultlab.exits.rows import EXITS, LOAD_NM, RATED_NM, Exit
from faultlab.matrix.matrix import LOW_SHARE_OF_RATED
from faultlab.rows import REST_SHARE_OF_RATED

HEAD = f"""# Exits

This page is written by `lostmotion faults exits --page docs/exits.md`.

Every way in which a run can end, provoked in virtual time (unit P1, rated {RATED_NM:.0f} N·m): what people, processes
and links do in the middle of a ramp at more than {LOAD_NM:.0f} N·m, the other faults as in the
[fault matrix](fault-matrix.md), in a ramp or, where one cannot come up there, from the state that leads to it. *In* is
the state at the cause, *at* the torque in the reducer then, *peak* the largest from there on. Times count from the
cause, for a fault of the matrix from its alarm: *down* until the torque stays below {REST_SHARE_OF_RATED:.0%} of rated
torque, *low* until it stays below {LOW_SHARE_OF_RATED:.0%}. Before there is any torque, *peak* shows that none came.

Where the drive stops by its own quick stop or loses its power, friction holds a residual torque of 3 to 6 % of rated
torque in the unit (*rest*). The torque is then never *low*, and the lock stays closed. `lostmotion recover` brings the
torque to zero before the lock opens. *Lock* is the state of the lock at the end, with the torque in the reducer when
the lock was told to open. Without brake current a powder brake holds nothing: after a power failure the unit turns back
by itself, so keep clear of the shafts.

What happens between the processes (a killed supervisor, a killed scan, everything at once) is drilled over real wires
by `make kill-tests` and `make power-cuts`.

"""
COLUMNS = (
    "exit",
    "how",
    "who brings the torque to zero",
    "in",
    "at",
    "peak",
    "bound",
    "down",
    "low",
    "rest",
    "lock",
    "ends in",
    "provoked by",
)


def page(found: dict[str, Measured | None]) -> str:
    """Return the page for what was measured, all exits in the order of their table."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|" + " --- |" * len(COLUMNS)]
    lines += [f"| {' | '.join(_cells(row, found[row.id]))} |" for row in EXITS]
    return HEAD + "\n".join(lines) + "\n"


def _cells(row: Exit, one: Measured | None) -> tuple[str, ...]:
    head = (f"`{row.id}`", row.how, row.who)
    if one is None:
        return (*head, "", "", "", f"{row.bound_s:g} s", "", "", "", "", "", "nothing: not measured")
    torques = (f"{one.begin_nm:.1f} N·m", f"{one.peak_nm:.1f} N·m", f"{row.bound_s:g} s")
    times = (_time(one.down_s), _time(one.low_s), f"{one.rest_nm:.1f} N·m")
    return (*head, one.begin_state, *torques, *times, lock(row, one), one.state, one.by)


def lock(row: Exit, one: Measured) -> str:
    """What became of the lock, in words."""
    if one.opened_nm is not None:
        return f"opened at {one.opened_nm:.1f} N·m"
    if row.lock != "stays closed":
        return row.lock
    return row.lock if one.closed else "open, was not closed yet"


def _time(seconds: float | None) -> str:
    return "no" if seconds is None else f"{seconds:.3f} s"
