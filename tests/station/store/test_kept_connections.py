"""A server that answers people all day keeps its connections to PostgreSQL; one that broke is made anew."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import text

from station.store import engine
from station.store.engine import Database, StoreError, keep_connections
from station.store.places import STORE_URL, StorePlace, store_place


@pytest.fixture(autouse=True)
def _kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "_KEPT", engine._Kept())


@pytest.fixture
def place(server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StorePlace:
    monkeypatch.setenv(STORE_URL, server)
    return store_place(tmp_path)


def backend(place: StorePlace) -> int:
    """Return the server's process that a look is answered by."""
    database = Database(place)
    try:
        with database.reading() as connection:
            return int(connection.execute(text("SELECT pg_backend_pid()")).scalar_one())
    finally:
        database.close()


def _half_done(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(text("CREATE TABLE half_done (id int)"))
        connection.execute(text("SELECT 1 / 0"))


def test_a_process_that_asks_for_it_keeps_its_connection(place: StorePlace) -> None:
    assert backend(place) != backend(place)
    keep_connections()
    assert backend(place) == backend(place)


def test_a_connection_that_broke_meanwhile_is_made_anew(place: StorePlace) -> None:
    keep_connections()
    first = backend(place)
    other = engine._engine(place.url)
    with other.begin() as connection:
        connection.execute(text(f"SELECT pg_terminate_backend({first})"))
    other.dispose()
    assert backend(place) != first


def test_a_look_that_failed_leaves_nothing_behind_in_a_kept_connection(place: StorePlace) -> None:
    keep_connections()
    database = Database(place)
    with pytest.raises(StoreError):
        _half_done(database)
    with database.reading() as connection:
        assert connection.execute(text("SELECT to_regclass('half_done')")).scalar() is None


def test_a_server_that_is_away_is_told_each_time(tmp_path: Path) -> None:
    keep_connections()
    nobody = StorePlace(f"postgresql+psycopg://u@127.0.0.1:1/{tmp_path.name}")
    for _ in range(2):
        with pytest.raises(StoreError):
            Database(nobody)


def test_a_file_beside_the_runs_is_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(STORE_URL, raising=False)
    keep_connections()
    database = Database(store_place(tmp_path))
    assert engine._KEPT.engine(database.place.url) is None
    database.close()
    assert not list(tmp_path.glob("*-wal"))
