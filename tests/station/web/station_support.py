"""A station with an account of every role, and its requests."""

from __future__ import annotations

import uuid
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from argon2 import PasswordHasher
from fastapi import FastAPI
from lostmotion_command import ROOT
from sqlalchemy import insert
from starlette.testclient import TestClient
from starlette.types import ASGIApp, Receive, Scope, Send

from station.records.revisions.history import History
from station.records.revisions.revision import Revision, hash_of
from station.records.revisions.writing import ask_release, release, save_draft
from station.web.guard import Guard
from station.web.models import load_models
from station.web.people import accounts, badges
from station.web.people.accounts import COOKIE, ROLES, Person, open_session
from station.web.people.database import PEOPLE, StationDatabase
from station.web.rest.app import keeper_of, rest_of
from station.web.running import Running
from station.web.station import Station

PASSWORD = "good enough 1"  # noqa: S105 - of accounts that live for a test
FIRST = "the first one"
GOLDEN = ROOT / "tests" / "proofs" / "golden" / "golden.yaml"
HOST = "127.0.0.1:8080"

MODELS = """
models:
  - {model: BAD, serial: "BAD-[0-9]+", recipe: RECIPES/bad.yaml, attempts: 2}
  - {model: P1, serial: "SN-[0-9]+", recipe: RECIPES/good.yaml, attempts: 2}
"""
LEAST_SLOPE = {"good": 80, "bad": 200}
"""Limits of the torque ratio, by recipe: what makes a unit of each a good or a bad one."""


def released(data: Path, text: bytes) -> Revision:
    """Save a text as one person, and release it as another."""
    draft = save_draft(data, text, "the technician")
    ask_release(data, draft.name, draft.revision, draft.sha256, "the technician")
    return release(data, draft.name, draft.revision, draft.sha256, "the quality")


def write_models(data: Path) -> None:
    """Write the table of models and its recipes into a data folder, and release them."""
    recipes = data.parent / "recipes"
    recipes.mkdir(parents=True, exist_ok=True)
    data.mkdir(parents=True, exist_ok=True)
    golden = GOLDEN.read_text(encoding="utf-8")
    for name, least in LEAST_SLOPE.items():
        text = golden.replace("{id: torque_ratio_slope}", f"{{id: torque_ratio_slope, min: {least}}}")
        text = text.replace("name: golden", f"name: {name}")
        (recipes / f"{name}.yaml").write_text(text, encoding="utf-8")
        if History(data).released_with(hash_of(text.encode())) is None:
            released(data, text.encode())
    (data / "models.yaml").write_text(MODELS.replace("RECIPES", str(recipes)), encoding="utf-8")


OF_THE_STATION = accounts._HASHER
"""How the station hashes passwords: a quarter of a second of processor time each (`test_people.py`)."""

QUICK = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
accounts._HASHER = QUICK
accounts.NOBODY = badges.NOBODY = QUICK.hash(PASSWORD[::-1])
"""In the tests, whose passwords nobody guesses: a hash says itself how it was made, so a server that is a process of
its own checks it as quickly."""


@cache
def hashed() -> str:
    return QUICK.hash(PASSWORD)


def open_database(data: Path) -> StationDatabase:
    database = StationDatabase(data)
    rows = [{"name": f"the {role}", "role": role, "password": hashed()} for role in ROLES]
    with database.writing() as connection:
        connection.execute(insert(PEOPLE).values(must_change=False, failed=0, disabled=False), rows)
    return database


def station_in(data: Path, *, run_options: tuple[str, ...] = ("--pace", "fast", "--seed", "1")) -> Station:
    write_models(data)
    return Station(data, open_database(data), load_models(data, None), Running(data), run_options)


@dataclass
class Client:
    """A browser with nobody or somebody logged in."""

    http: TestClient
    csrf: str = ""

    def post(self, action: str, values: dict[str, Any] | None = None, **headers: str | None) -> Any:
        sent = {"X-CSRF-Token": self.csrf, "Idempotency-Key": uuid.uuid4().hex} | headers
        there = {name: value for name, value in sent.items() if value is not None}
        return self.http.post(f"/api/actions/{action}", json=values or {}, headers=there)


ASKED: ContextVar[Station] = ContextVar("ASKED")
"""The station that the request which is answered now was sent to."""


class Asked:
    """Whichever station is asked, for the one application of all tests: to make one takes a third of a second."""

    def __getattr__(self, name: str) -> Any:
        return getattr(ASKED.get(), name)


@cache
def _application() -> FastAPI:
    return rest_of(Asked(), secure=False)


def application_of(station: Station) -> ASGIApp:
    """Return the REST interface of a station, behind its guard."""

    async def asked(scope: Scope, receive: Receive, send: Send) -> None:
        ASKED.set(station)
        await _application()(scope, receive, send)

    return Guard(asked, [HOST], keeper_of(station))


def client_of(station: Station, role: str | None = None) -> Client:
    app = application_of(station)
    http = TestClient(app, base_url=f"http://{HOST}", headers={"Origin": f"http://{HOST}"})
    if role is None:
        return Client(http)
    with station.database.writing() as connection:
        session = open_session(connection, Person(f"the {role}", role))
    http.cookies.set(COOKIE, session.token)
    return Client(http, session.csrf)
