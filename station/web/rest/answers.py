"""What endpoints answer with: their statuses in the document, and refusals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import Cookie, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel

from station.web.actions.row import BAD_INPUT, NOT_ALLOWED, NOT_ENTERED, NOT_NOW, NOT_READY
from station.web.actions.values import Refused, refusal
from station.web.people.accounts import COOKIE

CookieToken = Annotated[str | None, Cookie(alias=COOKIE)]

Refuse = Callable[[str | None], Response | None]
"""What is answered to whoever is not logged in, by the session's cookie; None: let in."""

Documented = dict[str, Any]
"""Keyword arguments of the web library's decorators, whose types they are."""

MEANING = {
    200: "it was done", NOT_ENTERED: "log in first", NOT_ALLOWED: "not allowed for this role", 404: "there is none",
    NOT_NOW: "not now", BAD_INPUT: "bad input", NOT_READY: "disk problem, or too many requests: try again",
}  # fmt: skip


def answers(*statuses: int, ok: type[BaseModel] | None = None, media: str = "") -> Documented:
    """Return what the document says of the answers of an endpoint; media: of one that answers with a file."""
    told: dict[int | str, Documented] = {one: {"model": Refused, "description": MEANING[one]} for one in statuses}
    told[200] = {"description": MEANING[200], **({} if ok is None else {"model": ok})}
    if not media:
        return {"responses": told}
    told[200]["content"] = {media.partition(";")[0]: {}}
    return {"responses": told, "response_class": Response}


def refused_with(status: int, name: str, words: str) -> Response:
    """Return the answer to a request that is refused for one reason."""
    return JSONResponse(refusal(name, words).model_dump(), status)


def not_entered() -> Response:
    """Return the answer to whoever is not logged in."""
    return refused_with(NOT_ENTERED, "not_entered", "Log in first.")
