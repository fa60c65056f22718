"""A store that is locked, damaged, away or of another version: told, set aside, and the answers stay the same."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from errno import EACCES
from pathlib import Path

import pytest
from lostmotion_command import here
from sqlalchemy import text
from stored_runs import ASK, metric, rows_in, store_lot, store_run

from station.cli.line.stored_values import stored_values
from station.records.chain.chain_file import Chain
from station.store.engine import FREE_SPACE, Database, StoreError
from station.store.outbox import catch_up
from station.store.places import FILE, STORE_URL
from station.store.table_counts import behind, counts
from station.store.view import bring_up, opened


@pytest.fixture
def plain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv(STORE_URL, raising=False)
    return store_lot(tmp_path / "runs")


def test_a_locked_store_is_waited_for_and_then_done_without(
    plain: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("station.store.engine.BUSY_S", 0.1)
    rows_in(plain)
    store_run(plain, "U0", [metric(0.45)])
    lock = sqlite3.connect(plain / FILE, isolation_level=None)
    lock.execute("BEGIN IMMEDIATE")
    assert len(stored_values(plain, ASK).values) == 7
    assert "database is locked" in capsys.readouterr().err
    with pytest.raises(StoreError, match="database is locked"):
        bring_up(plain, 1.0)
    lock.rollback()
    lock.close()
    assert bring_up(plain, 5.0) == 0
    assert len(stored_values(plain, ASK).values) == 7


def test_a_full_disk_is_told_as_one(plain: Path) -> None:
    """SQLite refuses to grow its file beyond a number of pages as it does on a full disk, with the same code."""
    rows_in(plain)
    with closing(opened(plain)) as database:
        with pytest.raises(StoreError) as refused:
            _fill(database)
        assert "database or disk is full" in str(refused.value)
        assert FREE_SPACE in str(refused.value)


def test_a_file_that_may_not_be_read_is_no_full_disk(plain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """13 is `EACCES` of the system, and SQLite's number for a full disk."""

    def refuse(_url: object) -> None:
        raise PermissionError(EACCES, "Permission denied")

    monkeypatch.setattr("station.store.engine.ENGINES.take", refuse)
    with pytest.raises(StoreError, match="Permission denied") as refused:
        opened(plain)
    assert FREE_SPACE not in str(refused.value)


def _fill(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(text("PRAGMA max_page_count = 1"))
        connection.execute(text("CREATE TABLE more AS SELECT zeroblob(100000)"))


@pytest.mark.parametrize("damage", [b"this is no database" * 100, b""])
def test_a_damaged_or_empty_store_takes_nothing_from_the_answers(plain: Path, damage: bytes) -> None:
    rows_in(plain)
    for name in (FILE, f"{FILE}-wal", f"{FILE}-shm"):
        (plain / name).unlink(missing_ok=True)
    (plain / FILE).write_bytes(damage)
    assert len(stored_values(plain, ASK).values) == 6


@pytest.mark.parametrize(
    "said", ["problems = 'xx'", "problems = '[[1]]'", "\"offset\" = 'abc'", "counter = -1", "keys = '[1]'"]
)
def test_a_damaged_row_of_the_chain_is_told_and_made_again(plain: Path, said: str) -> None:
    rows_in(plain)
    with sqlite3.connect(plain / FILE) as there:
        there.execute(f"UPDATE projections SET {said}")  # noqa: S608 - of this test
    there.close()
    listed = here("list", "--data", str(plain))
    assert (listed.exit_code, "lostmotion store rebuild" in listed.err) == (0, True)
    assert here("store", "state", "--data", str(plain)).exit_code == 2
    assert here("store", "rebuild", "--data", str(plain)).exit_code == 0
    assert here("store", "state", "--data", str(plain)).exit_code == 0


def test_rows_that_are_left_of_runs_whose_others_are_gone_are_made_again(plain: Path) -> None:
    before = rows_in(plain)
    with sqlite3.connect(plain / FILE) as there:
        for table in ("runs", "attempts", "projections"):
            there.execute(f"DELETE FROM {table}")  # noqa: S608 - of this test
    there.close()
    assert rows_in(plain) == before


@pytest.mark.parametrize("damage", ["bytes", "cut", "table"])
def test_a_damaged_store_of_its_own_is_set_aside_and_made_again(plain: Path, damage: str) -> None:
    before = rows_in(plain)
    file = plain / FILE
    if damage == "table":
        with sqlite3.connect(file) as there:
            there.execute("DROP TABLE runs")
        there.close()
    else:
        file.write_bytes(b"this is no database" * 999 if damage == "bytes" else file.read_bytes()[:9000])
    bad = file.read_bytes()
    listed = here("list", "--data", str(plain))
    assert (listed.exit_code, "lostmotion store rebuild" in listed.err) == (0, True)
    assert here("store", "rebuild", "--data", str(plain)).exit_code == 0
    assert rows_in(plain) == before
    aside = [one for one in plain.iterdir() if one.name.startswith(f"{FILE}.damaged-")]
    assert bad in [one.read_bytes() for one in aside]


def test_a_damaged_store_that_was_named_is_left_alone(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = tmp_path / "named.sqlite3"
    named.write_bytes(b"this is no database" * 999)
    monkeypatch.setenv(STORE_URL, f"sqlite:///{named}")
    assert here("store", "rebuild", "--data", str(plain)).exit_code == 2
    assert named.read_bytes() == b"this is no database" * 999


def test_a_server_that_is_not_there_is_told_and_done_without(
    plain: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(STORE_URL, "postgresql://nobody:secret@127.0.0.1:9/none")
    assert len(stored_values(plain, ASK).values) == 6
    said = capsys.readouterr().err
    assert "postgresql+psycopg://nobody@127.0.0.1:9/none: the store of runs cannot be used" in said
    assert "secret" not in said


def test_a_run_is_measured_and_judged_without_a_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    golden = Path(__file__).parents[2] / "proofs" / "golden" / "golden.yaml"
    words = ("--virtual-time", "--json", "--no-report", "--serial", "S", "--data", str(tmp_path / "d"))
    with_store = here("run", str(golden), *words)
    monkeypatch.setenv(STORE_URL, "postgresql://nobody@127.0.0.1:9/none")
    without = here("run", str(golden), *words)
    assert without.exit_code == with_store.exit_code
    assert without.json["verdict"] == with_store.json["verdict"]
    assert "the store is brought up later" in without.err
    monkeypatch.delenv(STORE_URL)
    database = opened(tmp_path / "d")
    assert behind(database, Chain(tmp_path / "d")) == 2
    assert catch_up(database, Chain(tmp_path / "d")) == 0
    assert counts(database, Chain(tmp_path / "d"))["runs"] == 2
    database.close()


def test_a_store_of_a_newer_version_is_left_as_it_is(plain: Path) -> None:
    rows_in(plain)
    with sqlite3.connect(plain / FILE) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(StoreError, match="version 9999"):
        opened(plain)
    assert len(stored_values(plain, ASK).values) == 6


def test_a_table_that_is_there_without_a_version_is_not_taken_over(plain: Path) -> None:
    with sqlite3.connect(plain / FILE) as connection:
        connection.execute("CREATE TABLE runs (chain TEXT)")
    with pytest.raises(StoreError, match="runs"):
        opened(plain)
