"""Fixture and lock angle of a run: from its record to the store, and figures by them, on both databases."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np
import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from definitions.states import LOADED
from station.quality.figures import trend_of, yield_of
from station.records.chain.chain_file import Chain
from station.records.samples.table import Table
from station.results.export import LOCALES
from station.results.lock_angle import lock_angle_deg
from station.store.outbox import rebuild
from station.store.quality.lot import Lot, production
from station.store.run_csv import csv_of
from station.store.run_table import run_table
from station.store.stored_runs import Wanted
from station.store.table_counts import all_rows
from station.store.view import look_at, opened

COUNT = 24
VALUES = [0.5 + 0.01 * math.sin(number * number) for number in range(COUNT)]
ANGLES = [15.0 * number for number in range(COUNT)]
FIXTURES = ["F-1" if number % 3 else "F-2" for number in range(COUNT)]
LOT = Lot(recipe="inverse")
WITHIN_AN_HOUR = LOT._replace(since="2001-01-01T00:30:00.000+00:00")
"""The same runs, asked of the runs themselves, as the lot begins within an hour."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs with two fixtures and all angles, and one whose record says neither; a unit measured again in between."""
    data = tmp_path_factory.mktemp("angles") / "runs"
    for number, (value, angle, fixture) in enumerate(zip(VALUES, ANGLES, FIXTURES, strict=True)):
        one = {"fixture": fixture, "lock_angle_deg": angle, "day": number / 8}
        store_run(data, f"U{number:02}", [metric(value)], **one)
    store_run(data, "U00", [metric(0.9)], day=4.0, failed="lost_motion", fixture="F-1", lock_angle_deg=359.5)
    store_run(data, "OLD", [metric(0.5)], day=4.1)
    return data


@pytest.fixture
def measured(made: Path, store_url: str | None) -> Path:
    """The same runs in both databases, to be asked only."""
    del store_url
    return made


@pytest.mark.parametrize("lot", [LOT, WITHIN_AN_HOUR], ids=["hours", "runs"])
def test_a_trend_is_that_of_the_values_one_by_one(measured: Path, lot: Lot) -> None:
    with production(measured) as look:
        by_fixture = trend_of(look, lot, "lost_motion", "fixture").compared.groups
        by_angle = trend_of(look, lot, "lost_motion", "lock-angle").compared.groups
    fixtures = {name: [v for v, f in zip(VALUES, FIXTURES, strict=True) if f == name] for name in ("F-1", "F-2")}
    assert [(one.name, one.number) for one in by_fixture] == [("F-1", 16), ("F-2", 8), ("–", 1)]
    assert [one.mean for one in by_fixture] == pytest.approx([*map(np.mean, fixtures.values()), 0.5])
    names = [f"{begin:03}° to {begin + 30:03}°" for begin in range(0, 360, 30)]
    assert [(one.name, one.number) for one in by_angle] == [*((name, 2) for name in names), ("–", 1)]
    assert [one.mean for one in by_angle] == pytest.approx([*np.reshape(VALUES, (12, 2)).mean(axis=1), 0.5])


@pytest.mark.parametrize("lot", [LOT, WITHIN_AN_HOUR], ids=["hours", "runs"])
def test_a_unit_that_left_from_another_position_is_counted_there_in_the_end(measured: Path, lot: Lot) -> None:
    with production(measured) as look:
        by_angle = {one.group: one.verdicts for one in yield_of(look, lot, "lock-angle").groups}
        by_fixture = {one.group: one.verdicts for one in yield_of(look, lot, "fixture").groups}
    assert [(one.first.units, one.final.units) for one in (by_angle["000° to 030°"], by_angle["330° to 360°"])] == [
        (2, 1),
        (2, 3),
    ]
    assert by_angle["330° to 360°"].final.failed == 1
    assert {name: (one.first.units, one.final.units) for name, one in by_fixture.items()} == {
        "F-1": (16, 17),
        "F-2": (8, 7),
        "–": (1, 1),
    }


def test_a_rebuild_gives_equal_rows(measured: Path) -> None:
    with look_at(measured) as view:
        before = all_rows(view.database, view.chain)
        rows = run_table(view, Wanted(serial="U23"))
    assert (rows[0].run.fixture, rows[0].run.lock_angle_deg) == ("F-1", 345.0)
    database = opened(measured)
    rebuild(database, Chain(measured))
    assert all_rows(database, Chain(measured)) == before
    database.close()


def test_the_table_of_runs_has_both(measured: Path) -> None:
    with look_at(measured) as view:
        text = csv_of(run_table(view, Wanted()), LOCALES["de"])
    rows = list(csv.DictReader(io.StringIO(text), delimiter=";"))
    assert [(row["fixture"], row["lock_angle_deg"]) for row in rows if row["serial"] in ("U01", "OLD")] == [
        ("F-1", "15"),
        ("", ""),
    ]
    assert next(row["lock_angle_deg"] for row in rows if row["attempt"] == "2") == "359,5"


def test_the_command_names_the_groups(measured: Path) -> None:
    for by, named in (("fixture", "F-2"), ("lock-angle", "330° to 360°")):
        found = here("quality", "trend", "--metric", "lost_motion", "--by", by, "--data", str(measured))
        assert found.exit_code == 0, found.out
        assert named in found.out


@pytest.mark.parametrize(
    ("zero_rad", "angle_deg"),
    [(0.0, 0.0), (math.pi, 180.0), (-math.pi / 2, 270.0), (9 * math.pi, 180.0), (-1e-20, 0.0)],
)
def test_the_angle_is_that_of_the_locked_shaft_within_a_turn(zero_rad: float, angle_deg: float) -> None:
    table = _table([0, min(LOADED)], zero_rad)
    assert lock_angle_deg(table, loading_input=True) == pytest.approx(angle_deg)
    assert lock_angle_deg(table, loading_input=False) == pytest.approx(math.degrees(1.0))


def test_a_run_that_did_not_come_to_loading_has_none() -> None:
    assert lock_angle_deg(_table([0, 0], 1.0), loading_input=True) is None
    assert lock_angle_deg(_table([0, min(LOADED)], math.nan), loading_input=True) is None


def _table(states: list[int], zero_rad: float) -> Table:
    kinds = [("state", "u1"), ("angle_in_zero_rad", "f8"), ("angle_out_zero_rad", "f8")]
    orders = np.zeros(len(states), dtype=kinds)
    orders["state"], orders["angle_in_zero_rad"], orders["angle_out_zero_rad"] = states, 1.0, zero_rad
    return {"orders": orders}  # type: ignore[return-value]
