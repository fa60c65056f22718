"""The shift report: first-pass and final yield apart, master parts apart, and what hindered the shift."""

from __future__ import annotations

from collections import Counter
from datetime import timedelta
from pathlib import Path
from typing import Any

from lostmotion_command import ROOT, here
from station_support import GOLDEN, client_of
from stored_runs import metric, store_run

from station.documents.result import Result
from station.records.data_folder import Store
from station.records.run_record import RESULT
from station.store.run_table import RunTableRow, run_table
from station.store.stored_runs import StoredRun, Wanted
from station.store.view import look_at
from station.wall_clock import WALL_CLOCK, now_text
from station.web.shift_report import UNREADABLE, Yield, alarms_of, shift_of
from station.web.station import Station

BEGIN, END = "2026-01-05T06:00:00.000+00:00", "2026-01-05T14:00:00.000+00:00"


def stored(**entries: Any) -> StoredRun:
    return StoredRun(**dict.fromkeys(StoredRun._fields, "") | {"in_production": True} | entries)


def row(serial: str, attempt: int, verdict: str | None, hour: int, **more: str | bool | None) -> RunTableRow:
    started = f"2026-01-05T{hour:02}:00:00.000+00:00"
    known = {"run": f"R{hour}", "started": started, "state": "complete", "scenario": None}
    return RunTableRow(
        stored(**known | {"serial": serial, "attempt": attempt, "first": attempt == 1, "verdict": verdict} | more)
    )


ROWS = [
    row("SN-0", 1, "PASS", 5),
    row("SN-1", 1, "PASS", 6),
    row("SN-2", 1, "FAIL", 7),
    row("SN-2", 2, "PASS", 8),
    row("SN-3", 2, "FAIL", 9),
    row("SN-4", 1, None, 10, state="fault"),
    row("MASTER", 1, "FAIL", 11, master="FAIL"),
    row("SN-5", 1, "PASS", 12, scenario="cut.yaml"),
    row("SN-6", 1, "PASS", 14),
]


def test_yields_are_not_mixed_and_master_parts_are_no_production(station: Station) -> None:
    with station.database.reading() as connection:
        found = shift_of(ROWS, {}, connection, BEGIN, END)
    assert found.first_pass == Yield(1, 3), "SN-1, SN-2 and SN-4 were measured for the first time"
    assert found.final == Yield(2, 4), "SN-2 passed in the end"
    assert found.verdicts == {"PASS": 2, "FAIL": 2, "no verdict": 1}
    assert found.master_parts == {"FAIL": 1}
    assert found.ended_otherwise == (("R10", "fault"),)
    assert (found.bypasses, found.refused) == ((), {})


def test_a_product_in_the_store_is_production_and_a_master_part_is_none(station: Station, tmp_path: Path) -> None:
    data = tmp_path / "stored"
    store_run(data, "SN-1", [metric(0.4)])
    store_run(data, "MASTER", [metric(2.0)], failed="too large", master="FAIL")
    with look_at(data) as view:
        rows = run_table(view, Wanted())
    with station.database.reading() as connection:
        found = shift_of(rows, {}, connection, "2020-01-01", "2100-01-01")
    assert (found.verdicts, found.master_parts) == ({"PASS": 1}, {"FAIL": 1})
    assert found.first_pass == found.final == Yield(1, 1)


def test_what_was_simulated_stands_apart_and_makes_no_bad_unit_a_good_one(station: Station) -> None:
    rows = [
        row("SN-1", 1, "FAIL", 7),
        row("SN-1", 2, "PASS", 8, virtual=True),
        row("SN-2", 1, "PASS", 9, virtual=True),
        row("MASTER", 1, "PASS", 10, master="PASS", virtual=True),
        row("SN-3", 1, None, 11, virtual=True, altered="result.json: was changed"),
    ]
    with station.database.reading() as connection:
        found = shift_of(rows, {}, connection, BEGIN, END)
    assert (found.first_pass, found.final) == (Yield(0, 2), Yield(0, 2))
    assert found.verdicts == {"FAIL": 1, "no verdict": 1}, "an altered record may say of itself what it likes"
    assert (found.virtual, found.master_parts) == ({"PASS": 3}, {})
    assert "Virtual bench  3 PASS" in found.as_text()


def test_a_shift_that_ends_before_it_begins_is_refused(station: Station) -> None:
    asked = ("audit", "shift", "--data", str(station.data), "--since")
    for days in (("2026-01-05", "--until", "2026-01-04"), ("2026-01-05", "--until", "2026-01-05"), ("2999-01-01",)):
        found = here(*asked, *days)
        assert (found.exit_code, "allowed is a moment before its end" in found.err) == (2, True)


def test_a_shift_without_runs_has_no_yield(station: Station) -> None:
    with station.database.reading() as connection:
        found = shift_of([], {}, connection, BEGIN, END)
    assert found.first_pass == Yield(0, 0)
    assert "%" not in found.as_text()
    assert "Virtual" not in found.as_text()


def test_bypasses_refused_starts_and_the_head_stand_on_it(station: Station) -> None:
    begin = now_text()
    technician, operator = client_of(station, "technician"), client_of(station, "operator")
    technician.post("add_bypass", {"condition": "clock_plausible", "reason": "no network", "hours": 1.0})
    operator.post("start_run", {"scanned": "XX-1"})
    found = here("audit", "shift", "--since", begin, "--data", str(station.data), "--json").json
    assert found["refused"] == {"model_known": 1}
    (bypass,) = found["bypasses"]
    assert "no network" in bypass
    newest = client_of(station, "quality").http.get("/api/audit").json()
    assert found["audit"] == {"lines": newest["lines"], "head_sha256": newest["head_sha256"]}
    text = here("audit", "shift", "--since", begin, "--data", str(station.data)).out
    assert newest["head_sha256"] in text


def test_alarms_are_counted_by_their_ids(tmp_path: Path) -> None:
    cut = ROOT / "scenarios" / "estop-and-recovery.yaml"
    command = (
        "run",
        str(GOLDEN),
        "--serial",
        "SN-1",
        "--virtual-time",
        "--scenario",
        str(cut),
        "--data",
        str(tmp_path),
    )
    here(*command)
    (run,) = [one.id for one in Store(tmp_path).runs()]
    result = Store(tmp_path).by_id(run).read(Result, RESULT)
    assert result.alarms
    of_run = RunTableRow(stored(run=run, scenario=None, started=BEGIN))
    assert alarms_of(tmp_path, [of_run], END) == dict(Counter(one.id for one in result.alarms if one.kind == "alarm"))
    injected = RunTableRow(stored(run=run, scenario="cut", started=BEGIN))
    assert alarms_of(tmp_path, [injected, RunTableRow(stored(run=run, scenario=None, started=END))], END) == {}
    (tmp_path / run / RESULT).write_text("{")
    assert alarms_of(tmp_path, [of_run], END) == {UNREADABLE: 1}


def test_a_bypass_of_the_shift_before_that_still_counts_is_told(station: Station) -> None:
    client_of(station, "technician").post(
        "add_bypass", {"condition": "clock_plausible", "reason": "no network", "hours": 2.0}
    )
    later = WALL_CLOCK.now() + timedelta(hours=1)
    much_later = later + timedelta(hours=2)
    with station.database.reading() as connection:
        assert len(shift_of([], {}, connection, later.isoformat(), much_later.isoformat()).bypasses) == 1
        assert shift_of([], {}, connection, much_later.isoformat(), much_later.isoformat()).bypasses == ()
