"""The table of exits as a page of the documentation."""

from __future__ import annotations

from faultlab.exits.judge import Measured
from faultlab.exits.rows import EXITS, LOAD_NM, RATED_NM, Exit
from faultlab.matrix.matrix import LOW_SHARE_OF_RATED
from faultlab.rows import REST_SHARE_OF_RATED

HEAD = f"""# Exits

This page is written by `lostmotion faults exits --page docs/exits.md`.

Each row is one way in which a run can end, simulated in virtual time (unit P1, rated torque {RATED_NM:.0f} N·m).
Stops by people, processes and links happen in a ramp, at more than {LOAD_NM:.0f} N·m. Faults are those of the
[fault matrix](fault-matrix.md). They happen in a ramp if they can, otherwise in the state in which they can.

- *in*: state of the run at the cause
- *at*: torque in the reducer at the cause
- *peak*: largest torque in the reducer after the cause
- *down*: time until the torque stays below {REST_SHARE_OF_RATED:.0%} of rated torque
- *low*: time until the torque stays below {LOW_SHARE_OF_RATED:.0%} of rated torque
- *bound*: limit for *low*; for *down* where friction holds a rest
- *rest*: torque that is left in the unit at the end
- *lock*: state of the lock at the end, and the torque in the reducer when the lock was told to open

Times count from the cause. For a fault of the matrix they count from its alarm.

After a quick stop by the drive, or a loss of its power, friction holds 3 to 6 % of rated torque in the unit (*rest*).
The torque is then never *low*, and the lock stays closed. `lostmotion recover` brings the torque to zero before it
opens the lock.

A powder brake without current holds nothing. After a power failure the unit turns back by itself: keep clear of the
shafts.

`make kill-tests` and `make power-cuts` try out over real wires what happens when processes are killed.

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
