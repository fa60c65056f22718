"""Bypasses: a start condition that somebody has set aside, for a reason and for a time.

A bypass stands in the audit trail, and as a note in the record and the report of every run that was made under it.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import NamedTuple

from sqlalchemy import Connection, insert, select, update

from station.errors import StationError
from station.wall_clock import WALL_CLOCK
from station.web.people.database import BYPASSES
from station.web.permission import CONDITIONS

LONGEST_HOURS = 24.0
"""A shift or two: what is needed for longer is a change of the rules, and not a bypass."""

ALLOWED = tuple(one.id for one in CONDITIONS if one.may_be_bypassed)


class BypassError(StationError):
    """A bypass that cannot be had."""


class Bypass(NamedTuple):
    """A condition that does not count now: whose decision, why, and until when (seconds since 1970)."""

    condition: str
    name: str
    reason: str
    until_s: float

    def __str__(self) -> str:
        until = datetime.fromtimestamp(self.until_s, UTC)
        return (
            f"start condition '{self.condition}' was bypassed by {self.name} until {until:%Y-%m-%d %H:%M} UTC: "
            f"{self.reason}"
        )


def bypasses_now(connection: Connection) -> tuple[Bypass, ...]:
    """Return the bypasses that count at this moment."""
    columns = (BYPASSES.c.condition, BYPASSES.c.name, BYPASSES.c.reason, BYPASSES.c.until_s)
    wanted = select(*columns).where(BYPASSES.c.until_s > WALL_CLOCK.now().timestamp()).order_by(BYPASSES.c.number)
    return tuple(Bypass(*row) for row in connection.execute(wanted))


def add_bypass(connection: Connection, condition: str, name: str, reason: str, hours: float) -> Bypass:
    """Set a condition aside for some hours; one that is set aside already gets the new reason and end.

    Raises:
        BypassError: the condition is none, or one that nobody may set aside.

    """
    if condition not in ALLOWED:
        raise BypassError(f"condition: found {condition[:40]!r}; allowed are {', '.join(ALLOWED)}")
    if not reason.strip() or not reason.isprintable():
        raise BypassError("reason: found an empty or unprintable text. Give the reason for the bypass")
    end_bypass(connection, condition)
    found = Bypass(condition, name, reason.strip(), WALL_CLOCK.now().timestamp() + 3600.0 * hours)
    connection.execute(insert(BYPASSES).values(**found._asdict()))
    return found


def end_bypass(connection: Connection, condition: str) -> bool:
    """Let a condition count again; False where it did."""
    now_s = WALL_CLOCK.now().timestamp()
    counting = (BYPASSES.c.condition == condition) & (BYPASSES.c.until_s > now_s)
    return connection.execute(update(BYPASSES).where(counting).values(until_s=now_s)).rowcount > 0
