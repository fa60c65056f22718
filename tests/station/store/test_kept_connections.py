"""What a process keeps of a database from one look to the next: statements, and connections where it asks for that."""

from __future__ import annotations

import os
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from threading import Thread

import pytest
from sqlalchemy import select, text

from station.store import engine
from station.store.engine import Database, StoreError
from station.store.engines import ENGINES, IN_MEMORY, MOST_ENGINES, Engines, new_engine
from station.store.places import FILE, STORE_URL, StorePlace, store_place
from station.store.tables import RUNS


@pytest.fixture(autouse=True)
def engines(monkeypatch: pytest.MonkeyPatch) -> Engines:
    """The engines of a process that has just begun."""
    own = Engines()
    monkeypatch.setattr(engine, "ENGINES", own)
    return own


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


def runs_in(place: StorePlace) -> int:
    with closing(Database(place)) as database, database.reading() as connection:
        return int(connection.execute(text("SELECT count(*) FROM runs")).scalar_one())


def _half_done(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(text("CREATE TABLE half_done (id int)"))
        connection.execute(text("SELECT 1 / 0"))


def test_a_process_that_asks_for_it_keeps_its_connection(place: StorePlace, engines: Engines) -> None:
    assert backend(place) != backend(place)
    engines.keep_connections()
    assert backend(place) == backend(place)


def test_a_connection_that_broke_meanwhile_is_made_anew(place: StorePlace, engines: Engines) -> None:
    engines.keep_connections()
    first = backend(place)
    other = new_engine(place.url)
    with other.begin() as connection:
        connection.execute(text(f"SELECT pg_terminate_backend({first})"))
    other.dispose()
    assert backend(place) != first


def test_a_look_that_failed_leaves_nothing_behind_in_a_kept_connection(place: StorePlace, engines: Engines) -> None:
    engines.keep_connections()
    database = Database(place)
    with pytest.raises(StoreError):
        _half_done(database)
    with database.reading() as connection:
        assert connection.execute(text("SELECT to_regclass('half_done')")).scalar() is None


def test_a_server_that_is_away_is_told_each_time(tmp_path: Path, engines: Engines) -> None:
    engines.keep_connections()
    nobody = StorePlace(f"postgresql+psycopg://u@127.0.0.1:1/{tmp_path.name}")
    for _ in range(2):
        with pytest.raises(StoreError):
            Database(nobody)


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StorePlace:
    monkeypatch.delenv(STORE_URL, raising=False)
    return store_place(tmp_path)


def test_a_file_beside_the_runs_is_closed(tmp_path: Path, beside: StorePlace, engines: Engines) -> None:
    engines.keep_connections()
    database = Database(beside)
    assert list(tmp_path.glob("*-wal"))
    database.close()
    assert not list(tmp_path.glob("*-wal"))
    database.close()  # once more changes nothing for others
    assert engines.take(beside.url) is engines.take(beside.url)


def test_the_next_look_has_the_statements_of_the_one_before(beside: StorePlace) -> None:
    with closing(Database(beside)) as first:
        pass
    with closing(Database(beside)) as second:
        assert first._engine is second._engine


@pytest.mark.parametrize("other", [IN_MEMORY, "sqlite:///{}/other.sqlite3"])
def test_a_statement_is_put_into_the_words_of_sqlite_once_for_all_of_its_files(
    tmp_path: Path, beside: StorePlace, other: str
) -> None:
    said = []
    for place in (beside, StorePlace(other.format(tmp_path))):
        with closing(Database(place)) as database, database.reading() as connection:
            said.append(connection.execute(select(RUNS.c.run)).context.compiled)
    assert said[0] is said[1]


def test_a_file_that_was_put_in_the_place_of_another_is_what_the_next_look_sees(
    tmp_path: Path, beside: StorePlace
) -> None:
    with closing(Database(beside)) as database, database.writing() as connection:
        connection.execute(text("CREATE TABLE seen (id int)"))
    for file in tmp_path.iterdir():
        file.unlink()
    with closing(Database(beside)) as database, database.reading() as connection:
        assert not connection.execute(text("SELECT 1 FROM sqlite_master WHERE name = 'seen'")).all()


def test_a_file_in_the_place_of_another_is_seen_also_while_looks_overlap(tmp_path: Path, beside: StorePlace) -> None:
    with closing(Database(beside)) as longer, longer.reading() as old:
        assert old.execute(text("SELECT count(*) FROM runs")).scalar() == 0
        with closing(Database(beside)) as database, database.writing() as connection:
            connection.execute(text("CREATE TABLE seen (id int)"))
        for file in tmp_path.iterdir():
            file.unlink()
        with closing(Database(beside)) as database, database.writing() as connection:
            assert not connection.execute(text("SELECT 1 FROM sqlite_master WHERE name = 'seen'")).all()
            connection.execute(text("CREATE TABLE new (id int)"))
    with sqlite3.connect(tmp_path / FILE) as there:
        assert there.execute("SELECT 1 FROM sqlite_master WHERE name = 'new'").fetchall() == [(1,)]


def test_a_look_that_pythons_collector_ends_does_not_wait_for_its_own_thread(
    beside: StorePlace, engines: Engines
) -> None:
    database = Database(beside)

    def close_within() -> None:
        with engines._lock:  # where the collector may run
            database.close()

    thread = Thread(target=close_within, daemon=True)
    thread.start()
    thread.join(60.0)
    assert not thread.is_alive()


def test_a_look_that_ends_leaves_those_of_other_threads_alone(beside: StorePlace) -> None:
    with closing(Database(beside)) as longer, longer.reading() as connection:
        for _ in range(3):
            Database(beside).close()
        assert connection.execute(text("SELECT count(*) FROM runs")).scalar() == 0
    with ThreadPoolExecutor(20) as threads:
        looks = [threads.submit(runs_in, beside) for _ in range(200)]
    assert [look.result() for look in looks] == [0] * 200


def test_of_many_databases_the_newest_are_kept(tmp_path: Path, engines: Engines) -> None:
    used = [engines.take(f"sqlite:///{tmp_path}/{number}.sqlite3") for number in range(3 * MOST_ENGINES)]
    assert len(engines._engines) == 3 * MOST_ENGINES
    for one in used:
        engines.let_go(one)
    assert list(engines._engines.values()) == used[-MOST_ENGINES:]
    memory = engines.take(IN_MEMORY)
    assert engines.take(IN_MEMORY) is not memory


def test_a_process_that_was_forked_off_uses_no_connection_of_its_parent(
    beside: StorePlace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "ENGINES", ENGINES)  # which hears of forks
    database = Database(beside)
    child = os.fork()
    if child == 0:
        database.close()  # of the parent: nothing is closed
        with closing(Database(beside)) as own:
            os._exit(0 if own._engine is not database._engine else 1)
    assert os.waitpid(child, 0)[1] == 0
    with database.reading() as connection:
        assert connection.execute(text("SELECT count(*) FROM runs")).scalar() == 0
    database.close()
