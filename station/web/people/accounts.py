"""Accounts, roles and sessions: who may enter, and as whom a request is made.

Passwords are kept as Argon2id hashes, sessions by the hash of their token. After some wrong passwords an account is
locked for a while. The first start makes the account `admin` with a password that is good for one thing: to be changed.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import unicodedata
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any

from argon2 import PasswordHasher
from argon2.exceptions import VerificationError
from sqlalchemy import Connection, delete, insert, select, update

from station.errors import StationError
from station.wall_clock import WALL_CLOCK
from station.web.people.database import CHOICES, PEOPLE, SESSIONS, StationDatabase

COOKIE = "lostmotion_session"
"""Name of the cookie that a session is known by."""

MES = "mes"
"""Role of the account by which the MES of the plant makes its requests."""

ROLES = ("operator", "technician", "quality", "engineer", "admin", MES)
FIRST_ACCOUNT = "admin"

LEAST_PASSWORD, LONGEST_PASSWORD = 8, 200
LONGEST_NAME = 64
WRONG_TRIES = 5
LOCKED_S = 300.0
SESSION_S = 12 * 3600.0
"""A shift, with some time before and after it."""

WRONG = "name or password is wrong"
CHECK_NAME = "Check its spelling, or add the account first"
AT_ONCE, LONGEST_WAIT_S = 2, 3.0
"""How many passwords are checked at once, and how long others wait for that."""

CHECKS = BoundedSemaphore(AT_ONCE)
_HASHER = PasswordHasher()


def _of_no_password(like: PasswordHasher) -> str:
    """Return a hash as `like` makes them, of nothing: to make one takes each start as long as a log-in."""
    salt, digest = (
        b64encode(secrets.token_bytes(size)).decode().rstrip("=") for size in (like.salt_len, like.hash_len)
    )
    return f"$argon2id$v=19$m={like.memory_cost},t={like.time_cost},p={like.parallelism}${salt}${digest}"


NOBODY = _of_no_password(_HASHER)
"""Checked for names that do not exist, so that the time to an answer does not tell them from others."""


class AccountError(StationError):
    """A name or a password that cannot be had."""


class EntryRefusedError(StationError):
    """Wrong name or password, or an account that is locked or disabled. It says the same of the first two.

    name: whose account it is, where that is known, for the audit trail alone.
    """

    def __init__(self, text: str, name: str = "?") -> None:
        super().__init__(text)
        self.name = name


class TooManyEntriesError(StationError):
    """More people try to enter than passwords can be checked at once: each check takes 64 MiB and some 50 ms."""


@dataclass(frozen=True)
class Person:
    """Who makes a request; `must_change`: the password is the first one, and nothing else may be done with it."""

    name: str
    role: str
    must_change: bool = False


@dataclass(frozen=True)
class Session:
    """An open session: `token` is the browser's secret, `csrf` what each of its requests has to bring besides.

    place: where it is, for the audit trail; '' of a browser or of REST.
    """

    person: Person
    token: str
    csrf: str
    place: str = ""


def session_here(name: str | None, place: str) -> Session:
    """Return the session of whoever stands at the bench's own terminal: an operator, without an account.

    name: as they say themselves; None where nobody has said, and the place stands for them.
    """
    return Session(Person(name or place, "operator"), "", "", place)


def first_password(connection: Connection) -> str | None:
    """Make the first account and return its password; None where there are accounts already."""
    if connection.execute(select(PEOPLE.c.name).limit(1)).first() is not None:
        return None
    password = secrets.token_urlsafe(9)
    add_person(connection, FIRST_ACCOUNT, "admin", password)
    return password


def has_accounts(data: Path) -> bool:
    """Say whether the station of a data folder has any account; a loop without a screen makes a station without."""
    database = StationDatabase(data)
    try:
        with database.reading() as connection:
            return connection.execute(select(PEOPLE.c.name).limit(1)).first() is not None
    finally:
        database.close()


def first_is_changed(connection: Connection) -> bool:
    """Say whether the password of the first account is no longer the one that was printed."""
    first = select(PEOPLE.c.must_change).where(PEOPLE.c.name == FIRST_ACCOUNT)
    return connection.execute(first).scalar() is False


def add_person(connection: Connection, name: str, role: str, password: str) -> None:
    """Add an account whose password has to be changed at the first entry.

    Raises:
        AccountError: the name, role or password is not allowed, or the name is taken, or looks like one that is.

    """
    if not is_name(name):
        raise AccountError(f"name: found {name[:40]!r}; allowed are 1 to {LONGEST_NAME} printable characters")
    if role not in ROLES:
        raise AccountError(f"role: found {role[:40]!r}; allowed are {', '.join(ROLES)}")
    _check_password(password)
    there = list(connection.execute(select(PEOPLE.c.name)).scalars())
    if name in there:
        raise AccountError(f"name: {name} is taken. Choose another name")
    if alike := [one for one in there if _folded(one) == _folded(name)]:
        raise AccountError(f"name: {name} looks like {alike[0]}, who has an account. Choose another name")
    values = {"name": name, "role": role, "password": _HASHER.hash(password)}
    connection.execute(insert(PEOPLE).values(**values, must_change=True, failed=0, disabled=False))


def _folded(name: str) -> str:
    """Return a name without what is hardly seen in it: capitals, and how its characters are put together."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())


def is_name(name: str) -> bool:
    """Say whether this can be the name of an account."""
    return bool(name.strip()) and len(name) <= LONGEST_NAME and name.isprintable() and name == name.strip()


def reset_person(connection: Connection, name: str, password: str) -> None:
    """Open an account again with a first password, whatever closed or locked it; its sessions end.

    Raises:
        AccountError: there is no such account, or the password is not allowed.

    """
    _check_password(password)
    fresh = {"must_change": True, "failed": 0, "locked_until_s": None, "disabled": False}
    changed = update(PEOPLE).where(PEOPLE.c.name == name).values(password=_HASHER.hash(password), **fresh)
    if not connection.execute(changed).rowcount:
        raise AccountError(f"name: there is no account {name[:40]!r}. {CHECK_NAME}")
    connection.execute(delete(SESSIONS).where(SESSIONS.c.name == name))


def disable_person(connection: Connection, name: str) -> None:
    """Close an account and its sessions; AccountError where there is none."""
    if not connection.execute(update(PEOPLE).where(PEOPLE.c.name == name).values(disabled=True)).rowcount:
        raise AccountError(f"name: there is no account {name[:40]!r}. {CHECK_NAME}")
    connection.execute(delete(SESSIONS).where(SESSIONS.c.name == name))


def change_password(connection: Connection, name: str, old: str, new: str) -> None:
    """Change a password; all other sessions of the account end. AccountError or EntryRefusedError where it stays."""
    _check_password(new)
    if new == old:
        raise AccountError("new_password: is the old password. Choose another password")
    row = connection.execute(select(PEOPLE).where(PEOPLE.c.name == name)).one()
    if (locked := locked_out(row)) is not None:
        raise locked
    if not fits(row.password, old):
        raise EntryRefusedError("old_password: is wrong. Enter the password that you have now")
    connection.execute(
        update(PEOPLE).where(PEOPLE.c.name == name).values(password=_HASHER.hash(new), must_change=False)
    )
    connection.execute(delete(SESSIONS).where(SESSIONS.c.name == name))


def enter(database: StationDatabase, name: str, password: str) -> Session | EntryRefusedError:
    """Return a new session, or why there is none; wrong tries are counted, so that is no exception that undoes them.

    The password is checked before anything is locked: who guesses keeps nobody else waiting.

    Raises:
        TooManyEntriesError: others' passwords are being checked for too long already.

    """
    by_name = select(PEOPLE).where(PEOPLE.c.name == (name if is_name(name) else ""))
    with database.reading() as connection:
        before = connection.execute(by_name).first()
    if not CHECKS.acquire(timeout=LONGEST_WAIT_S):
        raise TooManyEntriesError("too many people log in at once. Try again in a moment")
    try:
        right = fits(NOBODY if before is None else before.password, password)
    finally:
        CHECKS.release()
    with database.writing() as connection:
        row = connection.execute(by_name).first()
        if row is None or row.disabled:
            return EntryRefusedError(WRONG)
        if (locked := locked_out(row)) is not None:
            return locked
        if not right or before is None or row.password != before.password:
            count_wrong(connection, name)
            return EntryRefusedError(WRONG)
        return let_in(connection, row)


def let_in(connection: Connection, row: Any) -> Session:
    """Open a session for the account of a row of `PEOPLE`: wrong tries are forgotten, and sessions that have ended."""
    connection.execute(update(PEOPLE).where(PEOPLE.c.name == row.name).values(failed=0, locked_until_s=None))
    connection.execute(delete(SESSIONS).where(SESSIONS.c.ends_s < WALL_CLOCK.now().timestamp()))
    return open_session(connection, Person(row.name, row.role, row.must_change))


def count_wrong(connection: Connection, name: str) -> None:
    """Count a wrong password; after some the account is locked for a while."""
    row = connection.execute(select(PEOPLE.c.failed).where(PEOPLE.c.name == name)).one()
    locked = WALL_CLOCK.now().timestamp() + LOCKED_S if row.failed + 1 >= WRONG_TRIES else None
    changes = {"failed": 0 if locked else row.failed + 1, "locked_until_s": locked}
    connection.execute(update(PEOPLE).where(PEOPLE.c.name == name).values(**changes))


def locked_out(row: Any) -> EntryRefusedError | None:
    """Return the refusal where the account of a row is locked now."""
    left_s = 0.0 if row.locked_until_s is None else row.locked_until_s - WALL_CLOCK.now().timestamp()
    if left_s <= 0.0:
        return None
    minutes = max(1, round(left_s / 60.0))
    return EntryRefusedError(f"this account is locked after {WRONG_TRIES} wrong passwords; wait {minutes} min")


def open_session(connection: Connection, person: Person) -> Session:
    """Open a session with a token that nobody had before."""
    found = Session(person, secrets.token_urlsafe(32), secrets.token_urlsafe(32))
    values = {"name": person.name, "csrf": found.csrf, "ends_s": WALL_CLOCK.now().timestamp() + SESSION_S}
    connection.execute(insert(SESSIONS).values(token_sha256=_digest(found.token), **values))
    return found


def session_of(connection: Connection, token: str | None) -> Session | None:
    """Return the session of a token, None where it has ended or never was."""
    if not token:
        return None
    wanted = select(SESSIONS, PEOPLE.c.role, PEOPLE.c.must_change, PEOPLE.c.disabled).join(
        PEOPLE, PEOPLE.c.name == SESSIONS.c.name
    )
    row = connection.execute(wanted.where(SESSIONS.c.token_sha256 == _digest(token))).first()
    if row is None or row.disabled or row.ends_s < WALL_CLOCK.now().timestamp():
        return None
    return Session(Person(row.name, row.role, row.must_change), token, row.csrf)


def choose_language(connection: Connection, name: str, language: str) -> None:
    """Keep the language that a person has chosen for the pages."""
    connection.execute(delete(CHOICES).where(CHOICES.c.name == name))
    connection.execute(insert(CHOICES).values(name=name, language=language))


def chosen_language(connection: Connection, name: str) -> str | None:
    """Return the language that a person has chosen, None where it was none."""
    return connection.execute(select(CHOICES.c.language).where(CHOICES.c.name == name)).scalar()


def leave(connection: Connection, token: str) -> None:
    """End a session."""
    connection.execute(delete(SESSIONS).where(SESSIONS.c.token_sha256 == _digest(token)))


def brings_token(session: Session, csrf: str | None) -> bool:
    """Say whether a request brings the token of its session, compared in constant time."""
    return csrf is not None and hmac.compare_digest(session.csrf.encode(), csrf.encode())


def _check_password(password: str) -> None:
    if not LEAST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        raise AccountError(
            f"password: has {len(password)} characters; allowed are {LEAST_PASSWORD} to {LONGEST_PASSWORD}"
        )


def hashed(password: str) -> str:
    """Return what is kept of a password or a PIN."""
    return _HASHER.hash(password)


def fits(kept: str, password: str) -> bool:
    """Say whether a password or a PIN is the one that was kept."""
    try:
        return _HASHER.verify(kept, password[: LONGEST_PASSWORD + 1])
    except (VerificationError, UnicodeEncodeError):
        return False


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
