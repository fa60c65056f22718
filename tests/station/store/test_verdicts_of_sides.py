"""Each side of a metric stands in the store with its own verdict; that of the metric is the worst of them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select, text, update
from stored_runs import metric, store_run

from station.quality.dfq.write import dfq_of_lot
from station.quality.figures import causes_of
from station.records.chain.chain_file import Chain
from station.store.attempts import not_passed
from station.store.engine import HEAD
from station.store.outbox import rebuild
from station.store.plant.hours import count_all_hours
from station.store.quality.counts import FailedMetric, failures, undecided
from station.store.quality.guard_bands import GuardBands
from station.store.quality.lot import Lot, production
from station.store.quality.trial import Rule, flips, tried_runs
from station.store.quality.values import characteristic
from station.store.stored_runs import COLUMNS, StoredRun
from station.store.table_counts import all_rows
from station.store.tables import METRICS, RUNS
from station.store.view import bring_up, look_at, opened

HALF_PAST = "2001-01-01T00:30:00.000+00:00"
"""From half past an hour on the runs themselves are asked, and not the hours."""

LOTS = {"by the hours": Lot(), "by the runs": Lot(since=HALF_PAST)}
UNDECIDED = "NOT DECIDABLE"
RANKS = {None: -1, "PASS": 0, UNDECIDED: 1, "FAIL": 2}

SIDES: dict[str, tuple[str | None, str | None]] = {
    "the other side fails": ("PASS", "FAIL"),
    "both sides fail": ("FAIL", "FAIL"),
    "this side fails": ("FAIL", "PASS"),
    "this side is too near": ("NOT DECIDABLE", "FAIL"),
    "the other side is too near": ("PASS", UNDECIDED),
    "both sides are too near": (UNDECIDED, UNDECIDED),
    "both pass": ("PASS", "PASS"),
    "the sides do not say it": (None, None),
}
"""Verdict of the side + that the metric goes by, and of the side -."""


def of_sides(plus: str | None, minus: str | None, values: tuple[float, float] = (0.9, 1.1)) -> dict[str, Any]:
    """A metric by its sides; where they say nothing it fails as a whole."""
    sides = {
        side: {"value": value, "uncertainty": 0.01, "verdict": verdict}
        for side, value, verdict in (("+", values[0], plus), ("-", values[1], minus))
    }
    whole = "FAIL" if plus is None else max(plus, minus, key=RANKS.__getitem__)
    return metric(values[0], uncertainty=0.01, verdict=whole, sides=sides)


@pytest.fixture
def data(tmp_path: Path, store_url: str | None) -> Path:
    del store_url
    for day, (serial, verdicts) in enumerate(SIDES.items()):
        one = of_sides(*verdicts)
        ends = {"FAIL": {"failed": "lost_motion"}, UNDECIDED: {"reasons": ["lost_motion: too near"]}}
        store_run(tmp_path, serial, [one], day=day, **ends.get(one["verdict"], {}))
    return tmp_path


def verdicts_in(connection: Any, chain: str) -> dict[str, dict[str, str | None]]:
    together = (RUNS.c.chain == METRICS.c.chain) & (RUNS.c.run == METRICS.c.run)
    asked = select(RUNS.c.serial, METRICS.c.side, METRICS.c.verdict).select_from(RUNS).join(METRICS, together)
    found: dict[str, dict[str, str | None]] = {}
    for serial, side, verdict in connection.execute(asked.where(RUNS.c.chain == chain, METRICS.c.position == 0)):
        found.setdefault(serial, {})[side] = verdict
    return found


def test_every_row_has_the_verdict_of_its_side_and_the_worst_is_the_metrics(data: Path) -> None:
    with production(data) as look:
        found = verdicts_in(look.connection, look.chain.id)
    for serial, (plus, minus) in SIDES.items():
        assert found[serial] == {"+": "FAIL" if plus is None else plus, "-": minus}, serial


@pytest.mark.parametrize("name", LOTS)
def test_causes_count_the_sides_that_fail_and_a_metric_once(data: Path, name: str) -> None:
    with production(data) as look:
        failed, reasons = failures(look, LOTS[name]), undecided(look, LOTS[name])
        shown = {one.name: one.number for one in causes_of(look, LOTS[name]).failed}
    assert failed == Counter(
        {FailedMetric("lost_motion", "", "mean", "+"): 3, FailedMetric("lost_motion", "", "mean", "-"): 3}
    )
    assert shown == {"lost_motion mean side +": 3, "lost_motion mean side −": 3}
    assert reasons["lost_motion too near its limit"] == 2


def test_what_a_run_did_not_pass_is_told_by_the_worst_side(data: Path) -> None:
    with look_at(data) as view, view.database.reading() as connection:
        asked = select(*COLUMNS).where(RUNS.c.chain == view.chain.id)
        runs = [StoredRun._make(row) for row in connection.execute(asked).all()]
        told = not_passed(connection, view.chain, runs)
    serials = {run.run: run.serial for run in runs}
    assert {serials[run]: titles for run, titles in told.items()} == {
        serial: ("Lost motion",) for serial in SIDES if serial != "both pass"
    }


def test_aqdef_marks_the_value_that_fails_and_not_the_one_that_passes(tmp_path: Path) -> None:
    store_run(tmp_path, "SN", [of_sides("PASS", "FAIL")], failed="lost_motion")
    with production(tmp_path) as look:
        line = dfq_of_lot(look, Lot(), "a test").files[0].content.decode("latin-1").splitlines()[-2]
    plus, minus = (entry.split("\x14")[-1].split(",") for entry in line.split("\x0f"))
    assert ("4" in plus, "4" in minus) == (False, True)


def test_limits_on_trial_take_no_doubt_from_the_other_side(tmp_path: Path) -> None:
    """0.9 passed by 1.0 for itself; 1.005 ± 0.01 was too near. By 1.1 both are within."""
    one = of_sides("PASS", UNDECIDED, (0.9, 1.005))
    store_run(tmp_path, "SN", [one, metric(1.0, id="windup")], reasons=["lost_motion: too near"])
    with production(tmp_path) as look:
        what = characteristic(look, Lot(), "lost_motion")
        for rule in (Rule(None, 1.1, 0.82), Rule(None, 1.1, None)):
            assert flips(look, Lot(), what, rule, judged=GuardBands.of_all(0.82)) == {(UNDECIDED, "PASS"): 1}
        beside = characteristic(look, Lot(), "windup")
        (run,) = tried_runs(look, Lot(), beside, Rule(None, 2.0, 0.82), judged=GuardBands.of_all(0.82))
    assert run.after == UNDECIDED, "the other metric is not decidable by its other side"


def test_a_store_of_the_version_before_is_mended_and_a_rebuild_makes_equal_rows(data: Path) -> None:
    bring_up(data, 60.0)
    database, chain = opened(data), Chain(data)
    before = all_rows(database, chain)
    with database.writing() as connection:
        for serial, verdicts in SIDES.items():
            whole = of_sides(*verdicts)["verdict"]
            runs = select(RUNS.c.run).where(RUNS.c.chain == chain.id, RUNS.c.serial == serial)
            here = (METRICS.c.chain == chain.id) & METRICS.c.run.in_(runs) & METRICS.c.main & (METRICS.c.position == 0)
            connection.execute(update(METRICS).where(here).values(verdict=whole))
        count_all_hours(connection)
    assert all_rows(database, chain) != before
    with database.writing() as connection:
        for index in ("runs_quality", "runs_again"):
            connection.execute(text(f"DROP INDEX {index}"))
            connection.execute(text(f"CREATE INDEX {index} ON runs (chain)"))
        connection.execute(text("ALTER TABLE runs DROP COLUMN first"))
        connection.execute(text("UPDATE alembic_version SET version_num = '0008'"))
    assert HEAD != "0008"
    database.close()
    with production(data) as look:
        assert failures(look, Lot())[FailedMetric("lost_motion", "", "mean", "+")] == 3
    database = opened(data)
    assert all_rows(database, chain) == before
    rebuild(database, chain)
    assert all_rows(database, chain) == before
    database.close()
