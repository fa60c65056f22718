"""Who has an account here, as people are shown: nothing of passwords, PINs or badge numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Connection, select

from station.wall_clock import WALL_CLOCK
from station.web.people.database import BADGES, PEOPLE

OPEN, FIRST, LOCKED, CLOSED = "open", "first password not changed yet", "locked", "closed"


class Account(NamedTuple):
    """One account: whose it is, whether it can be used, and whether a badge belongs to it."""

    name: str
    role: str
    standing: str
    badge: bool


def accounts_of(connection: Connection) -> list[Account]:
    """Return every account by name."""
    now_s = WALL_CLOCK.now().timestamp()
    with_badge = set(connection.execute(select(BADGES.c.name)).scalars())
    rows = connection.execute(select(PEOPLE).order_by(PEOPLE.c.name)).all()
    return [Account(row.name, row.role, _standing(row, now_s), row.name in with_badge) for row in rows]


def _standing(row: Any, now_s: float) -> str:
    """Return whether the account of a row of `PEOPLE` can be used now."""
    if row.disabled:
        return CLOSED
    if (row.locked_until_s or 0.0) > now_s:
        return LOCKED
    return FIRST if row.must_change else OPEN
