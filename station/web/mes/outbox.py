"""Webhooks: what the MES is told of runs, from an outbox that is kept in the station's database.

The chain of runs is the source: each entry that seals a run becomes one message, in the transaction that notes how far
the chain was read. So a kill at any moment loses none and makes none twice. A message stays until the MES has answered
it with 2xx; then the next of the same serial number is sent. The MES may get one twice where its answer was lost: the
`Idempotency-Key` tells it. A run neither knows nor waits for any of this.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, NamedTuple

from sqlalchemy import Connection, func, insert, select, update

from station.documents.entries import plain
from station.documents.manifest import Manifest
from station.documents.result import Result
from station.errors import StationError
from station.records.chain.entries import Fields
from station.records.run_record import RunRecord
from station.reports.headline import manifest_badges
from station.results.sealed_runs import result_of
from station.wall_clock import WALL_CLOCK, now_text
from station.web.mes.previous_step import heard
from station.web.mes.settings import MesSettings, read_secret
from station.web.people import audit
from station.web.people.database import MES_CONTACT, WEBHOOKS, WEBHOOKS_READ, StationDatabase
from station.web.people.read_chain import begin_at_the_end, read_on

if TYPE_CHECKING:
    import httpx

RESULT_SEALED, ALIVE = "result", "alive"
SIGNATURE, TIMESTAMP, KEY = "X-Lostmotion-Signature", "X-Lostmotion-Timestamp", "Idempotency-Key"

FIRST_WAIT_S, LONGEST_WAIT_S = 1.0, 60.0
"""Wait before a message is sent again: doubled each time, up to the longest."""

LOOK_EVERY_S = 0.5
ALIVE_SHARE = 3
"""How often within `away_after_s` a MES that has nothing to be told is asked whether it is there."""

LONGEST_REASON = 200

NOT_A_PRODUCT: dict[str, Callable[[Manifest], object]] = {
    "simulated": manifest_badges,
    "faults_injected": lambda run: run.scenario,
    "master_part": lambda run: run.unit.master,
    "study": lambda run: run.study,
}
"""Why the verdict of a run is not that of a product: a virtual unit or bench, faults, a master part, a guided study."""


@dataclass(frozen=True)
class SealedRun:
    """What the MES is told of a run: the chain's own words, its result where that is as it was sealed, and the trail.

    not_a_product: why the verdict is not that of a product, of `NOT_A_PRODUCT`; None where the record cannot be read.
    altered: why no result is told; none where it is. audit: lines and hash of the audit trail as the run was collected.
    """

    run: str
    serial: str
    attempt: int
    state: str
    verdict: str | None
    not_a_product: tuple[str, ...] | None
    sha256: str
    sealed_at: str
    result: Result | None
    altered: tuple[str, ...]
    audit: audit.Head
    kind: str = RESULT_SEALED


class _Record(NamedTuple):
    """What a message says of the record of a run, as `SealedRun`."""

    altered: tuple[str, ...]
    result: Result | None
    not_a_product: tuple[str, ...] | None


class Waiting(NamedTuple):
    """What the MES has not taken yet: how many messages, and why the last attempt failed ('' : none has)."""

    messages: int
    last_error: str


def signature(secret: bytes, timestamp: str, body: bytes) -> str:
    """Return the signature of a message: HMAC-SHA256 over time stamp, a full stop and the body, as hexadecimal."""
    return "sha256=" + hmac.new(secret, timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


def waiting(connection: Connection) -> Waiting:
    """Return what has not been delivered."""
    left = WEBHOOKS.c.delivered_at.is_(None)
    count = connection.execute(select(func.count()).select_from(WEBHOOKS).where(left)).scalar_one()
    newest = select(WEBHOOKS.c.last_error).where(left & (WEBHOOKS.c.tries > 0)).order_by(WEBHOOKS.c.number).limit(1)
    return Waiting(count, connection.execute(newest).scalar() or "")


def begin_here(database: StationDatabase, data: Path) -> None:
    """Note where the chain ends when the MES is set up: earlier runs are not told."""
    with database.writing() as connection:
        begin_at_the_end(connection, WEBHOOKS_READ, data)


def collect(database: StationDatabase, data: Path) -> int:
    """Put a message into the outbox for each run that was sealed since the last look; return how many.

    Raises:
        StationError: the chain or the database cannot be read.

    """
    return len(read_on(database, data, WEBHOOKS_READ, lambda fields: _read(data, fields["run"]), _put))


def _read(data: Path, run: str) -> _Record:
    altered, result = result_of(data, run)
    try:
        manifest = RunRecord(data / run).manifest()
    except StationError:
        return _Record(tuple(altered), result, None)
    return _Record(tuple(altered), result, tuple(name for name, applies in NOT_A_PRODUCT.items() if applies(manifest)))


def _put(connection: Connection, messages: Sequence[tuple[Fields, _Record]]) -> None:
    head = audit.head_of(connection)
    for fields, record in messages:
        told = {name: fields[name] for name in ("run", "serial", "attempt", "state", "verdict", "sha256")}
        message = SealedRun(**told, **record._asdict(), sealed_at=fields["time"], audit=head)
        key = f"{RESULT_SEALED}:{message.run}:{message.sha256[:16]}"
        if connection.execute(select(WEBHOOKS.c.number).where(WEBHOOKS.c.key == key)).first() is None:
            body = json.dumps(plain(message), ensure_ascii=False, sort_keys=True)
            connection.execute(insert(WEBHOOKS).values(key=key, serial=message.serial, body=body, tries=0, next_s=0.0))


class Sender:
    """A thread of the server that delivers the outbox, and asks a quiet MES whether it is there."""

    def __init__(self, database: StationDatabase, data: Path, settings: MesSettings) -> None:
        """Prepare it; StationError where the secret cannot be had."""
        self._database, self._data, self._settings = database, data, settings
        self._secret = read_secret(data, settings)
        self._end = Event()
        self._thread = Thread(target=self._loop, name="webhooks", daemon=True)
        self._asked_s = 0.0
        begin_here(database, data)

    def start(self) -> None:
        """Begin to deliver."""
        self._thread.start()

    def close(self) -> None:
        """End: what is not delivered is kept for the next start."""
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=self._settings.timeout_s + LOOK_EVERY_S)

    def _loop(self) -> None:
        import httpx  # noqa: PLC0415 - only where there is a MES

        # without the proxies of the environment: a MES is a neighbour
        with httpx.Client(timeout=self._settings.timeout_s, trust_env=False) as http:
            told = ""
            while not self._end.wait(LOOK_EVERY_S):
                try:
                    self.look(http)
                    why = ""
                except (StationError, ValueError, KeyError) as error:
                    why = f"webhooks  nothing is sent: {error}\n"  # nothing is lost either: it is looked at again
                if why != told:
                    sys.stderr.write(why)
                told = why

    def look(self, http: httpx.Client) -> None:
        """Collect what is new and send what is due."""
        collect(self._database, self._data)
        now_s = WALL_CLOCK.now().timestamp()
        due = _due(self._database, now_s)
        for number, key, body, tries in due:
            if self._end.is_set():
                return
            error = self._send(http, key, body.encode())
            with self._database.writing() as connection:
                tried = update(WEBHOOKS).where(WEBHOOKS.c.number == number).values(tries=tries + 1, last_error=error)
                if error:
                    wait_s = min(LONGEST_WAIT_S, FIRST_WAIT_S * 2.0 ** min(tries, 16))
                    tried = tried.values(next_s=WALL_CLOCK.now().timestamp() + wait_s)
                else:
                    tried = tried.values(delivered_at=now_text())
                    heard(connection)
                connection.execute(tried)
        if not due:
            self._ask(http, now_s)

    def _ask(self, http: httpx.Client, now_s: float) -> None:
        every_s = self._settings.away_after_s / ALIVE_SHARE
        with self._database.reading() as connection:
            heard_s = connection.execute(select(MES_CONTACT.c.heard_s)).scalar() or 0.0
        if abs(now_s - max(heard_s, self._asked_s)) < every_s:
            return
        self._asked_s = now_s
        body = json.dumps({"kind": ALIVE}).encode()
        if not self._send(http, f"{ALIVE}:{now_s:.3f}", body):
            with self._database.writing() as connection:
                heard(connection)

    def _send(self, http: httpx.Client, key: str, body: bytes) -> str:
        """Send a message; return why it was not taken, '' where it was."""
        import httpx  # noqa: PLC0415 - only where there is a MES

        timestamp = str(int(WALL_CLOCK.now().timestamp()))
        headers = {
            "Content-Type": "application/json", KEY: key, TIMESTAMP: timestamp,
            SIGNATURE: signature(self._secret, timestamp, body),
        }  # fmt: skip
        try:
            answer = http.post(self._settings.url, content=body, headers=headers)
        except (httpx.HTTPError, httpx.InvalidURL, UnicodeError) as error:
            return f"{type(error).__name__}: {error}"[:LONGEST_REASON]
        return "" if answer.is_success else f"answered {answer.status_code}"


def _due(database: StationDatabase, now_s: float) -> list[tuple[int, str, str, int]]:
    """Return number, key, body and tries of the oldest message of each serial number that is due.

    None waits for more than the longest wait: a clock that was set back meanwhile holds no message up.
    """
    due = (WEBHOOKS.c.next_s <= now_s) | (WEBHOOKS.c.next_s > now_s + LONGEST_WAIT_S)
    with database.reading() as connection:
        oldest = (
            select(func.min(WEBHOOKS.c.number)).where(WEBHOOKS.c.delivered_at.is_(None)).group_by(WEBHOOKS.c.serial)
        )
        wanted = (
            select(WEBHOOKS.c.number, WEBHOOKS.c.key, WEBHOOKS.c.body, WEBHOOKS.c.tries)
            .where(WEBHOOKS.c.number.in_(oldest) & due)
            .order_by(WEBHOOKS.c.number)
        )
        return [(row.number, row.key, row.body, row.tries) for row in connection.execute(wanted)]
