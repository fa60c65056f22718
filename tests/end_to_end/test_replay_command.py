"""`lostmotion replay` on runs in virtual time: identical, what if, damaged."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from run_copies import begun_anew
from run_samples import as_recorded, flip, records_of

from station.cli import errors
from station.records.chain.chain_file import CHAIN
from station.records.run_record import RunRecord
from station.records.samples.scan_record import RECORD_BYTES
from station.records.seal import seal

GOLDEN_RECIPE = Path(__file__).parents[1] / "proofs" / "golden" / "golden.yaml"


@pytest.fixture
def quick_recipe(quarter) -> Path:
    """The recipe of `quick_run`."""
    return Path(quarter("rv-40e-121-quick"))


def changed(recipe: Path, to: Path, *edits: tuple[str, str]) -> str:
    """Write a recipe anew with other words in it; return its path as the command takes it."""
    text = recipe.read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    to.write_text(text, encoding="utf-8")
    return str(to)


def as_if_cut_off(stored: Path) -> None:
    """What a power failure leaves: a run that nobody concluded, without events, result and checksums."""
    for name in ("events.jsonl", "result.json"):
        (stored / name).unlink()
    manifest = json.loads((stored / "run.json").read_text(encoding="utf-8"))
    del manifest["files"]
    manifest |= {"state": "interrupted", "verdict": None}
    (stored / "run.json").write_text(json.dumps(manifest), encoding="utf-8")
    (stored.parent / CHAIN).unlink()


def conclude_anew(stored: Path, result: dict[str, Any]) -> None:
    """Leave the run as if it had been concluded with another result."""
    run = RunRecord(stored)
    run.write_json("result.json", result)
    manifest = json.loads((stored / "run.json").read_text(encoding="utf-8"))
    del manifest["files"]
    run.write_json("run.json", manifest)
    seal(begun_anew(run), verdict=result["verdict"])


def test_stored_run_replays_identically_and_a_cut_one_up_to_the_cut(lostmotion, stored):
    ran = lostmotion("replay", str(stored), "--json")
    scans = len(records_of(stored))
    assert ran.exit_code == 0
    assert ran.json["identical_scans"] == scans
    assert (ran.json["difference"], ran.json["events_differ"], ran.json["program_differs"]) == (None, [], [])
    as_if_cut_off(stored)
    as_recorded(RunRecord(stored))
    with (stored / "samples.bin").open("r+b") as file:
        file.truncate(1000 * RECORD_BYTES + 17)
    ran = lostmotion("replay", str(stored))
    assert ran.exit_code == 0
    assert "1000 scans replayed identically" in ran.out
    assert "17 bytes" in ran.out


def test_changed_transition_list_and_damaged_record_are_found(lostmotion, stored):
    events = (stored / "events.jsonl").read_text(encoding="utf-8")
    (stored / "events.jsonl").write_text(events.replace('"to": "lock"', '"to": "calibrate"'), encoding="utf-8")
    ran = lostmotion("replay", str(stored))
    assert ran.exit_code == 1
    assert "transitions differ" in ran.out
    as_recorded(RunRecord(stored))
    flip(RunRecord(stored), 500 * RECORD_BYTES + 100)
    ran = lostmotion("replay", str(stored))
    assert ran.exit_code == 2
    assert "record 500 fails its CRC" in ran.out


@pytest.mark.parametrize(
    "junk", ["junk line\n", '{"kind": "transi', "[1, 2]\n", '{"kind": "transition"}\n', "7\n", "\n"]
)
def test_a_line_that_is_no_event_is_told_and_the_others_are_compared(lostmotion, stored, junk):
    with (stored / "events.jsonl").open("a", encoding="utf-8") as file:
        file.write(junk)
    count = len((stored / "events.jsonl").read_bytes().splitlines())
    ran = lostmotion("replay", str(stored))
    assert ran.exit_code == 1
    assert ran.out.startswith("RECORD ALTERED")
    assert f"events.jsonl: line {count} is not an event\n" in ran.out
    assert "transitions differ" not in ran.out


def test_events_that_are_no_text_are_told(lostmotion, stored):
    (stored / "events.jsonl").write_bytes(b"\xff\xfe\n\x00\n")
    ran = lostmotion("replay", str(stored), "--json")
    assert ran.exit_code == 1
    assert ran.json["events_differ"][0] == "events.jsonl: line 1 is not an event, nor is 1 more"
    assert ran.json["events_differ"][1].startswith("transitions differ: recorded 0")


@pytest.mark.parametrize("name", ["recipe.yaml", "program.json"])
def test_an_altered_record_that_cannot_be_replayed_is_called_altered_all_the_same(lostmotion, stored, name):
    (stored / name).write_text("junk {", encoding="utf-8")
    ran = lostmotion("replay", str(stored))
    assert (ran.exit_code, ran.out) == (2, "")
    first, second, *rest = ran.err.splitlines()
    assert first.startswith("RECORD ALTERED")
    assert second.startswith(f"record altered: {name}")
    assert any(name in line and "record altered" not in line for line in rest)
    told = lostmotion("replay", str(stored), "--json")
    assert (told.exit_code, told.err) == (2, ran.err)
    assert [set(error) for error in told.json["errors"]] == [{one.name for one in fields(errors.InputProblem)}]
    assert any(name in str(value) for value in told.json["errors"][0].values())


def test_another_program_is_told_and_its_first_differing_scan_shown(lostmotion, stored):
    recipe = (stored / "recipe.yaml").read_text(encoding="utf-8")
    changed = recipe.replace("torque_out_alarm: 36 %", "torque_out_alarm: 32 %")
    changed = changed.replace("unload: {torque_rate: 300", "unload: {torque_rate: 250")
    (stored / "recipe.yaml").write_text(changed, encoding="utf-8")
    ran = lostmotion("replay", str(stored))
    assert ran.exit_code == 1
    assert "program.limits.torque_out_alarm_nm: recorded" in ran.out
    assert "first difference at scan" in ran.out
    assert "* reference_torque_nm" in ran.out


def test_what_if_lists_interlocks_and_metrics_that_would_have_changed(lostmotion, stored, tmp_path):
    own = lostmotion("replay", str(stored), "--recipe", str(GOLDEN_RECIPE))
    assert own.exit_code == 0
    assert "nothing would have changed" in own.out
    other = changed(
        GOLDEN_RECIPE,
        tmp_path / "tighter.yaml",
        ("torque_out_alarm: 36 %", "torque_out_alarm: 20 %"),
        ("torque_out_trip: 40 %", "torque_out_trip: 25 %"),
        ("{id: torque_ratio_slope}", "{id: torque_ratio_slope, min: 200}"),
        ("name: golden", "name: tighter"),
    )
    ran = lostmotion("replay", str(stored), "--recipe", other, "--json")
    assert ran.exit_code == 1
    found = ran.json["what_if"]
    assert [(one["id"], one["change"]) for one in found["interlocks"]] == [
        ("torque_out_alarm", "new"),
        ("torque_out_trip", "new"),
    ]
    assert [one["diverges"] for one in found["interlocks"]] == [True, True]
    assert [one["exact"] for one in found["interlocks"]] == [True, False]
    assert [one["other"]["verdict"] for one in found["metrics"]] == ["FAIL"], "by what was recorded, which is not exact"
    assert (found["exact"], found["verdict"]["other"]) == (False, "NOT DECIDABLE")
    samples = json.loads((stored / "samples.json").read_text(encoding="utf-8"))
    assert samples["record_bytes"] == RECORD_BYTES, "a what-if leaves the record alone"


def test_what_if_decides_nothing_where_the_other_recipe_would_have_held_the_run(
    lostmotion, quick_run, quick_recipe, tmp_path
):
    run = str(quick_run.copy(tmp_path / "runs"))
    other = changed(
        quick_recipe,
        tmp_path / "trip60.yaml",
        ("torque_out_alarm: 114 %", "torque_out_alarm: 50 %"),
        ("torque_out_trip: 120 %", "torque_out_trip: 60 %"),
    )
    ran = lostmotion("replay", run, "--recipe", other, "--json")
    assert ran.exit_code == 1
    found = ran.json["what_if"]
    hold, trip = found["interlocks"]
    assert (hold["id"], hold["exact"], trip["id"], trip["exact"]) == (
        "torque_out_alarm",
        True,
        "torque_out_trip",
        False,
    )
    assert found["divergence"]["fault"] == "torque_out_alarm"
    assert found["divergence"]["scan"] == hold["other_scan"] < trip["other_scan"]
    assert (found["verdict"]["recorded"], found["verdict"]["other"]) == ("PASS", "NOT DECIDABLE")
    assert f"scan {hold['other_scan']} " in found["verdict"]["reasons"][0]
    assert "torque_out_alarm (hold) would have been raised" in found["verdict"]["reasons"][0]
    told = lostmotion("replay", run, "--recipe", other).out.splitlines()
    marked = next(number for number, line in enumerate(told) if line.lstrip().startswith("estimated"))
    assert [number > marked for number, line in enumerate(told) if "interlock" in line] == [False, True]
    assert told[-1].startswith("  verdict: PASS as recorded, NOT DECIDABLE with the other recipe: ")


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (("dwell: 40 ms}", "dwell: 80 ms}"), " instead of "),
        (("{torque_rate: 300 N·m/s}", "{torque_rate: 250 N·m/s}"), " instead of "),
        (("max_torque: 3 %", "max_torque: 0.3 %"), "state unload instead of release"),
        (("torque_out_tare: 5 N·m", "torque_out_tare: 0.0001 N·m"), "tare_out_of_range (power_off)"),
        (("max_motion: 0.2 arcmin", "max_motion: 0.0001 arcmin"), "lock_slip (unload)"),
    ],
)
def test_what_if_sees_what_no_limit_of_the_load_tells(lostmotion, stored, tmp_path, edit, cause):
    other = changed(GOLDEN_RECIPE, tmp_path / "other.yaml", edit)
    ran = lostmotion("replay", str(stored), "--recipe", other, "--json")
    found = ran.json["what_if"]
    assert (ran.exit_code, found["changed"]) == (1, True)
    assert cause in found["divergence"]["cause"]
    assert (found["verdict"]["other"], found["refused"]) == ("NOT DECIDABLE", [])
    assert "nothing would have changed" not in lostmotion("replay", str(stored), "--recipe", other).out


def test_what_if_takes_a_recipe_that_a_run_refuses_for_one_without_a_verdict(
    lostmotion, quick_run, quick_recipe, tmp_path
):
    run = str(quick_run.copy(tmp_path / "runs"))
    other = changed(quick_recipe, tmp_path / "idle.yaml", ("{id: windup}", "{id: windup, min: 0 arcmin}"))
    ran = lostmotion("replay", run, "--recipe", other, "--json")
    found = ran.json["what_if"]
    assert (ran.exit_code, found["divergence"]) == (1, None)
    assert (found["verdict"]["recorded"], found["verdict"]["other"]) == ("PASS", "NOT DECIDABLE")
    assert found["verdict"]["reasons"][0].startswith("a run would refuse the recipe: ")
    never = changed(quick_recipe, tmp_path / "never.yaml", ("max_torque: 2 %", "max_torque: 0.001 %"))
    ran = lostmotion("replay", run, "--recipe", never)
    assert ran.exit_code == 1
    assert "a run would refuse it" in ran.out
    assert "nothing would have changed" not in ran.out


def test_what_if_tells_the_slip_limit_from_that_of_the_proof_where_both_are_the_same(
    lostmotion, quick_recipe, tmp_path
):
    own = changed(quick_recipe, tmp_path / "own.yaml", ("lock_slip: 0.5 arcmin", "lock_slip: 0.2 arcmin"))
    ran = lostmotion("run", own, "--virtual-time", "--unit", "P1", "--serial", "SL", "--json")
    assert ran.exit_code == 0, ran
    other = changed(quick_recipe, tmp_path / "other.yaml", ("lock_slip: 0.5 arcmin", "lock_slip: 0.01 arcmin"))
    asked = lostmotion("replay", str(ran.record), "--recipe", other, "--json")
    (slip,) = asked.json["what_if"]["interlocks"]
    assert (slip["id"], slip["change"], slip["state"], slip["exact"]) == ("lock_slip", "new", "calibrate", True)
    assert asked.json["what_if"]["verdict"]["other"] == "NOT DECIDABLE"


def test_what_if_evaluates_the_ramps_that_the_other_recipe_measures(lostmotion, tmp_path):
    block = "  - torque_cycles: {count: 1, peak_torque: 30 %, torque_rate: 300 N·m/s, dwell: 40 ms}\n"
    short = block.replace("dwell: 40 ms", "dwell: 4 ms")
    fatigue = block.replace("torque_cycles", "fatigue_cycles").replace(", dwell: 40 ms", "")
    wanted = ("{id: torque_ratio_slope}", "{id: lost_motion}")
    own = changed(GOLDEN_RECIPE, tmp_path / "own.yaml", (block, short + block), wanted)
    ran = lostmotion("run", own, "--virtual-time", "--serial", "TWO", "--json")
    other = changed(GOLDEN_RECIPE, tmp_path / "other.yaml", (block, fatigue + block), wanted)
    found = lostmotion("replay", str(ran.record), "--recipe", other, "--json").json["what_if"]
    assert (found["divergence"], found["same_load"], found["changed"]) == (None, False, True)
    (metric,) = found["metrics"]
    assert (metric["recorded"]["cycles"], metric["other"]["cycles"]) == (2, 1)
    out = lostmotion("replay", str(ran.record), "--recipe", other).out
    assert "gives the same orders as far as the run went" in out


def test_a_recipe_that_cannot_say_anything_about_the_run_is_refused(lostmotion, stored, tmp_path):
    for recipe, said in (
        ("static-50nm", "unit_under_test.model: found RV-50"),
        ("rv-40e-121-output", "loading: found output"),
        (
            changed(GOLDEN_RECIPE, tmp_path / "2ms.yaml", ("period: 4 ms", "period: 2 ms")),
            "sampling.period: found 2 ms; run",
        ),
    ):
        ran = lostmotion("replay", str(stored), "--recipe", recipe)
        assert (ran.exit_code, ran.out) == (2, "")
        assert said in ran.err


def test_what_speaks_against_a_run_besides_its_recipe_speaks_against_any_other_recipe(
    lostmotion, quick_run, quick_recipe, tmp_path
):
    stored = quick_run.copy(tmp_path / "runs")
    result = json.loads((stored / "result.json").read_text(encoding="utf-8"))
    said = "the supervisor was lost before the scan process could say that it had ended"
    result |= {"verdict": "NOT DECIDABLE", "reasons": [said, *result["reasons"]]}
    conclude_anew(stored, result)
    other = changed(
        quick_recipe, tmp_path / "other.yaml", ("{id: backlash_width_3pct, max: 1", "{id: backlash_width_3pct, max: 2")
    )
    found = lostmotion("replay", str(stored), "--recipe", other, "--json").json["what_if"]
    assert (found["verdict"]["recorded"], found["verdict"]["other"]) == ("NOT DECIDABLE", "NOT DECIDABLE")
    assert said in found["verdict"]["reasons"][0]


def test_a_replay_that_differs_is_told_from_a_recipe_that_would_have_changed_something(lostmotion, stored):
    events = (stored / "events.jsonl").read_text(encoding="utf-8")
    as_if_cut_off(stored)
    (stored / "events.jsonl").write_text(events.replace('"to": "lock"', '"to": "calibrate"'), encoding="utf-8")
    assert lostmotion("replay", str(stored)).exit_code == 1
    ran = lostmotion("replay", str(stored), "--recipe", str(GOLDEN_RECIPE))
    assert ran.exit_code == 3
    assert "another recipe cannot be computed" in ran.out
    as_recorded(RunRecord(stored))
    flip(RunRecord(stored), 500 * RECORD_BYTES + 100)
    ran = lostmotion("replay", str(stored), "--recipe", str(GOLDEN_RECIPE), "--json")
    assert (ran.exit_code, "what_if" in ran.json) == (2, False)
    assert ran.json["what_if_refused"].endswith("a damaged record")


def test_unknown_run_and_recipe_are_bad_input(lostmotion, stored):
    assert lostmotion("replay", "nothing-like-it").exit_code == 2
    assert lostmotion("replay", str(stored), "--recipe", "no-such-recipe").exit_code == 2


def test_an_altered_record_is_replayed_but_never_called_identical_without_saying_so(lostmotion, stored):
    result = (stored / "result.json").read_text(encoding="utf-8")
    (stored / "result.json").write_text(result.replace("NOT DECIDABLE", "PASS"), encoding="utf-8")
    ran = lostmotion("replay", str(stored))
    assert ran.exit_code == 3
    first, second, *_ = ran.out.splitlines()
    assert first.startswith("RECORD ALTERED")
    assert second.startswith("record altered: result.json")
    ran = lostmotion("replay", str(stored), "--json", "--recipe", str(GOLDEN_RECIPE))
    assert ran.exit_code == 3
    assert ran.json["altered"][0].startswith("result.json")
    assert ran.json["difference"] is None
    assert "what_if" not in ran.json
