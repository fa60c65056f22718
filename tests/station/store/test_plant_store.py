"""The store at the size of a plant: hours say what the runs say, months hold the runs, an older store comes along."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from older_store import to_version_0005
from sqlalchemy import inspect, select, text
from stored_runs import metric, store_run

from analysis.trace.errors import AnalysisError
from station.errors import StationError
from station.quality.figures import causes_of, trend_of, yield_of
from station.records.chain.chain_file import Chain
from station.store import stored_runs as stored
from station.store.engine import StoreError
from station.store.outbox import put_runs, rebuild, remove_runs
from station.store.places import STORE_URL
from station.store.plant.hours import whole_hours
from station.store.plant.meanings import meanings_of, put_meanings
from station.store.plant.months import DIVIDED, make_months
from station.store.quality.counts import GROUPINGS
from station.store.quality.lot import Lot, Production, production
from station.store.rows.projection import ANY_ROW
from station.store.run_search import search
from station.store.stored_runs import Wanted
from station.store.table_counts import all_rows
from station.store.tables import RUNS
from station.store.view import another_recipe, bring_up, look_at, opened

COUNT = 60
BEFORE_ALL = "2001-01-01T00:30:00.000+00:00"
"""Half past an hour: from then on means all runs, and is asked of the runs themselves."""

MIDDAY = "2026-01-06T12:00:00.000+00:00"

KINDS: tuple[dict[str, Any], ...] = (
    {}, {}, {}, {"failed": "lost_motion"}, {"reasons": ["measurement invalid: drift"]}, {"state": "stopped"},
    {"virtual": "P1"}, {"master": "PASS"}, {"revision": 2}, {"scenario": "slow.yaml"},
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of every kind: two recipes, operators, four days, a third of the units measured again, one run altered."""
    data, dice = tmp_path_factory.mktemp("plant") / "runs", random.Random(17)  # noqa: S311 - no secret
    for number in range(COUNT):
        value = 1000.0 + dice.gauss(0.0, 0.001)
        what = {"operator": dice.choice(["A", "B", None]), "day": dice.random() * 4} | dice.choice(KINDS)
        kept = None if dice.random() < 0.1 else value
        recipe = "other" if number % 7 == 0 else "inverse"
        store_run(data, f"U{number % 45}", [metric(kept), metric(value / 3, id="backlash")], recipe=recipe, **what)
    altered = store_run(data, "ALTERED", [metric(9.0)], day=1.0)
    (altered.folder / "recipe.yaml").write_bytes(b"changed\n")
    return data


@pytest.fixture
def plant(made: Path, store_url: str | None) -> Path:
    """The same runs in both databases, to be asked only."""
    del store_url
    bring_up(made, 60.0)
    return made


@pytest.fixture
def plant_to_change(plant: Path) -> Iterator[Path]:
    """The same, made again after a test that changed it."""
    yield plant
    database = opened(plant)
    rebuild(database, Chain(plant))
    database.close()


LOTS = {
    "all": Lot(recipe="inverse"),
    "every recipe": Lot(),
    "until midday": Lot(recipe="inverse", until=MIDDAY),
    "from midday": Lot(recipe="inverse", since=MIDDAY),
    "a model": Lot(recipe="inverse", model="RV"),
    "no such bench": Lot(recipe="inverse", bench="none"),
    "virtual": Lot(recipe="inverse", virtual=True),
}


@pytest.mark.parametrize("name", LOTS)
def test_the_hours_say_what_the_runs_say(plant: Path, name: str) -> None:
    """The same lot asked of the hours, and of the runs themselves as it begins or ends within an hour."""
    lot = LOTS[name]
    by_runs = lot._replace(until=MIDDAY.replace(":00.000", ":00.001")) if lot.until else lot
    by_runs = by_runs._replace(since=MIDDAY.replace(":00.000", ":00.001") if lot.since else BEFORE_ALL)
    assert whole_hours(lot.since, lot.until)
    assert not whole_hours(by_runs.since, by_runs.until)
    with production(plant) as look:
        (counts, numbers), (counts_by_runs, numbers_by_runs) = _figures(look, lot), _figures(look, by_runs)
    assert counts == counts_by_runs
    assert numbers == pytest.approx(numbers_by_runs, rel=1e-7, abs=1e-12)  # of 1000.000 with a spread of 0.001


def _figures(look: Production, lot: Lot) -> tuple[list[Any], list[float]]:
    """Return what the figures count, and what they calculate."""
    try:
        yields = [yield_of(look, lot, by) for by in (None, *GROUPINGS)]
        counts: list[Any] = [(one.whole, one.groups) for one in yields]
        causes = causes_of(look, lot)
    except StationError as error:
        return [str(error)], []
    counts += [causes.first_attempts, causes.failed, causes.alarms, causes.undecided]
    numbers: list[float] = []
    for by in GROUPINGS:
        try:
            one = trend_of(look, lot, "lost_motion", by).compared
        except (StationError, AnalysisError) as error:
            counts.append(str(error))
        else:
            counts.append([(group.name, group.number) for group in one.groups])
            numbers += [one.mean, one.sd_within, one.sd_between, one.p_same]
            numbers += [number for group in one.groups for number in (group.mean, group.sd or 0.0)]
    return counts, numbers


def test_whether_a_chain_has_rows_is_told_by_one_of_them(plant: Path) -> None:
    database, chain = opened(plant), Chain(plant)
    with database.reading() as connection:
        assert len(connection.execute(ANY_ROW, {"chain": chain.id}).all()) == 1
        assert not connection.execute(ANY_ROW, {"chain": "of nobody"}).all()
    database.close()


WITHIN_AN_HOUR = MIDDAY.replace(":00:00", ":17:00")
SEARCHES = (
    Wanted(), Wanted(verdict="FAIL"), Wanted(operator="A", since=MIDDAY), Wanted(master="PASS"),
    Wanted(recipe="other", until=MIDDAY), Wanted(begins="U1"), Wanted(serial="U7"), Wanted(model="none"),
    Wanted(since=BEFORE_ALL), Wanted(until=WITHIN_AN_HOUR), Wanted(since=WITHIN_AN_HOUR, verdict="PASS"),
)  # fmt: skip


def test_the_number_of_runs_found_is_that_of_the_runs(plant: Path) -> None:
    for one in SEARCHES:
        found = search(plant, one, count=500)
        assert found.total == len(found.rows), one


@pytest.mark.parametrize("dearer", [0, 10**9])
def test_runs_are_found_alike_past_those_between_and_by_their_hours(
    plant: Path, dearer: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is found is what was asked for, newest first, page by page, whichever way the database goes."""
    monkeypatch.setattr(stored, "DEARER_BY_HOUR", dearer)
    every = search(plant, Wanted(), count=500).rows
    names = ("serial", "model", "recipe", "verdict", "operator", "master")
    for one in SEARCHES:
        asked = {name: value for name in names if (value := getattr(one, name)) is not None}
        right = [
            row.run
            for row in sorted(every, key=lambda row: row.run, reverse=True)
            if all(getattr(row, name) == value for name, value in asked.items())
            and row.serial.startswith(one.begins or "")
            and (one.since or "") <= row.started < (one.until or "9")
        ]
        pages = [row.run for first in (0, 7, 14) for row in search(plant, one, first=first, count=7).rows]
        assert pages == right[:21], one


def test_recipes_and_models_are_told_each_once(plant: Path) -> None:
    found = search(plant, Wanted(), count=500)
    assert found.recipes == tuple(sorted({row.recipe for row in found.rows}))
    assert found.models == tuple(sorted({row.model for row in found.rows}))


def test_hours_and_retests_are_those_of_a_store_that_is_made_anew(plant_to_change: Path) -> None:
    """Runs that go, come again and change leave the counts as if they had come in one go."""
    database, chain = opened(plant_to_change), Chain(plant_to_change)
    before = all_rows(database, chain)
    up_to = {"projections": before["projections"]}  # it goes with what is taken out: the next look puts in all again
    with database.reading() as connection:
        runs = connection.execute(select(RUNS.c.run).where(RUNS.c.chain == chain.id)).scalars().all()
        again = connection.execute(select(RUNS.c.run).where(RUNS.c.chain == chain.id, RUNS.c.again)).scalars().all()
    assert 0 < len(again) < len(runs)
    dice = random.Random(3)  # noqa: S311 - no secret
    for _ in range(5):
        some = dice.sample(list(runs), 15)
        remove_runs(database, chain, some)
        assert all_rows(database, chain)["run_hours"] != before["run_hours"]
        dice.shuffle(some)
        for one in some:
            put_runs(database, chain, [one])
        assert all_rows(database, chain) | up_to == before
    rebuild(database, chain)
    assert all_rows(database, chain) == before
    database.close()


def test_every_month_is_a_partition_and_the_next_one_is_made_ahead(
    server: str, made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(STORE_URL, server)
    database = opened(made)
    odd = ["20311231T235959.999Z-X", "U-1", "99991231T000000.000Z-X", "20310199"]
    bring_up(made, 60.0)
    with database.writing() as connection:
        make_months(connection, odd)
        names = set(inspect(connection).get_table_names())
        for table in DIVIDED:
            assert {f"{table}_203112", f"{table}_203201", f"{table}_rest"} <= names
            assert not {f"{table}_203101", f"{table}_999912"} & names
        row = dict(connection.execute(select(RUNS).limit(1)).mappings().one())
        for run in odd:
            connection.execute(RUNS.insert(), [row | {"run": run, "chain": "odd"}])
        found = connection.execute(text("SELECT run, tableoid::regclass::text FROM runs WHERE chain = 'odd'"))
        assert dict(found.tuples().all()) == {odd[0]: "runs_203112"} | dict.fromkeys(odd[1:], "runs_rest")
        connection.execute(RUNS.delete().where(RUNS.c.chain == "odd"))
    database.close()


def test_a_store_of_the_version_before_has_the_rows_of_one_that_is_made_anew(plant_to_change: Path) -> None:
    database, chain = opened(plant_to_change), Chain(plant_to_change)
    before = all_rows(database, chain)
    with database.writing() as connection:
        to_version_0005(connection)
    database.close()
    assert bring_up(plant_to_change, 60.0) == 0  # the chain is walked anew
    database = opened(plant_to_change)
    assert all_rows(database, chain) == before
    with database.reading() as connection:
        if connection.dialect.name == "postgresql":
            names = set(inspect(connection).get_table_names())
            assert {f"{table}_{run}" for table in DIVIDED for run in ("rest", before["runs"][0][1][:6])} <= names
    database.close()


def test_a_big_store_of_the_version_before_waits_for_a_rebuild(
    plant_to_change: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run that begins does not wait for it, and a look reads the folders; `store rebuild` brings it up."""
    monkeypatch.setattr("station.store.engine.FEW_RUNS", 10)
    database, chain = opened(plant_to_change), Chain(plant_to_change)
    before = all_rows(database, chain)
    with database.writing() as connection:
        to_version_0005(connection)
    database.close()
    with pytest.raises(StoreError, match=r"version 0005 and more than 10 runs.*'lostmotion store rebuild'"):
        another_recipe(plant_to_change, "inverse", 1, "", most_s=1.0)
    with look_at(plant_to_change) as view:
        assert len(view.runs) == len(before["attempts"])
    assert "store rebuild" in capsys.readouterr().err
    assert here("store", "rebuild", "--data", str(plant_to_change)).exit_code == 0
    database = opened(plant_to_change)
    assert all_rows(database, chain) == before
    database.close()


def test_two_meanings_of_one_number_are_refused(plant: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their values would be taken for those of one kind."""
    database, chain = opened(plant), Chain(plant)
    with database.reading() as connection:
        number, there = next(iter(meanings_of(connection, chain.id).items()))
    monkeypatch.setattr("station.store.plant.meanings.number_of", lambda _: number)
    with pytest.raises(StoreError, match=f"{number} stands for two meanings"), database.writing() as connection:
        put_meanings(connection, chain.id, [there, there._replace(unit="arcsec")])
    database.close()
