"""The station by REST: one endpoint for each row of the table of actions, and what may be read.

The document that describes them is at /api/openapi.json. Nothing changes by GET.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from fastapi import Cookie, FastAPI, Header, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field

from station.errors import StationError
from station.records.run_record import MANIFEST, RESULT, RunRecord
from station.version import version
from station.web.actions import ACTIONS, NOT_ENTERED, Action, Station, perform
from station.web.people import audit
from station.web.people.accounts import EntryRefusedError, Session, enter, session_of

COOKIE = "lostmotion_session"
AUDIT_ROLES = frozenset({"admin", "quality"})
MOST_LINES = 500

CookieToken = Annotated[str | None, Cookie(alias=COOKIE)]
CsrfToken = Annotated[str | None, Header(alias="X-CSRF-Token")]
RequestKey = Annotated[str | None, Header(alias="Idempotency-Key")]


class Entry(BaseModel):
    """Name and password."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(max_length=64)
    password: str = Field(max_length=200)


def rest_of(station: Station, *, secure: bool) -> FastAPI:
    """Return the application with the REST interface; secure: it is reached by TLS."""
    app = FastAPI(
        title="lostmotion station", version=version(), openapi_url="/api/openapi.json", docs_url=None,
        redoc_url=None,
    )  # fmt: skip
    _add_entry(app, station, secure=secure)
    _add_readings(app, station)
    for row in ACTIONS.values():
        doing = _endpoint(station, row)
        app.post(f"/api/actions/{row.id}", summary=row.text, tags=["actions"], name=row.id)(doing)
    return app


def _add_entry(app: FastAPI, station: Station, *, secure: bool) -> None:
    @app.post("/api/enter", summary="open a session", tags=["session"])
    def open_session(given: Entry) -> Response:
        with station.database.writing() as connection:
            found = enter(connection, given.name, given.password)
            refused = isinstance(found, EntryRefusedError)
            outcome = audit.REFUSED if refused else audit.DONE
            audit.write(connection, given.name if given.name.isprintable() else "?", "enter", outcome, {})
        if isinstance(found, EntryRefusedError):
            return JSONResponse({"refused": [{"id": "entry", "text": str(found)}]}, NOT_ENTERED)
        answer = JSONResponse(_me(found))
        answer.set_cookie(COOKIE, found.token, httponly=True, samesite="strict", secure=secure, path="/")
        return answer

    @app.get("/api/me", summary="who is logged in, and the token that changes need", tags=["session"])
    def me(token: CookieToken = None) -> Response:
        found = _session(station, token)
        return _not_entered() if found is None else JSONResponse(_me(found))


def _add_readings(app: FastAPI, station: Station) -> None:
    @app.get("/api/now", summary="what the bench does", tags=["bench"])
    def now(token: CookieToken = None) -> Response:
        if _session(station, token) is None:
            return _not_entered()
        found = station.running.now()
        return JSONResponse({
            "stage": found.stage, "serial": found.serial, "run": found.run, "attempt": found.attempt,
            "recipe": found.recipe, "refused": found.refused, "altered": list(found.altered),
            "state": None if found.view is None else found.view.state.name.lower(),
            "torque_nm": None if found.view is None else found.view.torque_nm,
            "windup_arcmin": None if found.view is None else found.view.windup_arcmin,
            "left_s": None if found.view is None else found.view.left_s,
            "verdict": None if found.result is None else found.result.verdict,
            "reasons": [] if found.result is None else list(found.result.reasons),
        })  # fmt: skip

    @app.get("/api/runs/{run}", summary="the result of a run", tags=["runs"])
    def result(run: str, token: CookieToken = None) -> Response:
        if _session(station, token) is None:
            return _not_entered()
        there = RunRecord(station.data / run)
        if Path(run).name != run or not there.has(MANIFEST) or not there.has(RESULT):
            return JSONResponse({"refused": [{"id": "run", "text": "There is no such run with a result."}]}, 404)
        try:
            return JSONResponse(there.read_json(RESULT))
        except StationError as error:
            return JSONResponse({"refused": [{"id": "run", "text": str(error)}]}, 409)

    @app.get("/api/audit", summary="the newest lines of the audit trail, and its head", tags=["audit"])
    def audit_lines(token: CookieToken = None, newest: int = 100) -> Response:
        found = _session(station, token)
        if found is None:
            return _not_entered()
        if found.person.role not in AUDIT_ROLES or found.person.must_change:
            text = f"allowed: {', '.join(sorted(AUDIT_ROLES))}, with a password of their own"
            return JSONResponse({"refused": [{"id": "role", "text": text}]}, 403)
        with station.database.writing() as connection:
            head = audit.head_of(connection)
            lines = audit.lines_of(connection, min(max(newest, 1), MOST_LINES))
        return JSONResponse({"lines": head.lines, "head_sha256": head.sha256, "newest": lines})


def _endpoint(station: Station, row: Action) -> Callable[..., Response]:
    def do(
        values: dict[str, Any] | None = None,
        token: CookieToken = None,
        csrf: CsrfToken = None,
        key: RequestKey = None,
    ) -> Response:
        answer = perform(station, row.id, token, csrf, key, values)
        return JSONResponse(answer.body, answer.status)

    do.__doc__ = f"{row.text}. Roles: {', '.join(sorted(row.roles))}. Values: {row.needs.__doc__}"
    return do


def _session(station: Station, token: str | None) -> Session | None:
    with station.database.writing() as connection:
        return session_of(connection, token)


def _me(found: Session) -> dict[str, Any]:
    person = found.person
    return {"name": person.name, "role": person.role, "must_change": person.must_change, "csrf": found.csrf}


def _not_entered() -> Response:
    return JSONResponse({"refused": [{"id": "not_entered", "text": "Log in first."}]}, NOT_ENTERED)
