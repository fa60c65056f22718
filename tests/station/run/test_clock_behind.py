"""A computer's clock that is behind the chain: told, judged by for what has its day, and one word that it is right."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from chain_folders import a_key, lines, write
from patient import VIRTUAL_BENCH, write_changed
from station_samples import SETUP

from station.cli.measure import run as command_run
from station.errors import StationError
from station.records.chain.entries import CREATED, entry_of, signed_entry
from station.records.chain.lookup import last_begun_on_each_bench
from station.records.clock_behind import clock_behind
from station.records.data_folder import Store
from station.records.verify import verify_folder
from station.wall_clock import SLACK, WALL_CLOCK

GOLDEN = Path(__file__).parents[2] / "proofs" / "golden" / "golden.yaml"
FAR = timedelta(days=200)
NEVER = timedelta(days=365 * 7900)


@pytest.fixture(autouse=True)
def put_back() -> Iterator[None]:
    jumped = WALL_CLOCK._jumped
    yield
    WALL_CLOCK._jumped = jumped


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "runs"


def measured(data: Path, ahead: timedelta = timedelta(0), **more: str) -> str:
    """Create a run while the clock is ahead, and return its id."""
    WALL_CLOCK.step(ahead.total_seconds())
    run = Store(data).create("SN-1", SETUP, {}, **more).id
    WALL_CLOCK.step(-ahead.total_seconds())
    return run


def test_a_clock_that_is_behind_stays_so_by_every_run_that_is_made_since(data: Path) -> None:
    assert clock_behind(data) is None, "there is no folder"
    measured(data, SLACK / 2)
    assert clock_behind(data) is None
    later = measured(data, FAR)
    for _ in range(2):
        found = clock_behind(data)
        assert found is not None
        assert (found.run, found.at - found.now > FAR - SLACK) == (later, True)
        measured(data)
    WALL_CLOCK.step((FAR + SLACK).total_seconds())
    assert clock_behind(data) is None


@pytest.mark.parametrize("ahead", [FAR, NEVER])
def test_one_word_is_the_way_back_from_a_clock_that_was_wrong_once(data: Path, ahead: timedelta) -> None:
    measured(data, ahead)
    measured(data, clock_right="set by the time server")
    assert clock_behind(data) is None
    begun = entry_of(lines(data)[-1][:-1])
    assert begun is not None
    assert begun.fields["clock_right"] == "set by the time server"
    assert last_begun_on_each_bench(data)
    assert not verify_folder(data).problems
    later = measured(data, timedelta(days=1))  # and it counts again from there
    found = clock_behind(data)
    assert found is not None
    assert found.run == later


def test_a_line_that_anybody_can_write_sets_no_clock_and_says_no_word(data: Path) -> None:
    measured(data)
    fields = {"run": "20260105T090000.000Z-Z", "serial": "Z", "attempt": 1, "recipe": "r", "bench": "b"}

    def line(**more: Any) -> bytes:
        end = entry_of(lines(data)[-1][:-1])
        assert end is not None
        at = (WALL_CLOCK.now() + FAR).isoformat(timespec="milliseconds")
        return signed_entry(CREATED, end.counter + 5, "", at, a_key(), **fields, **more).line + b"\n"

    write(data, [*lines(data), line()])
    assert clock_behind(data) is None
    later = measured(data, FAR)
    write(data, [*lines(data), line(clock_right="so I say")])
    found = clock_behind(data)
    assert found is not None
    assert found.run == later


def test_verify_notes_where_the_time_runs_back_and_passes(data: Path) -> None:
    measured(data, FAR)
    back = measured(data)
    measured(data)
    found = verify_folder(data)
    assert not found.problems
    (note,) = found.walk.back
    assert back in note


class Begun(Exception):  # noqa: N818 - no error: what is asked for here ends where a run begins
    """What a run was begun with."""


@pytest.fixture
def options(tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> command_run.Options:
    """A run by a fixture's curve that is in date by the computer's clock for 100 days."""

    def begun(_data: Path, _job: object, wanted: Any, *, notes: list[str]) -> None:
        raise Begun(wanted, notes)

    monkeypatch.setattr(command_run, "new_record", begun)
    due = (WALL_CLOCK.now() + FAR / 2).date()
    points = [{"torque": f"{side}400 N·m", "deflection": f"{side}0.04 arcmin"} for side in ("-", "")]
    curve = {"id": "c", "made": "2026-01-01", "due": due, "angles": "both", "points": points}
    bench = write_changed(VIRTUAL_BENCH, tmp_path / "bench.yaml", {"fixture": {"curve": curve}})
    return command_run.Options(
        recipe=str(GOLDEN), serial="SN-1", bench=str(bench), data=data, unit=None, scenario=None, virtual_time=True,
        json=True,
    )  # fmt: skip


def test_what_is_out_of_date_by_the_later_time_is_not_measured_by(data: Path, options: command_run.Options) -> None:
    measured(data, FAR)
    with pytest.raises(StationError, match="--clock-is-right") as refused:
        command_run.run(options)
    assert "entry 2" in str(refused.value)
    with pytest.raises(Begun) as found:
        command_run.run(replace(options, clock_is_right="set by the time server"))
    wanted, notes = found.value.args
    assert wanted.clock_right == "set by the time server"
    assert any("set by the time server" in one for one in notes)


def test_a_run_that_measures_by_nothing_that_is_out_of_date_notes_the_clock(
    data: Path, options: command_run.Options
) -> None:
    later = measured(data, FAR / 4)
    with pytest.raises(Begun) as found:
        command_run.run(options)
    wanted, notes = found.value.args
    assert wanted.clock_right == ""
    assert any(later in one for one in notes)
    WALL_CLOCK.step((FAR / 4 + SLACK).total_seconds())
    with pytest.raises(Begun) as found:
        command_run.run(replace(options, clock_is_right="nobody asked"))
    assert found.value.args[0].clock_right == "", "where nothing is later it sets nothing aside"
