"""Recipes by REST: which revisions there are, the text of one as a file, what `check` says of it, and the dry run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import FastAPI, Response
from fastapi import Path as InPath
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict

from recipes.text.section import Name
from station.documents.entries import plain
from station.errors import StationError
from station.records.revisions.history import History
from station.records.revisions.revision import State
from station.web.actions.row import NOT_NOW
from station.web.recipe_text.check import look_at
from station.web.rest.answers import CookieToken, Refuse, answers, refused_with
from station.web.station import Station

YAML = "application/yaml"
Number = Annotated[int, InPath(ge=1, le=1_000_000)]


class ToldRevision(BaseModel):
    """What is told of a revision."""

    model_config = ConfigDict(from_attributes=True)

    name: str
    revision: int
    sha256: str
    state: State
    shipped: bool
    authors: tuple[str, ...]
    saved: str
    asked_by: str
    sent_back_by: str
    reason: str
    released_by: str
    released: str


class Recipes(BaseModel):
    """Every revision of every recipe, and what is wrong with those that cannot be read."""

    revisions: tuple[ToldRevision, ...]
    problems: tuple[str, ...]


def add_recipes(app: FastAPI, station: Station, refuse: Refuse) -> None:
    """Add the endpoints; refuse: what is answered to whoever is not logged in, by the session's cookie."""

    @app.get(
        "/api/recipes",
        summary="recipes with their revisions",
        tags=["recipes"],
        **answers(200, 401, 403, 503, ok=Recipes),
    )
    def recipes(token: CookieToken = None) -> Response:
        return refuse(token) or _listed(station)

    @app.get(
        "/api/recipes/{name}/{revision}.yaml", summary="the text of a revision", tags=["recipes"],
        **answers(200, 401, 403, 404, 409, 422, 503, media=YAML),
    )  # fmt: skip
    def text(name: Name, revision: Number, token: CookieToken = None) -> Response:
        return refuse(token) or _of_text(station, name, revision, lambda content: _as_file(name, revision, content))

    @app.get(
        "/api/recipes/{name}/{revision}/check", summary="what 'lostmotion check' says of a revision",
        tags=["recipes"], **answers(200, 401, 403, 404, 409, 422, 503),
    )  # fmt: skip
    def check(name: Name, revision: Number, token: CookieToken = None) -> Response:
        return refuse(token) or _of_text(station, name, revision, lambda content: _checked(station, content))

    @app.get("/api/dry-run", summary="the newest dry run of a recipe", tags=["recipes"], **answers(200, 401, 403, 503))
    def dry_run(token: CookieToken = None) -> Response:
        return refuse(token) or _tried(station)


def _listed(station: Station) -> Response:
    history = History(station.data)
    told = tuple(ToldRevision.model_validate(one) for one in history.all())
    return JSONResponse(Recipes(revisions=told, problems=tuple(history.problems)).model_dump(mode="json"))


def _of_text(station: Station, name: str, revision: int, answer: Callable[[bytes], Response]) -> Response:
    """Answer with the text of a revision, or why it cannot be had."""
    found = History(station.data).find(name, revision)
    if found is None:
        return refused_with(404, "recipe", "There is no such revision.")
    try:
        return answer(found.text())
    except StationError as error:
        return refused_with(NOT_NOW, "recipe", str(error))


def _as_file(name: str, revision: int, content: bytes) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}-r{revision}.yaml"'}
    return Response(content, media_type=YAML, headers=headers)


def _checked(station: Station, content: bytes) -> Response:
    looked = look_at(content, station.models)
    return JSONResponse({
        "fit": looked.job is not None, "peak_torque_nm": looked.peak_nm, "duration_s": looked.duration_s,
        "messages": [
            {"line": one.line, "column": one.column, "text": one.text, "warning": one.is_warning}
            for one in looked.messages
        ],
        "load_profile": [{"t_s": t_s, "torque_nm": torque_nm} for t_s, torque_nm in looked.load_profile],
    })  # fmt: skip


def _tried(station: Station) -> Response:
    now = station.dry_runs.now()
    return JSONResponse({
        "stage": now.stage, "recipe": now.title, "sha256": now.sha256, "said": now.said, "took_s": now.took_s,
        "result": None if now.result is None else plain(now.result),
    })  # fmt: skip
