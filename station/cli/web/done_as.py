"""A row of the table of actions, done at a terminal by whoever names themselves with `--as` and says their password.

The same roles, the same checks, the same lines of the audit trail as on the pages. The password is asked at the
terminal, or is a line of standard input.
"""

# ruff: noqa: PLC0415 - imports inside the functions keep --help fast

from __future__ import annotations

import getpass
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.errors import StationError

if TYPE_CHECKING:
    from pydantic import JsonValue

WhoOption = Annotated[str, typer.Option("--as", metavar="NAME", help="Your account; its password is asked for.")]


def done_as(data: Path, who: str, action: str, values: dict[str, JsonValue], **secret: str) -> None:
    """Do a row of the table of actions as somebody, and say so. secret: further values and how each is asked for.

    Raises:
        StationError: wrong name or password, or why the action was refused.

    """
    from station.web.actions.perform import perform
    from station.web.actions.row import OK
    from station.web.labels.settings import load_labels
    from station.web.mes.settings import load_mes
    from station.web.models import load_models
    from station.web.people import audit
    from station.web.people.accounts import EntryRefusedError, enter, has_accounts, is_name
    from station.web.people.database import FILE, StationDatabase
    from station.web.running import Running
    from station.web.settings import load_settings
    from station.web.station import Station

    if not (data / FILE).is_file() or not has_accounts(data):
        raise StationError(f"folder {data} has no accounts in {FILE}. Make the first account: 'lostmotion users first'")
    models, mes, settings, labels = load_models(data, None), load_mes(data), load_settings(data), load_labels(data)
    password = _asked(f"password of {who}")
    values = values | {name: password if not question else _asked(question) for name, question in secret.items()}
    station = Station(data, StationDatabase(data), models, Running(data), (), mes, settings, labels)
    try:
        session = enter(station.database, who, password)
        with station.database.writing() as connection:
            refused = isinstance(session, EntryRefusedError)
            audit.write(connection, who if is_name(who) else "?", "enter", audit.REFUSED if refused else audit.DONE, {})
        if isinstance(session, EntryRefusedError):
            raise StationError(f"--as {who}: log-in refused: {session}")
        answer = perform(station, action, session.token, session.csrf, secrets.token_hex(16), values)
        perform(station, "leave", session.token, session.csrf, secrets.token_hex(16), {})
    finally:
        station.close()
    if answer.status != OK:
        raise StationError(" ".join(one.text for one in answer.refused))
    sys.stdout.write(f"done: {action}\n")


def _asked(question: str) -> str:
    if sys.stdin.isatty():
        return getpass.getpass(f"{question}: ")
    return sys.stdin.readline().rstrip("\r\n")
