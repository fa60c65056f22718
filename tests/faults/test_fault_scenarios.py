"""Scenario files: the shipped ones hold, a fault that does not act fails, clauses bite, wrong files are refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drivers.virtual.scenario import Scenario
from recipes import RecipeError
from station import command_faults
from station.assemble_virtual import load_scenario
from station.command_replay import replay_run
from station.fault_judge import judge
from station.fault_matrix import cells, measure
from station.fault_rows import AFTER_SCANS, ROWS, STATES
from station.fault_run import FaultRun, run_scenario
from station.request import load_job

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "scenarios").glob("*.yaml"))
IN_RAMP = {"state": "ramp_pos", "after_scans": 300}
GUARD = {"target": "io.guard", "verb": "open", "when": IN_RAMP}


def scenario(**parts) -> Scenario:
    return Scenario.model_validate({"scenario": {"name": "test"}, "faults": [GUARD], **parts})


@pytest.fixture(scope="module")
def guard_opened() -> FaultRun:
    return run_scenario(load_job("rv-40e-121-faults", None), "P1", scenario())


OVER_WIRES = ("drive-that-lies", "drive-that-refuses", "drive-without-sdo")


@pytest.mark.parametrize("path", [path for path in SHIPPED if path.stem not in OVER_WIRES], ids=lambda path: path.stem)
def test_shipped_scenario_holds(path, capsys):
    assert command_faults.run(path, command_faults.How(), as_json=False) == 0
    assert "holds" in capsys.readouterr().out


@pytest.mark.parametrize("name", OVER_WIRES)
def test_what_virtual_time_has_none_of_is_refused_there(name):
    with pytest.raises(RecipeError, match="run it over wires"):
        command_faults.run(ROOT / "scenarios" / f"{name}.yaml", command_faults.How(), as_json=False)


def test_a_fault_of_virtual_time_is_refused_over_wires(tmp_path):
    path = tmp_path / "overrun.yaml"
    fault = "{target: scan.overrun, verb: miss, value: 45, when: {state: lock}}"
    path.write_text(f"scenario: {{name: x}}\nfaults:\n  - {fault}\n", encoding="utf-8")
    with pytest.raises(RecipeError, match="leave --wires out"):
        command_faults.run(path, command_faults.How(wires=True), as_json=False)


def test_a_run_in_virtual_time_is_kept_and_replays(tmp_path, capsys):
    how = command_faults.How(data=tmp_path)
    assert command_faults.run(ROOT / "scenarios" / "heartbeat-lost.yaml", how, as_json=True) == 0
    record = Path(json.loads(capsys.readouterr().out)["record"])
    assert record.parent == tmp_path
    assert replay_run(str(record), tmp_path, None, as_json=True) == 0


def test_a_fault_that_does_not_act_fails_its_scenario(tmp_path, capsys):
    path = tmp_path / "never.yaml"
    path.write_text(
        "scenario: {name: never due}\n"
        "faults:\n  - {target: io.guard, verb: open, when: {torque_out_above_nm: 9000}}\n"
        "expect:\n  - {final_state: complete}\n",
        encoding="utf-8",
    )
    assert command_faults.run(path, command_faults.How(), as_json=False) == 1
    said = capsys.readouterr().out
    assert "io.guard open has had no effect: its moment (torque_out_above_nm 9000.0) did not come" in said


@pytest.mark.parametrize(
    ("clause", "words"),
    [
        ({"expect": [{"event": "guard_open", "within_scans": 12}]}, ""),
        ({"expect": [{"event": "guard_open", "within_scans": 0}]}, "came after"),
        ({"expect": [{"event": "estop", "within_scans": 10}]}, "alarms were: guard_open"),
        ({"expect": [{"event": "estopp", "within_scans": 10}]}, "there is no such fault"),
        ({"expect": [{"order": "quick_stop", "within_scans": 0}]}, ""),
        ({"expect": [{"order": "fault_reset", "within_scans": 0}]}, "was not given"),
        ({"expect": [{"torque_below_nm": 33, "within_s": 1.0}]}, ""),
        ({"expect": [{"torque_below_nm": 0.001, "within_s": 1.0}]}, "N·m at the end"),
        ({"expect": [{"final_state": "fault"}, {"latched": True}]}, ""),
        ({"expect": [{"final_state": "complete"}]}, "was fault"),
        ({"expect": [{"latched": False}]}, "states were"),
        ({"never": [{"state": "complete"}, {"event": "estop"}, {"torque_above_nm": 300}]}, ""),
        ({"never": [{"state": "lock"}]}, "states were"),
        ({"never": [{"event": "guard_open"}]}, "at scan"),
        ({"never": [{"torque_above_nm": 50}]}, "N·m"),
        ({"never": [{"order_after_fault": "enable_operation"}]}, ""),
        ({"never": [{"order_after_fault": "quick_stop"}]}, "at scan"),
    ],
)
def test_each_clause_bites(guard_opened, clause, words):
    wrong = judge(guard_opened, scenario(**clause))
    assert bool(wrong) == bool(words), wrong
    assert words in " ".join(wrong)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("when: {state: ramp_poz}", "allowed idle"),
        ("when: {after_scans: 3, time_s: 1}", "give the state too"),
        ("when: {state: lock, time_s: 1}", "exactly one"),
        ("whan: {state: lock}", "when"),
        ("when: {state: lock}, for_ms: 0", "for_ms"),
    ],
)
def test_a_wrong_scenario_file_is_refused_with_its_place(tmp_path, text, words):
    path = tmp_path / "wrong.yaml"
    path.write_text(f"scenario: {{name: x}}\nfaults:\n  - {{target: io.guard, verb: open, {text}}}\n", encoding="utf-8")
    with pytest.raises(RecipeError) as refused:
        load_scenario(path)
    assert f"{path}:3:" in str(refused.value)
    assert words in str(refused.value)


def test_the_matrix_knows_its_states_and_has_its_size():
    assert set(AFTER_SCANS) == set(STATES)
    assert len(ROWS) >= 40
    assert len({row.name for row in ROWS}) == len(ROWS)
    assert len(cells()) == sum(len(row.states) for row in ROWS)
    assert cells(["io.estop"]) == [
        (next(i for i, row in enumerate(ROWS) if row.target == "io.estop"), s) for s in STATES
    ]


def test_a_cell_of_the_matrix_keeps_its_bounds():
    (chosen,) = [cell for cell in cells(["io.guard"]) if cell[1] == "ramp_neg"]
    cell = measure(*chosen)
    assert cell.wrong == ()
    assert (cell.alarm, cell.reaction, cell.order_scans, cell.final_state) == ("guard_open", "quick_stop", 0, "fault")
    assert len(cell.trace_nm) > 50


def test_the_documentation_has_every_cell_of_the_matrix():
    page = (ROOT / "docs" / "fault-matrix.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:3] for line in page.splitlines() if line.startswith("| `")]
    written = [(name.strip(" `"), state.strip()) for name, state in rows]
    assert written == [(ROWS[row].name, state) for row, state in cells()], "run 'lostmotion faults matrix --page ...'"
