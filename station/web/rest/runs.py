"""Runs by REST: looked for, and the files of one, made when they are asked for. Nothing changes by GET."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from typing import Annotated, Literal, NamedTuple
from urllib.parse import quote

from fastapi import Depends, FastAPI, Query, Response
from fastapi.responses import JSONResponse

from station.errors import StationError
from station.records.certificate_code import LONGEST_CODE, CodeError, attempts_of, check_code
from station.records.data_folder import LONGEST_SERIAL, Store
from station.records.run_record import RESULT, RunRecord
from station.reports.content import LOOP_CSV
from station.reports.stored_result import refuse_doubtful
from station.results.csv_cells import MARK
from station.results.export import LOCALES
from station.store.run_csv import csv_of
from station.store.run_search import MOST_ROWS, search
from station.store.run_table import run_table
from station.store.stored_runs import Wanted
from station.store.view import look_at
from station.web.actions.row import BAD_INPUT, NOT_NOW
from station.web.evaluations import Evaluations
from station.web.rest.answers import CookieToken, Refuse, answers, refused_with
from station.web.station import Station

LONGEST_TEXT = LONGEST_SERIAL
CSV = "text/csv; charset=utf-8"
MOST_IN_TABLE = 20_000
"""Runs in a table that the server makes beside its work; the command has no such limit."""

NOTHING_FROM_ELSEWHERE = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; base-uri 'none'"
"""A report stands alone: what it shows is in it, and nothing in it is a script."""

SHOWN = (
    "run", "serial", "attempt", "model", "recipe", "revision", "started", "operator", "state", "verdict", "virtual",
    "scenario", "master", "altered",
)  # fmt: skip
"""What the answer to a search says of a run."""


class RunFile(NamedTuple):
    """A file that is made of a run when it is asked for: what it is, its type, how it is made, and how it is called.

    ending: of its name, '' for one that is only looked at. disposition: whether a browser shows it or keeps it.
    """

    text: str
    media: str
    made: Callable[[Evaluations, RunRecord], bytes]
    ending: str = ""
    disposition: str = "attachment"


FILES: dict[str, RunFile] = {
    "report.html": RunFile(
        "the report of a run as a page", "text/html; charset=utf-8", lambda made, run: made.report(run)[0]
    ),
    "report.pdf": RunFile(
        "the report of a run as PDF", "application/pdf", lambda made, run: made.report(run)[1], ".pdf", "inline"
    ),
    LOOP_CSV: RunFile(
        "the loop of a run: torque, wind-up and segment of every branch", "text/csv; charset=utf-8",
        lambda made, run: made.loop_csv(run), "-loop.csv",
    ),
    "run.parquet": RunFile(
        "all samples of a run, as 'lostmotion export' writes them", "application/vnd.apache.parquet",
        lambda made, run: made.parquet(run), ".parquet",
    ),
}  # fmt: skip
"""The files of a run by the end of their address."""

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


def _wanted(  # noqa: PLR0917 - as they stand in the address
    serial: Part = None, unit: Part = None, model: Part = None, recipe: Part = None, verdict: Verdict | None = None,
    operator: Part = None, since: Day = None, until: Day = None,
) -> Wanted:  # fmt: skip
    """Return which runs are meant; serial: how the number begins, unit: all of it."""
    return Wanted(
        serial=unit, begins=serial, model=model, recipe=recipe, verdict=verdict, operator=operator,
        since=begin_of(since), until=begin_of(until, after=True),
    )  # fmt: skip


def add_runs(app: FastAPI, station: Station, refuse: Refuse) -> None:
    """Add the endpoints; refuse: what is answered to whoever is not logged in, by the session's cookie."""

    @app.get("/api/runs", summary="runs, newest first", tags=["runs"], **answers(200, 401, 403, 422, 503))
    def runs(
        wanted: Annotated[Wanted, Depends(_wanted)],
        token: CookieToken = None,
        first: Annotated[int, Query(ge=0, le=10**9)] = 0,
        count: Annotated[int, Query(ge=1, le=MOST_ROWS)] = 100,
    ) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        page = search(station.data, wanted, first=first, count=count)
        shown = [
            {name: getattr(row, name) for name in SHOWN} | {"attempts": page.attempts.get(row.run)} for row in page.rows
        ]
        return JSONResponse({"total": page.total, "behind": page.behind, "runs": shown})

    @app.get("/api/runs/{run}", summary="the result of a run", tags=["runs"], **answers(200, 401, 403, 404, 409, 503))
    def result(run: str, token: CookieToken = None) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        there = Store(station.data).by_id(run)
        if there is None or not there.has(RESULT):
            return refused_with(404, "run", "There is no such run with a result.")
        try:
            refuse_doubtful(there)
            return JSONResponse(there.read_json(RESULT))
        except StationError as error:
            return refused_with(NOT_NOW, "run", str(error))

    for path, row in FILES.items():
        told = answers(200, 401, 403, 404, 409, 503, media=row.media)
        app.get(f"/api/runs/{{run}}/{path}", summary=row.text, tags=["runs"], name=path, **told)(
            _file_endpoint(station, refuse, row)
        )


def add_run_table(app: FastAPI, station: Station, refuse: Refuse) -> None:
    """Add the endpoint of the table of runs; as `add_runs`."""

    @app.get(
        "/api/runs.csv", summary="runs with their metrics, oldest first, a row a run, as a table for a spreadsheet",
        tags=["runs"], **answers(200, 401, 403, 422, 503, media=CSV),
    )  # fmt: skip
    def table(
        wanted: Annotated[Wanted, Depends(_wanted)],
        token: CookieToken = None,
        locale: Literal["en", "de"] = "en",
    ) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        total = search(station.data, wanted, first=0, count=1).total
        if total > MOST_IN_TABLE:
            words = (
                f"{total} runs fit; a table has at most {MOST_IN_TABLE}. Ask for fewer, or use 'lostmotion runs --csv'."
            )
            return refused_with(BAD_INPUT, "count", words)
        with look_at(station.data) as view:
            text = MARK + csv_of(run_table(view, wanted), LOCALES[locale])
        kept = {"Content-Disposition": 'attachment; filename="runs.csv"'}
        return Response(text.encode(), media_type=CSV, headers=kept)


def _file_endpoint(station: Station, refuse: Refuse, row: RunFile) -> Callable[..., Response]:
    def file(run: str, token: CookieToken = None) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        there = Store(station.data).by_id(run)
        if there is None:
            return refused_with(404, "run", "There is no such run.")
        try:
            content = row.made(station.evaluations, there)
        except StationError as error:
            return refused_with(NOT_NOW, "run", str(error))
        headers = {"Content-Security-Policy": NOTHING_FROM_ELSEWHERE}
        if row.ending:
            name = quote(f"{there.id}{row.ending}", safe="")
            headers["Content-Disposition"] = f"{row.disposition}; filename*=UTF-8''{name}"
        return Response(content, media_type=row.media, headers=headers)

    return file


def add_certificates(app: FastAPI, station: Station, refuse: Refuse) -> None:
    """Add the endpoint that checks certificates; as `add_runs`."""

    @app.get(
        "/api/certificates", summary="whether a certificate is genuine, altered or unknown, by its code",
        tags=["runs"], **answers(200, 401, 403, 422, 503),
    )  # fmt: skip
    def certificate(code: Annotated[str, Query(max_length=LONGEST_CODE)], token: CookieToken = None) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        try:
            found = check_code(station.data, code)
        except CodeError as error:
            return refused_with(BAD_INPUT, "code", str(error))
        return JSONResponse({
            "certificate": found.standing, "text": found.text, "run": found.run, "serial": found.serial,
            "attempt": found.attempt, "attempts": attempts_of(found), "verdict": found.verdict,
            "aside": found.aside, "since": [str(one) for one in found.since],
        })  # fmt: skip
