"""What a row of the table of actions is, what it works on, and what becomes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from sqlalchemy import Connection

from station.documents.entries import Plain
from station.errors import StationError
from station.web.actions.values import Outcome, Reason, Refused, Values
from station.web.people.accounts import Person, Session
from station.web.station import Station

OK, BAD_INPUT, NOT_ENTERED, NOT_ALLOWED, NOT_NOW, NOT_READY = 200, 422, 401, 403, 409, 503


class Answer(NamedTuple):
    """What became of an action: an HTTP status, and what it answers or why it was refused."""

    status: int
    said: Outcome | Refused

    @property
    def refused(self) -> tuple[Reason, ...]:
        """Every reason of a refusal; none when it was done."""
        return self.said.refused if isinstance(self.said, Refused) else ()


class NotNowError(StationError):
    """The action is allowed, and cannot be done now; `reasons`: id and words of each."""

    def __init__(self, reasons: list[tuple[str, str]]) -> None:
        super().__init__(" ".join(words for _, words in reasons))
        self.reasons = reasons


@dataclass(frozen=True)
class Call:
    """One action being done: by whom, in which transaction and session."""

    station: Station
    connection: Connection
    session: Session

    @property
    def person(self) -> Person:
        """Who does it."""
        return self.session.person

    @property
    def operator(self) -> str | None:
        """Who measures, as the record names them; None where nobody has said."""
        return None if self.person.name == self.session.place else self.person.name


SECRETS = frozenset({"password", "old_password", "new_password", "pin", "badge", "scanned"})
"""Values that are secret, or may be: the number of a badge may be scanned in the place of a unit."""


class Action(NamedTuple):
    """One row: id, roles, what it needs, what it does, what that answers, and what stands in the audit trail.

    sees: what it changes, as it is; seen before and after it. audited: which of its values. tells: what of its answer.
    reaches_out: it does something that no transaction of the database undoes, such as starting a process or signing a
    line elsewhere. So it is noted before it is done: a server that is killed in it leaves a line of the trail too.
    """

    id: str
    text: str
    roles: frozenset[str]
    needs: type[Values]
    does: Callable[[Call, Any], Outcome]
    gives: type[Outcome]
    sees: Callable[[Call, Any], Plain]
    audited: tuple[str, ...] = ()
    with_first_password: bool = False
    tells: tuple[str, ...] = ()
    reaches_out: bool = False

    @property
    def is_secret(self) -> bool:
        """Whether it is asked with a secret, which is nowhere kept so that it can be guessed quickly."""
        return not SECRETS.isdisjoint(self.needs.model_fields)
