"""The proof of PostgreSQL's plans at a small size: every question of the ten has the indexes that it needs."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from benchmarks import many_runs, plant_store
from benchmarks.store_plans import QUESTIONS, Sizes, full_scans, plan_of, scans_of, sizes_of, statements_sent
from station.store.places import STORE_URL
from station.store.plant.months import DIVIDED
from station.store.view import opened

RUNS = 4_000
BEGIN = datetime(2024, 1, 26, tzinfo=UTC)
"""Eleven days of two months."""


@pytest.fixture(scope="module")
def small_plant(server: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("plans") / "runs"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(STORE_URL, server)
        patch.setattr(plant_store, "REAL", 5)
        for module in (plant_store, many_runs):
            patch.setattr(module, "FIRST", BEGIN)
        plant_store.make_store(data, RUNS)
    return data


def test_no_question_needs_a_table_as_a_whole(small_plant: Path, server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With scans of whole tables made dear, as they are at a plant's size, the planner finds a way without."""
    monkeypatch.setenv(STORE_URL, server)
    database = opened(small_plant)
    for name, ask in QUESTIONS.items():
        with statements_sent() as sent:
            ask(small_plant)
        assert sent, name
        with database.reading() as connection:
            connection.exec_driver_sql("SET LOCAL enable_seqscan = off")
            for one in sent:
                scans = scans_of(plan_of(connection, one, analyze=False)["Plan"])
                whole = {scan.table for scan in scans if scan.kind.endswith("Seq Scan")}
                assert not [table for table in whole if table.startswith(DIVIDED)], (name, one.text)
    database.close()


def test_a_table_that_is_read_as_a_whole_is_refused(
    small_plant: Path, server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(STORE_URL, server)
    database = opened(small_plant)
    with database.reading() as connection, statements_sent() as sent:
        connection.exec_driver_sql("SELECT sum(value) FROM metrics WHERE uncertainty > 0")
    with database.reading() as connection:
        sizes = sizes_of(connection)
        plan = plan_of(connection, sent[0])
        found = full_scans(plan, sizes)
    assert [one for one in found if one.endswith("rows of metrics")]
    small = Sizes(dict.fromkeys(sizes.rows, 100), sizes.whole)
    assert full_scans(plan, small) == []
    database.close()
