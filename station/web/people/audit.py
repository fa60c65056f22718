"""The audit trail: one line for each thing that was done or refused, each with the hash of the one before.

Who changes, removes or adds a line in the middle breaks the chain. Who removes lines from the end, or writes the whole
chain anew, does not: the head has to be kept elsewhere for that, so it is printed, and shown to whoever asks.

What an action does beyond the database, such as starting a run or signing a release, is not undone with its
transaction. Such an action is noted before it is done. Where the server is killed between the two, the next one finds
the note and writes the line: who began what and when, and that nobody knows how it ended.
"""

from __future__ import annotations

import hashlib
import json
import os
from typing import NamedTuple

from sqlalchemy import Connection, delete, insert, select

from station.documents.entries import Plain
from station.records.process_birth import process_birth
from station.wall_clock import now_text
from station.web.people.database import AUDIT, BEGUN

FIRST = "0" * 64
"""What stands in place of the hash before the first line."""

DONE, REFUSED, CUT_OFF = "done", "refused", "cut off"
"""What became of an action. The last: its process ended in it, so it may have been done or not."""

NOBODY_KNOWS = "The program ended during this action. Check whether the action was done."
HASHED = ("number", "at", "name", "action", "outcome", "detail", "before_sha256")


class Head(NamedTuple):
    """Newest line: how many lines there are, and its hash."""

    lines: int
    head_sha256: str


class Line(NamedTuple):
    """A line of the trail; `detail`: what was done or refused, as JSON."""

    number: int
    at: str
    name: str
    action: str
    outcome: str
    detail: str
    before_sha256: str
    sha256: str


def write(connection: Connection, name: str, action: str, outcome: str, detail: Plain) -> Head:
    """Add a line; it is kept together with what it tells of, in one transaction."""
    head = head_of(connection)
    line = Line(
        number=head.lines + 1,
        at=now_text(),
        name=name,
        action=action,
        outcome=outcome,
        detail=json.dumps(detail, ensure_ascii=False, sort_keys=True),
        before_sha256=head.head_sha256,
        sha256="",
    )
    line = line._replace(sha256=_hash(line))
    connection.execute(insert(AUDIT).values(line._asdict()))
    return Head(line.number, line.sha256)


def begin(connection: Connection, name: str, action: str, detail: Plain) -> int:
    """Note an action that is done next, in another transaction; return the number of the note, for `end`."""
    pid = os.getpid()
    note = {"at": now_text(), "name": name, "action": action, "pid": pid, "birth": process_birth(pid)}
    told = json.dumps(detail, ensure_ascii=False, sort_keys=True)
    key = connection.execute(insert(BEGUN).values(**note, detail=told)).inserted_primary_key
    assert key is not None  # noqa: S101 - the table has one
    return int(key[0])


def end(connection: Connection, number: int) -> None:
    """Take a note away, in the transaction of the line that tells of its end."""
    connection.execute(delete(BEGUN).where(BEGUN.c.number == number))


def tell_cut_off(connection: Connection, but: int | None = None) -> int:
    """Write a line for each action whose process ended in it, and return how many; but: the note of one that is on.

    This process does one action after the other: what it has begun and not ended otherwise has failed.
    """
    found = 0
    for row in connection.execute(select(BEGUN).order_by(BEGUN.c.number)).all():
        on = row.pid != os.getpid() and row.birth and process_birth(row.pid) == row.birth
        if row.number == but or on:
            continue
        told = json.loads(row.detail) | {"begun": row.at, "text": NOBODY_KNOWS}
        write(connection, row.name, row.action, CUT_OFF, told)
        end(connection, row.number)
        found += 1
    return found


def head_of(connection: Connection) -> Head:
    """Return the newest line's number and hash."""
    newest = select(AUDIT.c.number, AUDIT.c.sha256).order_by(AUDIT.c.number.desc()).limit(1)
    found = connection.execute(newest).first()
    return Head(0, FIRST) if found is None else Head(found.number, found.sha256)


def lines_of(connection: Connection, newest: int) -> list[Line]:
    """Return the newest lines, newest first."""
    wanted = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(newest)
    return [Line(**row._mapping) for row in connection.execute(wanted)]  # noqa: SLF001 - SQLAlchemy's public name


def problems_of(connection: Connection) -> list[str]:
    """Return what is wrong with the chain, in the order of its lines; nothing when each follows the one before."""
    problems, before, number = [], FIRST, 0
    for row in connection.execute(select(AUDIT).order_by(AUDIT.c.number)):
        line = Line(**row._mapping)  # noqa: SLF001 - as above
        number += 1
        if line.number != number:
            problems.append(f"line {number} of the audit trail is missing; the next line is {line.number}")
            number = line.number
        if line.before_sha256 != before:
            problems.append(f"line {number} of the audit trail does not follow the line before it: lines were changed")
        if line.sha256 != _hash(line):
            problems.append(f"line {number} of the audit trail was changed")
        before = line.sha256
    return problems


def _hash(line: Line) -> str:
    content = json.dumps([getattr(line, name) for name in HASHED], ensure_ascii=False)
    return hashlib.sha256(content.encode()).hexdigest()
