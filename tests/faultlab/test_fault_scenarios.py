"""Scenario files: the shipped ones hold, a fault that does not act fails, clauses bite, wrong files are refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from zlib import crc32

import pytest

from faultlab.given import MOST, given, listed, visits
from faultlab.judge import _EXPECT, _NEVER, judge
from faultlab.matrix.matrix import cells, measure
from faultlab.matrix.page import bound, markdown
from faultlab.rows import AFTER_SCANS, ROWS, STATES
from faultlab.run import FaultRun, Kept, run_scenario
from recipes import RecipeError
from station.bench.assemble_virtual import choose_unit, load_scenario
from station.bench.request import load_job
from station.bench.virtual_unit import FIXED_SEED
from station.cli.faults import faults as command_faults
from station.cli.runs.replay import replay_run
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.scenario import EXPECT_KINDS, OF_THE_RECORD, Expect, Never, Scenario

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "scenarios").glob("*.yaml"))
IN_RAMP = {"state": "ramp_pos", "after_scans": 300}
GUARD = {"target": "io.guard", "verb": "open", "when": IN_RAMP}


def scenario(**parts) -> Scenario:
    return Scenario.model_validate({"scenario": {"name": "test"}, "faults": [GUARD], **parts})


@pytest.fixture(scope="module")
def guard_opened() -> FaultRun:
    job = load_job("rv-40e-121-faults", None)
    return run_scenario(job, choose_unit("P1", job.recipe, FIXED_SEED), scenario())


OVER_WIRES = (
    "clock-set", "desk-killed", "disk-full", "scan-killed",
    "drive-that-lies", "drive-that-refuses", "drive-without-sdo",
)  # fmt: skip


@pytest.mark.parametrize("path", [path for path in SHIPPED if path.stem not in OVER_WIRES], ids=lambda path: path.stem)
def test_shipped_scenario_holds(path, capsys):
    assert command_faults.run(path, command_faults.How(seed=FIXED_SEED), as_json=False) == 0
    assert "holds" in capsys.readouterr().out


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_the_way_back_after_an_emergency_stop_does_not_hang_on_the_noise(seed, capsys):
    """Found by seeds: a rest just below the torque at which the lock may open read low once, then never for long."""
    path = ROOT / "scenarios" / "estop-and-recovery.yaml"
    assert command_faults.run(path, command_faults.How(seed=seed), as_json=False) == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", OVER_WIRES)
def test_what_virtual_time_has_none_of_is_refused_there(name):
    with pytest.raises(RecipeError, match="Run it over wires: add --wires"):
        command_faults.run(ROOT / "scenarios" / f"{name}.yaml", command_faults.How(), as_json=False)


def test_periods_are_missed_by_order_on_every_clock_but_the_wall(tmp_path):
    path = tmp_path / "overrun.yaml"
    fault = "{target: scan.overrun, verb: miss, value: 45, when: {state: lock}}"
    path.write_text(
        f"scenario: {{name: x}}\nfaults:\n  - {fault}\nexpect:\n  - {{event: missed_periods, within_scans: 47}}\n",
        encoding="utf-8",
    )
    with pytest.raises(RecipeError, match="Leave --wall-clock out"):
        command_faults.run(path, command_faults.How(wires=True, wall_clock=True), as_json=False)
    assert command_faults.run(path, command_faults.How(), as_json=False) == 0


def test_the_unit_of_a_scenario_is_for_recipes_of_its_model(tmp_path, capsys):
    path = tmp_path / "guard.yaml"
    path.write_text(
        "scenario: {name: x}\nstart: {recipe: rv-40e-121-faults, unit: worn}\n"
        "faults:\n  - {target: io.guard, verb: open, when: {state: home}}\nexpect:\n  - {final_state: fault}\n",
        encoding="utf-8",
    )
    for recipe, unit in (("rv-40e-121-quick", "worn"), ("static-50nm", "S50")):
        assert command_faults.run(path, command_faults.How(recipe, seed=FIXED_SEED), as_json=True) == 0
        assert json.loads(capsys.readouterr().out)["unit"]["virtual"] == unit
    with pytest.raises(VirtualBenchError, match="leave --unit out"):
        command_faults.run(path, command_faults.How("static-50nm", "worn"), as_json=True)


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
    assert "the fault io.guard open had no effect: its trigger (torque_out_above_nm 9000.0) was not reached" in said


@pytest.mark.parametrize(
    ("clause", "words"),
    [
        ({"expect": [{"event": "guard_open", "within_scans": 12}]}, ""),
        ({"expect": [{"event": "guard_open", "within_scans": 0}]}, "came after"),
        ({"expect": [{"event": "estop", "within_scans": 10}]}, "alarms were: guard_open"),
        ({"expect": [{"event": "estop", "within_scans": 10}]}, "guard_open at scan"),
        ({"expect": [{"reaction": "quick_stop", "within_scans": 0}]}, ""),
        ({"expect": [{"reaction": "power_off", "within_scans": 0}]}, "reactions were: quick_stop at scan"),
        ({"expect": [{"order": "quick_stop", "within_scans": 0}]}, ""),
        ({"expect": [{"order": "fault_reset", "within_scans": 0}]}, "was not given"),
        ({"expect": [{"order": "disable_voltage", "within_scans": 0}]}, "were: quick_stop at scan"),
        ({"expect": [{"torque_below_nm": 33, "within_s": 1.0}]}, ""),
        ({"expect": [{"torque_below_nm": 0.001, "within_s": 1.0}]}, "N·m at the end"),
        ({"expect": [{"final_state": "fault"}, {"latched": True}]}, ""),
        ({"expect": [{"final_state": "complete"}]}, "was fault"),
        ({"expect": [{"latched": False}]}, "the states of the run were"),
        ({"never": [{"state": "complete"}, {"event": "estop"}, {"torque_above_nm": 300}]}, ""),
        ({"never": [{"state": "lock"}]}, "the states of the run were"),
        ({"never": [{"event": "guard_open"}]}, "at scan"),
        ({"never": [{"torque_above_nm": 50}]}, "N·m"),
        ({"never": [{"order_after_fault": "enable_operation"}]}, ""),
        ({"never": [{"order_after_fault": "quick_stop"}]}, "at scan"),
        ({"expect": [{"torque_below_nm": 33, "within_s": 1.0, "since": "fault"}]}, ""),
        ({"expect": [{"torque_below_nm": 33, "within_s": 0.001, "since": "fault"}]}, "took"),
        ({"expect": [{"found_as": "fault"}, {"record": "complete"}, {"verdict": "NOT DECIDABLE"}]}, ""),
        ({"expect": [{"found_as": "interrupted"}]}, "was found as fault"),
        ({"expect": [{"verdict": "PASS"}]}, "was NOT DECIDABLE"),
    ],
)
def test_each_clause_bites(guard_opened, clause, words):
    run = dataclasses.replace(guard_opened, kept=Kept("fault", "NOT DECIDABLE", ()))
    wrong = judge(run, scenario(**clause))
    assert bool(wrong) == bool(words), wrong
    assert words in " ".join(wrong)


def test_a_record_with_a_gap_is_not_complete(guard_opened):
    run = dataclasses.replace(guard_opened, kept=Kept("fault", "NOT DECIDABLE", ("5 records found, 6 were written",)))
    assert judge(run, scenario(expect=[{"record": "complete"}])) == [
        "expected record complete: 5 records found, 6 were written"
    ]


def test_torque_counts_from_a_fault_that_trips_nothing_and_only_if_it_acted(guard_opened):
    expected = scenario(expect=[{"torque_below_nm": 33, "within_s": 1.0, "since": "fault"}])
    assert judge(dataclasses.replace(guard_opened, events=[]), expected) == []
    (wrong,) = judge(dataclasses.replace(guard_opened, acted=[]), expected)
    assert "had no effect" in wrong


def test_only_a_run_that_must_be_interrupted_may_have_no_end(guard_opened):
    run = dataclasses.replace(guard_opened, finished=False, kept=Kept("interrupted", "NOT DECIDABLE", ()))
    assert judge(run, scenario(expect=[{"found_as": "interrupted"}])) == []
    assert "the run did not end" in judge(run, scenario(expect=[{"final_state": "fault"}]))


@pytest.mark.parametrize("kind", OF_THE_RECORD)
def test_what_needs_a_record_is_refused_in_virtual_time(guard_opened, tmp_path, kind):
    value = {"found_as": "fault", "record": "complete", "verdict": "PASS"}[kind]
    path = tmp_path / "record.yaml"
    path.write_text(
        "scenario: {name: x}\nfaults:\n  - {target: io.guard, verb: open, when: {state: lock}}\n"
        f"expect:\n  - {{{kind}: {value}}}\n",
        encoding="utf-8",
    )
    with pytest.raises(RecipeError, match="Run it over wires: add --wires"):
        command_faults.run(path, command_faults.How(), as_json=False)
    assert "has no record" in judge(guard_opened, load_scenario(path))[-1], "nor does the plug-in believe it"


def test_every_clause_has_its_judge():
    assert set(EXPECT_KINDS) == set(_EXPECT)
    assert set(EXPECT_KINDS) == set(Expect.model_fields) - {"within_scans", "within_s", "since"}
    assert set(Never.model_fields) == set(_NEVER)


@pytest.mark.parametrize(
    ("target", "verb", "rest", "words"),
    [
        ("process.desk", "kill", "when: {time_s: 3}", "found time_s; allowed: state or scan"),
        (
            "machine.disk",
            "full",
            "when: {torque_out_above_nm: 50}",
            "found torque_out_above_nm; allowed: state or scan",
        ),
        ("process.scan", "kill", "when: {state: lock}, for_ms: 100", "takes no for_ms"),
        ("machine.clock", "step", "when: {state: lock}", "needs value"),
        ("machine.disk", "fill", "when: {state: lock}", "allowed: full"),
        ("process.scan", "kill", "value: 9, when: {state: lock}", "takes no value"),
    ],
)
def test_a_wrong_fault_of_the_machine_is_refused_with_its_place(tmp_path, target, verb, rest, words):
    path = tmp_path / "wrong.yaml"
    path.write_text(f"scenario: {{name: x}}\nfaults:\n  - {{target: {target}, verb: {verb}, {rest}}}\n", "utf-8")
    with pytest.raises(RecipeError) as refused:
        load_scenario(path)
    assert f"{path}:3:" in str(refused.value)
    assert words in str(refused.value)


def test_since_belongs_to_torque():
    with pytest.raises(ValueError, match="since only with torque_below_nm"):
        scenario(expect=[{"final_state": "fault", "since": "fault"}])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("when: {state: ramp_poz}", "allowed: idle"),
        ("when: {after_scans: 3, time_s: 1}", "Add the state"),
        ("when: {state: lock, time_s: 1}", "exactly one"),
        ("whan: {state: lock}", "when"),
        ("when: {}", "found none of them"),
        ("when: {state: lock}, value: 3", "takes no value"),
        ("when: {state: lock}, for_ms: 50 ms", "Write it without a unit"),
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


MATRIX_PAGE = (ROOT / "docs" / "fault-matrix.md").read_text(encoding="utf-8")


TIMED_BY_THE_RECIPE = ("can.drive.tpdo1 off", "modbus.amplifier silence")


def cells_to_measure() -> list[tuple[int, str]]:
    """One cell with an alarm of each part that can fail, and of each age of the recipe: those of the smallest hash."""
    chosen: dict[str, tuple[int, str]] = {}
    for row, state in sorted(cells(), key=lambda cell: crc32(f"{ROWS[cell[0]].name} {cell[1]}".encode())):
        if ROWS[row].causes:
            chosen.setdefault(ROWS[row].target.split(".")[0], (row, state))
        if ROWS[row].name in TIMED_BY_THE_RECIPE:
            chosen.setdefault(ROWS[row].name, (row, state))
    return list(chosen.values())


def test_the_documentation_has_every_cell_of_the_matrix():
    rows = [line.strip("| ").split("|") for line in MATRIX_PAGE.splitlines() if line.startswith("| `")]
    written = [(row[0].strip(" `"), row[1].strip(), row[-1].strip()) for row in rows]
    expected = [(ROWS[row].name, state, bound(ROWS[row])) for row, state in cells()]
    assert written == expected, "run 'lostmotion faults matrix --page ...'"


@pytest.mark.parametrize(("row", "state"), cells_to_measure())
def test_the_figures_of_the_documentation_are_those_of_the_matrix(row, state):
    measured = markdown([measure(row, state)]).splitlines()[-1]
    assert measured in MATRIX_PAGE.splitlines(), "run 'lostmotion faults matrix --page ...'"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text("scenario: {name: mine}\n" + text, encoding="utf-8")
    return path


FIXED = command_faults.How(seed=FIXED_SEED)
GUARD_LINE = "faults:\n  - {target: io.guard, verb: open, when: {state: ramp_pos, after_scans: 300}}\n"


def test_a_failed_expectation_names_its_line_and_lists_what_was_given(tmp_path, capsys):
    expect = "expect:\n  - {event: guard_open, within_scans: 12}\n  - {order: disable_voltage, within_scans: 0}\n"
    path = written(tmp_path, GUARD_LINE + expect)
    assert command_faults.run(path, FIXED, as_json=False) == 1
    said = capsys.readouterr().out.splitlines()
    (wrong,) = [line for line in said if str(path) in line]
    assert wrong.startswith(f"  {path}:6:5: expected order disable_voltage, within_scans 0: came ")
    assert "quick_stop at scan" in wrong
    given = {line.split()[0]: line for line in said[2:]}
    assert "io.guard open at scan" in given["faults"]
    assert "guard_open at scan" in given["alarms"]
    assert "after the fault" in given["alarms"]
    assert "quick_stop at scan" in given["reactions"]
    assert given["orders"].index("quick_stop at") < given["orders"].index("disable_voltage at")
    assert given["states"].split("→")[-1].strip().startswith("fault at scan")


def test_a_program_gets_the_same(tmp_path, capsys):
    path = written(tmp_path, GUARD_LINE + "expect:\n  - {reaction: power_off, within_scans: 0}\n")
    assert command_faults.run(path, FIXED, as_json=True) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["lines"] == [5]
    assert [row["reaction"] for row in said["reactions"]] == ["quick_stop"]
    assert [row["order"] for row in said["orders"]] == ["enable_operation", "quick_stop", "disable_voltage"]
    assert [row["state"] for row in said["visits"]] == said["states"]
    assert said["alarms"][0]["scan"] == said["reactions"][0]["scan"] == said["orders"][1]["scan"]


def test_a_moment_that_does_not_come_fails_at_its_line_and_says_what_came(tmp_path, capsys):
    late = GUARD_LINE.replace("300", "30000")
    assert (
        command_faults.run(written(tmp_path, late + "expect:\n  - {final_state: complete}\n"), FIXED, as_json=False)
        == 1
    )
    (wrong,) = [line for line in capsys.readouterr().out.splitlines() if "mine.yaml:" in line]
    due = "its trigger (state ramp_pos, after_scans 30000)"
    assert f"mine.yaml:3:5: the fault io.guard open had no effect: {due}" in wrong
    assert "ramp_pos lasted" in wrong
    assert "complete at scan" in wrong


def test_an_operator_whose_moment_does_not_come_fails_and_the_run_does_not_wait_for_him(tmp_path, capsys):
    operator = (
        "operator:\n  - {command: stop, when: {state: ramp_neg, after_scans: 10}}\nexpect:\n  - {final_state: fault}\n"
    )
    path = written(tmp_path, GUARD_LINE + operator)
    assert command_faults.run(path, FIXED, as_json=True) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["lines"] == [5]
    assert (
        "operator's stop was not given: its trigger (state ramp_neg, after_scans 10) was not reached"
        in said["wrong"][0]
    )


def test_an_operator_who_acts_twice_must_be_heard_twice(guard_opened):
    stop = {"command": "stop", "when": IN_RAMP}
    place = 11_000
    stopped = [image._replace(command=2) if at == place else image for at, image in enumerate(guard_opened.images)]
    run = dataclasses.replace(guard_opened, images=stopped)
    assert judge(run, scenario(operator=[stop])) == []
    (wrong,) = judge(run, scenario(operator=[stop, stop]))
    assert wrong.startswith("operator's stop was not given")


def test_an_alarm_before_the_fault_is_not_the_faults_doing(guard_opened):
    run = dataclasses.replace(guard_opened, acted=[("io.guard open", guard_opened.acted[0][1] + 500)])
    (wrong,) = judge(run, scenario(expect=[{"event": "guard_open", "within_scans": 12}]))
    assert "alarm came before" in wrong


def test_a_bench_that_was_refused_has_met_nothing_else():
    run = FaultRun(0.001, refused="no answer of the drive")
    assert visits(run) == []
    assert given(run) == {"states": "none: nothing has moved"}
    refused, event = {"refused": "no answer"}, {"event": "guard_open", "within_scans": 12}
    assert judge(run, scenario(expect=[refused])) == []
    (wrong,) = judge(run, scenario(expect=[refused, event]))
    assert "nothing has moved" in wrong
    kept = dataclasses.replace(run, kept=Kept("fault", None, ()))
    assert judge(kept, scenario(expect=[refused, {"found_as": "fault"}])) == []
    assert "was found as fault" in judge(kept, scenario(expect=[refused, {"found_as": "complete"}]))[0]


def test_a_long_list_keeps_its_ends():
    said = listed([str(number) for number in range(100)])
    assert said.startswith("0, 1, ")
    assert said.endswith(", 98, 99")
    assert f"{100 - MOST} more" in said
    assert listed([]) == "none"
