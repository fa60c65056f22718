"""The station by REST: one endpoint for each row of the table of actions, and what may be read.

The document that describes them is at /api/openapi.json. Nothing changes by GET.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Annotated

from fastapi import Depends, FastAPI, Header, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field, JsonValue
from starlette.exceptions import HTTPException

from station.documents.entries import plain
from station.errors import StationError
from station.version import version
from station.web.actions.perform import perform
from station.web.actions.row import BAD_INPUT, NOT_ALLOWED, NOT_ENTERED, NOT_READY, Action
from station.web.actions.table import ACTIONS
from station.web.actions.values import Refused, refusal
from station.web.aqdef.outbox import waiting as aqdef_waiting
from station.web.bypasses import bypasses_now
from station.web.guard import Keep
from station.web.labels.outbox import awaited
from station.web.mes.outbox import waiting
from station.web.people import audit
from station.web.people.accounts import (
    COOKIE,
    LONGEST_NAME,
    LONGEST_PASSWORD,
    EntryRefusedError,
    Session,
    enter,
    is_name,
    session_of,
)
from station.web.people.badges import PinNeededError, enter_by_badge
from station.web.rest.answers import CookieToken, answers, not_entered, refused_with
from station.web.rest.batch import add_batch
from station.web.rest.recipes import add_recipes
from station.web.rest.runs import add_certificates, add_run_table, add_runs
from station.web.station import Station

AUDIT_ROLES = frozenset({"admin", "quality"})
MOST_LINES = 500
UNREADABLE = 400
LONGEST_SCAN = 512

CsrfToken = Annotated[str | None, Header(alias="X-CSRF-Token")]
RequestKey = Annotated[str | None, Header(alias="Idempotency-Key")]


class Entry(BaseModel):
    """Name and password."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(max_length=LONGEST_NAME)
    password: str = Field(max_length=LONGEST_PASSWORD)


class BadgeEntry(BaseModel):
    """The number of a badge, and its PIN or the account's password; '' first asks whether one is needed."""

    model_config = ConfigDict(extra="forbid")

    badge: str = Field(max_length=LONGEST_SCAN)
    secret: str = Field(default="", max_length=LONGEST_PASSWORD)


class Me(BaseModel):
    """Who is logged in, and the token that changes need."""

    name: str
    role: str
    must_change: bool
    csrf: str


def rest_of(station: Station, *, secure: bool) -> FastAPI:
    """Return the application with the REST interface; secure: it is reached by TLS."""
    app = FastAPI(
        title="lostmotion station", version=version(), openapi_url="/api/openapi.json", docs_url=None,
        redoc_url=None, redirect_slashes=False,
    )  # fmt: skip
    app.add_exception_handler(RequestValidationError, _refuse_input)
    app.add_exception_handler(HTTPException, _refuse_request)
    app.add_exception_handler(StationError, _not_ready)
    _add_entry(app, station, secure=secure)

    def refuse(token: str | None) -> Response | None:
        found = _session(station, token)
        if found is None:
            return not_entered()
        if found.person.must_change:
            return refused_with(NOT_ALLOWED, "must_change", "Choose a password of your own first.")
        return None

    _add_readings(app, station, refuse)
    add_runs(app, station, refuse)
    add_run_table(app, station, refuse)
    add_certificates(app, station, refuse)
    add_batch(app, station, refuse)
    add_recipes(app, station, refuse)
    for row in ACTIONS.values():
        doing = _endpoint(station, row)
        needed = any(one.is_required() for one in row.needs.model_fields.values())
        schema = {"required": needed, "content": {"application/json": {"schema": row.needs.model_json_schema()}}}
        app.post(
            f"/api/actions/{row.id}", summary=row.text, tags=["actions"], name=row.id,
            openapi_extra={"requestBody": schema}, **answers(200, 401, 403, 409, 422, 503, ok=row.gives),
        )(doing)  # fmt: skip
    return app


def _add_entry(app: FastAPI, station: Station, *, secure: bool) -> None:
    @app.post("/api/enter", summary="open a session", tags=["session"], **answers(200, 401, 422, 503, ok=Me))
    def open_session(given: Entry) -> Response:
        found = enter(station.database, given.name, given.password)
        refused = isinstance(found, EntryRefusedError)
        outcome = audit.REFUSED if refused else audit.DONE
        with station.database.writing() as connection:
            audit.write(connection, given.name if is_name(given.name) else "?", "enter", outcome, {})
        return refused_with(NOT_ENTERED, "entry", str(found)) if isinstance(found, EntryRefusedError) else opened(found)

    @app.post(
        "/api/enter_badge", summary="open a session with a badge", tags=["session"],
        **answers(200, 401, 422, 503, ok=Me),
    )  # fmt: skip
    def open_session_by_badge(given: BadgeEntry) -> Response:
        alone = station.settings.operator_by_badge_alone
        found = enter_by_badge(station.database, given.badge, given.secret, operator_alone=alone)
        if isinstance(found, PinNeededError):
            return refused_with(NOT_ENTERED, "pin", str(found))
        refused = isinstance(found, EntryRefusedError)
        name = found.name if isinstance(found, EntryRefusedError) else found.person.name
        outcome = audit.REFUSED if refused else audit.DONE
        with station.database.writing() as connection:
            audit.write(connection, name, "enter_badge", outcome, {"pin": bool(given.secret)})
        return refused_with(NOT_ENTERED, "entry", str(found)) if isinstance(found, EntryRefusedError) else opened(found)

    def opened(found: Session) -> Response:
        answer = _me(found)
        answer.set_cookie(COOKIE, found.token, httponly=True, samesite="strict", secure=secure, path="/")
        return answer

    @app.get(
        "/api/me", summary="who is logged in, and the token that changes need", tags=["session"],
        **answers(200, 401, 503, ok=Me),
    )  # fmt: skip
    def me(token: CookieToken = None) -> Response:
        found = _session(station, token)
        return not_entered() if found is None else _me(found)


def _add_readings(app: FastAPI, station: Station, refuse: Callable[[str | None], Response | None]) -> None:
    @app.get("/api/now", summary="state of the bench", tags=["bench"], **answers(200, 401, 403, 503))
    def now(token: CookieToken = None) -> Response:
        if (why_not := refuse(token)) is not None:
            return why_not
        found = station.running.now()
        with station.database.reading() as connection:
            bypasses = [str(one) for one in bypasses_now(connection)]
            left = None if station.mes is None else waiting(connection)
            label = None if station.labels is None else awaited(connection, station.labels)
            files = None if station.aqdef is None else aqdef_waiting(connection)
        return JSONResponse({
            "stage": found.stage, "serial": found.serial, "run": found.run, "attempt": found.attempt,
            "recipe": found.recipe, "refused": found.refused, "altered": list(found.altered),
            "state": None if found.view is None else found.view.state.name.lower(),
            "torque_nm": None if found.view is None else found.view.torque_nm,
            "windup_arcmin": None if found.view is None else found.view.windup_arcmin,
            "left_s": None if found.view is None else found.view.left_s,
            "verdict": found.verdict,
            "reasons": list(found.reasons),
            "badges": list(found.badges),
            "bypasses": bypasses,
            "label": None if label is None else label._asdict(),
            "webhooks": None if left is None else {"waiting": left.messages, "last_error": left.last_error},
            "aqdef": None if files is None else files._asdict(),
        })  # fmt: skip

    @app.get(
        "/api/bench", summary="inputs, outputs, interlocks and alarms of the bench, and the recovery after a fault",
        tags=["bench"], **answers(200, 401, 403, 503),
    )  # fmt: skip
    def bench(token: CookieToken = None) -> Response:
        if (why_not := refuse(token)) is not None:
            return why_not
        seen, standing = station.bench.look(), station.bench.standing()
        return JSONResponse({"seen": plain(seen), "way_back": plain(standing)})

    @app.get(
        "/api/audit", summary="the newest lines of the audit trail, and the hash of the last one", tags=["audit"],
        **answers(200, 401, 403, 422, 503),
    )  # fmt: skip
    def audit_lines(token: CookieToken = None, newest: Annotated[int, Query(ge=1, le=MOST_LINES)] = 100) -> Response:
        found = _session(station, token)
        if found is None:
            return not_entered()
        if found.person.role not in AUDIT_ROLES or found.person.must_change:
            text = f"allowed: {', '.join(sorted(AUDIT_ROLES))}, with a password of their own"
            return refused_with(NOT_ALLOWED, "role", text)
        with station.database.reading() as connection:
            head = audit.head_of(connection)
            lines = audit.lines_of(connection, newest)
        return JSONResponse({**head._asdict(), "newest": [one._asdict() for one in lines]})


def keeper_of(station: Station) -> Keep:
    """Return what writes an address that leads elsewhere into the audit trail, with whoever asked for it."""

    def keep(cookies: Mapping[str, str], path: str) -> None:
        with station.database.writing() as connection:
            found = session_of(connection, cookies.get(COOKIE))
            name = "?" if found is None else found.person.name
            audit.write(connection, name, "read", audit.REFUSED, {"path": path})

    return keep


def _endpoint(station: Station, row: Action) -> Callable[..., Response]:
    def do(
        body: Annotated[bytes, Depends(_body_of)],
        token: CookieToken = None,
        csrf: CsrfToken = None,
        key: RequestKey = None,
    ) -> Response:
        answer = perform(station, row.id, token, csrf, key, _values_in(body))
        return JSONResponse(answer.said.model_dump(mode="json"), answer.status)

    do.__doc__ = f"{row.text}. Roles: {', '.join(sorted(row.roles))}. Values: {row.needs.__doc__}"
    return do


def _session(station: Station, token: str | None) -> Session | None:
    with station.database.reading() as connection:
        return session_of(connection, token)


async def _body_of(request: Request) -> bytes:
    body: bytes = await request.body()
    return body


def _values_in(body: bytes) -> JsonValue:
    """Return what a body says; one that is no JSON is passed on as its text, which no action takes."""
    try:
        found: JsonValue = json.loads(body, parse_constant=_no_number) if body.strip() else None
    except (ValueError, RecursionError):
        return "no JSON: " + body[:40].decode(errors="replace")
    return found


def _no_number(name: str) -> JsonValue:
    """Refuse NaN and Infinity, which are no JSON."""
    raise ValueError(name)


def _me(found: Session) -> Response:
    person = found.person
    told = Me(name=person.name, role=person.role, must_change=person.must_change, csrf=found.csrf)
    return JSONResponse(told.model_dump())


def _refuse_input(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - it is registered for that
    places = [(".".join(str(part) for part in one["loc"][1:]) or "body", one["msg"]) for one in error.errors()]
    return JSONResponse(Refused.because(places).model_dump(), BAD_INPUT)


def _refuse_request(_request: Request, error: Exception) -> Response:
    """Refuse what is no request of this interface; a body that cannot be read is bad input as any other."""
    assert isinstance(error, HTTPException)  # noqa: S101 - it is registered for that
    status = BAD_INPUT if error.status_code == UNREADABLE else error.status_code
    return JSONResponse(refusal("request", str(error.detail)).model_dump(), status, error.headers)


def _not_ready(_request: Request, error: Exception) -> Response:
    return refused_with(NOT_READY, "station", str(error))
