"""Shifts and days by a clock that is not whole hours off UTC, where one hour of UTC lies in two of them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from station.cli.runs.run_table import moment_of
from station.quality.figures import trend_of, yield_of
from station.store.quality.counts import whole_hour_zone
from station.store.quality.lot import Lot, production

LOT = Lot(recipe="inverse")
FROM_8 = 1.0 / (24 * 60)
"""A minute in days, as runs are stored from 08:00 UTC on."""


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    yield monkeypatch
    monkeypatch.undo()
    time.tzset()


def at(clock: pytest.MonkeyPatch, zone: str) -> None:
    clock.setenv("TZ", zone)
    time.tzset()


def stored(data: Path) -> Path:
    """Store units at 15:14, 16:16, 17:29, 17:30, 17:44 and 18:31 UTC of the 5th, the fourth one measured twice."""
    minutes = [
        (hour - 8) * 60 + minute for hour, minute in ((15, 14), (16, 16), (17, 29), (17, 30), (17, 44), (18, 31))
    ]
    for number, minute in enumerate(minutes):
        store_run(data, f"U{number}", [metric(0.5 + 0.01 * number)], day=minute * FROM_8)
    store_run(data, "U3", [metric(0.5)], day=(minutes[-1] + 1) * FROM_8)
    return data


ZONES = {
    "UTC": ({"14:00 to 22:00": 6}, {"2026-01-05": 6}),
    "Asia/Yangon": ({"14:00 to 22:00": 1, "22:00 to 06:00": 5}, {"2026-01-05": 3, "2026-01-06": 3}),
    "Asia/Kolkata": ({"14:00 to 22:00": 2, "22:00 to 06:00": 4}, {"2026-01-05": 5, "2026-01-06": 1}),
    "Asia/Kathmandu": ({"14:00 to 22:00": 1, "22:00 to 06:00": 5}, {"2026-01-05": 5, "2026-01-06": 1}),
    "Australia/Lord_Howe": ({"22:00 to 06:00": 6}, {"2026-01-06": 6}),
    "Asia/Tokyo": ({"22:00 to 06:00": 6}, {"2026-01-06": 6}),
}
"""Clocks and the first attempts of each shift and each day by them."""


@pytest.mark.parametrize("zone", ZONES)
def test_a_run_is_in_the_shift_and_the_day_that_the_clock_showed(
    clock: pytest.MonkeyPatch, store_url: str | None, tmp_path: Path, zone: str
) -> None:
    del store_url
    data = stored(tmp_path)
    at(clock, zone)
    shifts, days = ZONES[zone]
    with production(data) as look:
        for by, expected in (("shift", shifts), ("day", days)):
            found = yield_of(look, LOT, by)
            assert {row.group: row.verdicts.first.units for row in found.groups} == expected
            assert sum(row.verdicts.final.units for row in found.groups) == 6
        if min(days.values()) > 1 and len(days) > 1:
            assert {one.name: one.number for one in trend_of(look, LOT, "lost_motion", "day").compared.groups} == days
        for day, number in days.items():
            since, until = moment_of(f"{day}T00:00"), moment_of(f"{day}T23:59:59.999")
            assert yield_of(look, LOT._replace(since=since, until=until)).whole.verdicts.first.units == number


def test_hours_are_asked_where_they_do() -> None:
    assert whole_hour_zone()


def test_a_zone_of_half_hours_in_summer_alone_is_none_of_whole_hours(clock: pytest.MonkeyPatch) -> None:
    for zone in ("Asia/Kolkata", "Australia/Lord_Howe", "Asia/Kathmandu"):
        at(clock, zone)
        assert not whole_hour_zone()
    for zone in ("Europe/Berlin", "America/St_Johns", "Asia/Tokyo"):
        at(clock, zone)
        assert whole_hour_zone() == (zone != "America/St_Johns")


def test_the_command_groups_by_the_clock_of_its_computer(clock: pytest.MonkeyPatch, tmp_path: Path) -> None:
    at(clock, "Asia/Yangon")
    told = here("quality", "yield", "--data", str(stored(tmp_path)), "--by", "shift", "--json")
    assert [(row["group"], row["verdicts"]["first"]["passed"]) for row in told.json["groups"]] == [
        ("14:00 to 22:00", 1), ("22:00 to 06:00", 5),
    ]  # fmt: skip
