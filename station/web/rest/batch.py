"""The report of a batch by REST: made of a lot when it is asked for, beside the server."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import FastAPI, Query, Response

from analysis.trace.errors import AnalysisError
from recipes import RecipeError
from station.errors import StationError
from station.quality.batch.zipped import batch_zip
from station.store.quality.lot import Lot
from station.web.actions.row import BAD_INPUT, NOT_NOW
from station.web.rest.answers import CookieToken, Refuse, answers, refused_with
from station.web.rest.runs import Part
from station.web.station import Station

ZIP = "application/zip"
ADDRESS = "/api/batch.zip"
LOOPS = (0, 10, 30)
"""How many loops the page offers to draw."""

MOST_LOOPS = 60
"""So many take a minute, in which nobody else gets a report."""

Moment = Annotated[datetime | None, Query(description="a moment with its time zone, as 2026-01-05T08:00:00+00:00")]


def address_fields(lot: Lot) -> dict[str, str]:
    """Return a lot as it stands in the address."""
    named = {name: getattr(lot, name) for name in ("recipe", "model", "since", "until")}
    return {name: str(value) for name, value in named.items() if value is not None} | {
        "virtual": "true" if lot.virtual else "false"
    }


def add_batch(app: FastAPI, station: Station, refuse: Refuse) -> None:
    """Add the endpoint; refuse: what is answered to whoever is not logged in."""

    @app.get(
        ADDRESS, summary="the report of a batch: page, PDF and tables as CSV, in one ZIP file", tags=["runs"],
        **answers(200, 401, 403, 409, 422, 503, media=ZIP),
    )  # fmt: skip
    def batch(  # noqa: PLR0917 - every one is named in the address
        token: CookieToken = None,
        recipe: Part = None,
        model: Part = None,
        bench: Part = None,
        since: Moment = None,
        until: Moment = None,
        virtual: bool = False,  # noqa: FBT001, FBT002 - as above
        loops: Annotated[int, Query(ge=0, le=MOST_LOOPS)] = 10,
        locale: Literal["en", "de"] = "en",
    ) -> Response:
        refused = refuse(token)
        if refused is not None:
            return refused
        if any(one is not None and one.tzinfo is None for one in (since, until)):
            return refused_with(BAD_INPUT, "since", "A moment needs its time zone, as in 2026-01-05T08:00:00+00:00.")
        lot = Lot(recipe, model, bench, _text(since), _text(until), virtual)
        try:
            content = station.evaluations.figure(batch_zip, station.data, lot, loops, locale)
        except (StationError, AnalysisError, RecipeError) as error:
            return refused_with(NOT_NOW, "batch", str(error).replace(f"{station.data}: ", ""))
        headers = {"Content-Disposition": 'attachment; filename="batch.zip"'}
        return Response(content, media_type=ZIP, headers=headers)


def _text(moment: datetime | None) -> str | None:
    """Return a moment as the runs have theirs."""
    if moment is None:
        return None
    try:
        return moment.astimezone(UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError):  # at both ends of the calendar
        return moment.replace(tzinfo=UTC).isoformat(timespec="milliseconds")
