"""Every exit brings the torque to zero in time; the page shows them all as they are measured."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from definitions.faults import FAULTS
from definitions.image import Reaction
from faultlab.exits.elsewhere import beyond_limit, limit_in_image, provokers
from faultlab.exits.page import COLUMNS, page
from faultlab.exits.rows import EXITS, LOAD_NM, RATED_NM
from faultlab.exits.run import PROVOKE, measure_exit
from faultlab.rows import STATES
from station.cli.faults import exits as command_exits
from station.errors import StationError

PAGE = (Path(__file__).parents[2] / "docs" / "exits.md").read_text(encoding="utf-8")
BEFORE_TORQUE = (
    "drive_enable_timeout", "homing_failed", "devices_not_ready", "tare_out_of_range", "tare_unsteady",
    "lock_not_closed",
)  # fmt: skip


def rows(text: str) -> dict[str, str]:
    return {line.split("`")[1]: line for line in text.splitlines() if line.startswith("| `")}


def test_every_exit_is_in_the_table_and_can_be_provoked():
    faults = {fault.id for fault in FAULTS if fault.reaction >= Reaction.UNLOAD}
    people_and_processes = {"finish", "operator_stop", "abort", "lost_supervisor", "lost_scan", "power_failure"}
    assert {row.id for row in EXITS} == faults | people_and_processes
    assert len(EXITS) == len({row.id for row in EXITS})
    by_matrix = {name for name in faults if any(provokers(name, at) for at in STATES)}
    by_channel = {name for name in faults if limit_in_image(name) is not None}
    assert faults <= {*PROVOKE, *by_matrix, *by_channel}


def test_the_page_has_every_exit_measured_and_within_its_bound():
    assert list(rows(PAGE)) == [row.id for row in EXITS]
    for row in EXITS:
        cells = dict(zip(COLUMNS, rows(PAGE)[row.id].strip("| ").split(" | "), strict=True))
        assert cells["bound"] == f"{row.bound_s:g} s"
        assert float(re.fullmatch(r"([0-9.]+) s", cells["down"])[1]) <= row.bound_s, row.id
        assert all(cells.values()), row.id


def test_what_ends_a_run_before_its_torque_leaves_none_and_no_lock_closed():
    for name in BEFORE_TORQUE:
        cells = dict(zip(COLUMNS, rows(PAGE)[name].strip("| ").split(" | "), strict=True))
        assert float(cells["peak"].removesuffix(" N·m")) < 0.01 * RATED_NM, name
        assert cells["in"] in ("idle", "home", "lock")
        assert cells["lock"] == ("stays closed" if cells["in"] == "lock" else "open, was not closed yet")


@pytest.mark.parametrize("name", [*PROVOKE, "guard_open", "lock_slip", "tare_unsteady"])
def test_the_torque_comes_to_zero_as_the_page_says(name):
    found = measure_exit(name)
    assert found.wrong == ()
    measured = page({row.id: found if row.id == name else None for row in EXITS})
    assert rows(measured)[name] == rows(PAGE)[name], "run 'lostmotion faults exits --page docs/exits.md'"


def test_an_interlock_with_a_channel_is_provoked_by_it():
    row = next(one for one in EXITS if one.id == "housing_temperature")
    found = beyond_limit(row)
    assert (found.wrong, found.begin_state) == ((), "ramp_pos")
    assert beyond_limit(row._replace(id="overspeed")) is None, "its channel is computed"


def test_an_exit_that_is_too_slow_is_said():
    found = measure_exit("finish")
    assert found.down_s > 0.0
    assert found.opened_nm < LOAD_NM
    slow = next(row for row in EXITS if row.id == "finish")._replace(bound_s=0.0)
    assert "allowed 0 s" in PROVOKE["finish"](slow).wrong[0]


def test_an_exit_that_nothing_provokes_is_said(monkeypatch, capsys):
    monkeypatch.setattr(command_exits, "ProcessPoolExecutor", ThreadPoolExecutor)
    monkeypatch.setattr(command_exits, "measure_exit", lambda _name: None)
    assert command_exits.exits(["abort"], None, 1, as_json=False) == 1
    assert "0 of 1 shutdown paths measured; not measured, or outside their limits: abort" in capsys.readouterr().out


def test_the_command_refuses_what_it_does_not_know(capsys):
    with pytest.raises(StationError, match=r"nonsense: .*lost_scan"):
        command_exits.exits(["nonsense"], None, 1, as_json=False)
    assert command_exits.exits(["abort"], None, 1, as_json=False) == 0
    assert "1 of 1 shutdown paths measured; not measured, or outside their limits: none" in capsys.readouterr().out
