"""Badges: who logs in with a scanned number and a PIN, in the place of a name and a password.

A badge number is no secret: it is printed on the badge. So a badge alone opens nothing, but where the site lets
operators in with it (`operator_by_badge_alone`); no other role ever. The PIN, or the account's password, goes with it.
Numbers are kept as Argon2id hashes with a salt of this station, which lets a badge be found by its number and makes
guessing numbers from a stolen file slow; PINs with a salt each, as passwords. Wrong PINs count as wrong passwords do.
A scanner may send the identifier of the symbology in front of a number: it is no part of it. Of badges that were given
with it the hash holds it, so what was scanned is looked up as it came first.
"""

from __future__ import annotations

import re
import secrets
from typing import Any

from argon2.low_level import Type, hash_secret_raw
from sqlalchemy import Connection, Row, Select, delete, insert, select, update

from station.web.people.accounts import (
    CHECK_NAME,
    CHECKS,
    LONGEST_PASSWORD,
    LONGEST_WAIT_S,
    NOBODY,
    AccountError,
    EntryRefusedError,
    Session,
    TooManyEntriesError,
    count_wrong,
    fits,
    hashed,
    let_in,
    locked_out,
)
from station.web.people.database import BADGE_SALT, BADGES, PEOPLE, StationDatabase
from station.web.scanner import ScanError, without_identifier
from station.web.settings import Settings

LEAST_PIN, LONGEST_PIN = 4, 12
LEAST_BADGE, LONGEST_BADGE = 4, 64
SALT_BYTES, DIGEST_BYTES = 16, 32
PASSES, MEMORY_KIB, LANES = 2, 19_456, 1
"""Argon2id with the least memory that OWASP recommends: it is computed at each badge that is read."""

OPERATOR = "operator"
WRONG = "badge or PIN is wrong"
EASY = frozenset({"1234", "4321", "12345", "123456", "654321", "0123"})


class PinNeededError(EntryRefusedError):
    """The badge was read, and the PIN is missing; the same is said of a badge that nobody has."""


def is_badge(settings: Settings, scanned: str) -> bool:
    """Say whether what was scanned is a badge number by the syntax of the site, with or without an identifier."""
    syntax, read = settings.badge, (scanned, scanned.strip(), without_identifier(scanned))
    return syntax is not None and any(re.fullmatch(syntax, one) for one in read)


def refuse_badge(settings: Settings, scanned: str) -> None:
    """Refuse a badge in the place of what is on the bench; its number stands in nothing that is said. ScanError."""
    if is_badge(settings, scanned):
        raise ScanError("this is a badge. Scan the code of the unit")


def assign_badge(connection: Connection, name: str, badge: str, pin: str) -> None:
    """Give a person a badge with a PIN; one that the person had before is withdrawn.

    Raises:
        AccountError: there is no such account, the number or the PIN is not allowed, or somebody else has the badge.

    """
    number = check_badge(badge)
    check_pin(pin)
    if connection.execute(select(PEOPLE.c.name).where(PEOPLE.c.name == name)).first() is None:
        raise AccountError(f"name: there is no account {name[:40]!r}. {CHECK_NAME}")
    digest = digest_with(_salt(connection), number)
    for read in _read(badge):
        there = digest_with(_salt(connection), read)
        owner = connection.execute(select(BADGES.c.name).where(BADGES.c.digest == there)).scalar()
        if owner not in (None, name):
            raise AccountError(f"badge: belongs to {owner}. Withdraw it first with withdraw_badge")
    connection.execute(delete(BADGES).where(BADGES.c.name == name))
    connection.execute(insert(BADGES).values(name=name, digest=digest, pin=hashed(pin)))


def withdraw_badge(connection: Connection, name: str) -> None:
    """Take a person's badge away; AccountError where there is none."""
    if not connection.execute(delete(BADGES).where(BADGES.c.name == name)).rowcount:
        raise AccountError(f"name: {name[:40]!r} has no badge to withdraw. Check the name")


def change_pin(connection: Connection, name: str, password: str, pin: str) -> None:
    """Change one's own PIN; EntryRefusedError for a wrong password, AccountError for a PIN that cannot be had."""
    check_pin(pin)
    row = connection.execute(select(PEOPLE).where(PEOPLE.c.name == name)).one()
    if (locked := locked_out(row)) is not None:
        raise locked
    if not fits(row.password, password):
        raise EntryRefusedError("password: is wrong. Enter the password of your account")
    if not connection.execute(update(BADGES).where(BADGES.c.name == name).values(pin=hashed(pin))).rowcount:
        raise AccountError("pin: you have no badge. An admin assigns one with assign_badge")


def enter_by_badge(
    database: StationDatabase, badge: str, secret: str, *, operator_alone: bool
) -> Session | EntryRefusedError:
    """Return a new session for who shows a badge and says its PIN or the account's password, or why there is none.

    operator_alone: an operator needs neither. As `enter`, what is wrong is counted, and checked before anything is
    locked.

    Raises:
        TooManyEntriesError: others' passwords are being checked for too long already.

    """
    if not CHECKS.acquire(timeout=LONGEST_WAIT_S):
        raise TooManyEntriesError("too many people log in at once. Try again in a moment")
    try:
        with database.writing() as connection:
            salt = _salt(connection)
        digests = [digest_with(salt, read[:LONGEST_BADGE]) for read in _read(badge)]
        wanted = select(PEOPLE, BADGES.c.pin, BADGES.c.digest).join(BADGES, BADGES.c.name == PEOPLE.c.name)
        with database.reading() as connection:
            before = _first(connection, wanted, digests)
        kept = NOBODY if before is None else before.pin
        right = bool(secret) and (fits(kept, secret) or (before is not None and fits(before.password, secret)))
    finally:
        CHECKS.release()
    with database.writing() as connection:
        row = _first(connection, wanted, digests)
        if not secret and not (operator_alone and row is not None and row.role == OPERATOR):
            return PinNeededError("Enter the PIN of the badge.")
        if row is None or row.disabled:
            return EntryRefusedError(WRONG)
        if (locked := locked_out(row)) is not None:
            return EntryRefusedError(str(locked), row.name)
        if row.must_change:
            text = "Log in with name and password once, and choose a password of your own."
            return EntryRefusedError(text if right else WRONG, row.name)
        if secret and (not right or before is None or (row.pin, row.password) != (before.pin, before.password)):
            count_wrong(connection, row.name)
            return EntryRefusedError(WRONG, row.name)
        return let_in(connection, row)


def check_badge(badge: str) -> str:
    """Return a badge number without what a scanner sends around it; AccountError where it is none."""
    number = _read(badge)[-1]
    if not (LEAST_BADGE <= len(number) <= LONGEST_BADGE and number.isascii() and number.isprintable()):
        allowed = f"{LEAST_BADGE} to {LONGEST_BADGE} printable ASCII characters"
        raise AccountError(f"badge: has {len(number)} characters; allowed are {allowed}. Scan the badge")
    return number


def check_pin(pin: str) -> None:
    """Refuse a PIN that is too short, no digits, or among the first that anybody would guess. Raises AccountError."""
    if not (LEAST_PIN <= len(pin) <= LONGEST_PIN and pin.isascii() and pin.isdecimal()):
        raise AccountError(
            f"pin: has {len(pin)} characters; allowed are {LEAST_PIN} to {LONGEST_PIN} digits. Choose another PIN"
        )
    if pin in EASY or len(set(pin)) == 1:
        raise AccountError("pin: is easy to guess. Choose another PIN")


def _salt(connection: Connection) -> bytes:
    found = connection.execute(select(BADGE_SALT.c.salt)).scalar()
    if found is None:
        found = secrets.token_hex(SALT_BYTES)
        connection.execute(insert(BADGE_SALT).values(number=1, salt=found))
    return bytes.fromhex(found)


def _read(badge: str) -> tuple[str, ...]:
    """Return how a badge may have been given that is scanned so: as it comes, then without an identifier."""
    return tuple(dict.fromkeys((badge.strip(), without_identifier(badge).strip())))


def _first(connection: Connection, wanted: Select[Any], digests: list[str]) -> Row[Any] | None:
    found = (connection.execute(wanted.where(BADGES.c.digest == one)).first() for one in digests)
    return next((row for row in found if row is not None), None)


def digest_with(salt: bytes, number: str) -> str:
    """Return the hash of a secret that may be short, as slow to guess as a badge number."""
    secret = number.encode(errors="replace")[: LONGEST_PASSWORD * 4]
    return hash_secret_raw(secret, salt, PASSES, MEMORY_KIB, LANES, DIGEST_BYTES, Type.ID).hex()
