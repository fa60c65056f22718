"""PostgreSQL looks at a table that is divided by months as a whole when it has grown, which it never does by itself."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from benchmarks.many_runs import make_runs
from station.records.chain.chain_file import Chain
from station.store.outbox import rebuild
from station.store.places import STORE_URL
from station.store.plant import sizes
from station.store.plant.months import DIVIDED
from station.store.view import bring_up, keep_up, opened

WHOLE = text("SELECT relname, reltuples FROM pg_class WHERE relname = ANY(:tables) ORDER BY relname")
LONGEST_S = 60.0


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A few rows are many enough, also beside those of the other tests on this server."""
    monkeypatch.setattr(sizes, "LEAST_ROWS", 1)


def known(data: Path) -> dict[str, float]:
    """Return how many rows the database takes the whole tables to have."""
    with closing(opened(data)) as database, database.reading() as connection:
        return dict(connection.execute(WHOLE, {"tables": list(DIVIDED)}).tuples().all())


def forget(data: Path) -> None:
    """Leave the whole tables as they are before anybody has looked at them."""
    with closing(opened(data)) as database, database.writing() as connection:
        connection.execute(
            text("UPDATE pg_class SET reltuples = -1 WHERE relname = ANY(:tables)"), {"tables": list(DIVIDED)}
        )


def grown_tables(data: Path) -> list[str]:
    """Return the tables that have grown, as soon as the database has counted what was written."""
    until = time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        with closing(opened(data)) as database, database.reading() as connection:
            if found := sizes.grown(connection):
                return found
        time.sleep(0.1)
    return []


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    make_runs(folder, 3)
    return folder


def test_a_store_that_is_kept_up_learns_what_has_grown(data: Path, store_url: str | None) -> None:
    if store_url is None:
        assert keep_up(data, 60.0) == 0
        with closing(opened(data)) as database, database.reading() as connection:
            assert sizes.grown(connection) == []
        return
    assert bring_up(data, 60.0) == 0
    forget(data)
    assert grown_tables(data) == sorted(DIVIDED)
    assert keep_up(data, 60.0) == 0
    assert min(known(data).values()) >= 3
    with closing(opened(data)) as database, database.reading() as connection:
        assert sizes.grown(connection) == [], "once, until there are twice as many"


def test_a_store_that_was_made_anew_has_learnt_its_sizes(
    data: Path, server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(STORE_URL, server)
    bring_up(data, 60.0)
    forget(data)
    with closing(opened(data)) as database:
        rebuild(database, Chain(data))
    assert min(known(data).values()) >= 3
