"""Runs by REST: looked for, and the report of one as a page or a file. Nothing changes by GET."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from typing import Annotated, Any, Literal

from fastapi import Cookie, FastAPI, Query, Response
from fastapi.responses import JSONResponse

from station.errors import RecordError, StationError
from station.records.data_folder import Store
from station.reports.report_of_run import report_of
from station.store.run_search import MOST_ROWS, Wanted, search
from station.web.actions import NOT_NOW, Station, said
from station.web.people.accounts import COOKIE

LONGEST_TEXT = 100

CookieToken = Annotated[str | None, Cookie(alias=COOKIE)]

Kind = Literal["html", "pdf"]
MEDIA: dict[str, str] = {"html": "text/html; charset=utf-8", "pdf": "application/pdf"}

NOTHING_FROM_ELSEWHERE = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; base-uri 'none'"
"""A report stands alone: what it shows is in it, and nothing in it is a script."""

Verdict = Literal["PASS", "FAIL", "NOT DECIDABLE"]
Part = Annotated[str | None, Query(max_length=LONGEST_TEXT)]
Day = Annotated[date | None, Query(description="a day, as in 2026-01-31, by the computer's time zone")]


def begin_of(day: date | None, *, after: bool = False) -> str | None:
    """Return the moment at which a day begins, or at which it is over, as the runs have theirs: in UTC."""
    if day is None or (after and day == date.max):
        return None
    begin = datetime.combine(day + timedelta(days=1 if after else 0), datetime.min.time())
    try:
        return begin.astimezone().astimezone(UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):  # the years at both ends of the calendar have no time zone
        return begin.isoformat(timespec="milliseconds")


def add_runs(
    app: FastAPI, station: Station, refuse: Callable[[str | None], Response | None], answers: Callable[..., Any]
) -> None:
    """Add the endpoints; refuse: what is answered to whoever is not logged in, by the session's cookie."""

    @app.get("/api/runs", summary="runs, newest first", tags=["runs"], **answers(200, 401, 403, 422, 503))
    def runs(  # noqa: PLR0917 - every one is named in the address
        token: CookieToken = None,
        serial: Part = None,
        recipe: Part = None,
        verdict: Verdict | None = None,
        operator: Part = None,
        since: Day = None,
        until: Day = None,
        first: Annotated[int, Query(ge=0, le=10**9)] = 0,
        count: Annotated[int, Query(ge=1, le=MOST_ROWS)] = 100,
    ) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        wanted = Wanted(serial, recipe, verdict, operator, begin_of(since), begin_of(until, after=True))
        page = search(station.data, wanted, first=first, count=count)
        return JSONResponse({"total": page.total, "runs": [row._asdict() for row in page.rows]})

    @app.get(
        "/api/runs/{run}/report.{kind}", summary="the report of a run", tags=["runs"],
        **answers(200, 401, 403, 404, 409, 422, 503),
    )  # fmt: skip
    def report(run: str, kind: Kind, token: CookieToken = None) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        there = Store(station.data).by_id(run)
        if there is None:
            return JSONResponse(said("run", "There is no such run."), 404)
        try:
            html, pdf = report_of(there)
        except (RecordError, StationError) as error:
            return JSONResponse(said("run", str(error)), NOT_NOW)
        headers = {"Content-Security-Policy": NOTHING_FROM_ELSEWHERE}
        if kind == "pdf":
            headers["Content-Disposition"] = f'inline; filename="{there.id}.pdf"'
        return Response(html if kind == "html" else pdf, media_type=MEDIA[kind], headers=headers)
