"""The main job in virtual time: figures, bad units, determinism."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from patient import patient_bench, short_recipe
from printed_numbers import alike
from run_samples import recorded
from shipped_copies import simple_acceptance

from recipes import PRESETS

OF_UNIT_P1: dict[tuple[str, str | None], object] = {
    ("backlash_width_3pct", None): pytest.approx(0.940, abs=0.03),
    ("lost_motion", None): pytest.approx(0.376, abs=0.03),
    ("spring_constant", None): pytest.approx(115.17, rel=0.02),
    ("stiffness_50_100", "load"): pytest.approx(104.70, rel=0.01),
    ("torque_ratio_slope", None): pytest.approx(94.7, rel=0.01),
    ("torque_ratio_offset", None): pytest.approx(-13.9, abs=0.5),
}
"""What the inverse recipe must recover of the reference unit."""

BENCH_RECIPES: dict[str, dict[tuple[str, str | None], object]] = {
    "rv-40e-121-inverse": OF_UNIT_P1,
    "rv-40e-121-measurement": {},
    "rv-40e-121-output": {},
    "static-50nm": {},
}
"""The recipes of each kind of bench, with figures of their default unit."""


AT_4_MS = {"sampling": {"period": "4 ms"}}
"""Of the short recipe: what it shows does not hang on the number of its scans."""


def recipe(name: str) -> str:
    return f"recipes/{name}.yaml"


def metric(result: dict, metric_id: str, branch: str | None = None) -> float:
    (value,) = [m["value"] for m in result["metrics"] if m["id"] == metric_id and branch in (None, m["branch"])]
    return value


def test_calibrated_input_torque_recovers_them_too(lostmotion, quarter, tmp_path):
    text = Path(quarter("rv-40e-121-quick")).read_text(encoding="utf-8")
    path = tmp_path / "calibrated.yaml"
    path.write_text(text.replace("output_torque: reaction", "output_torque: calibrated"), encoding="utf-8")
    result = lostmotion("run", str(path), "--virtual-time", "--json", "--unit", "P1", "--serial", "P1").json
    assert result["state"] == "complete"
    assert metric(result, "backlash_width_3pct") == pytest.approx(0.940, abs=0.05)
    assert metric(result, "stiffness_50_100", "load") == pytest.approx(104.70, rel=0.02)


def test_the_quick_recipe_passes_its_unit_at_its_own_period(as_shipped_run):
    ran = as_shipped_run.ran
    assert (ran.exit_code, ran.json["state"], ran.json["verdict"]) == (0, "complete", "PASS"), ran.json["reasons"]
    assert ran.json["timing"]["period_ns"] == 1_000_000


def test_a_sound_unit_whose_torque_runs_ahead_through_its_play_passes(lostmotion, quarter):
    """Its torque jumps by 6 N·m as it takes up its play, and waits for the ramp: no rest of it."""
    ran = lostmotion(
        "run", quarter("rv-40e-121-quick"), "--virtual-time", "--json", "--unit", "P1:4", "--serial", "P1-4"
    )
    assert (ran.exit_code, ran.json["verdict"]) == (0, "PASS"), ran.json["reasons"]


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(BENCH_RECIPES))
def test_recipe_of_each_bench_passes_its_unit_at_its_own_period_too(stored_once, name):
    """The other tests here run copies with a quarter of the scans."""
    ran = stored_once(f"as-shipped-{name}", name, "--serial", "SN 1", "--no-report").ran
    assert (ran.exit_code, ran.json["state"], ran.json["verdict"]) == (0, "complete", "PASS"), ran.json["reasons"]
    assert ran.json["timing"]["period_ns"] == 1_000_000
    assert {key: metric(ran.json, *key) for key in BENCH_RECIPES[name]} == BENCH_RECIPES[name]


@pytest.mark.parametrize("name", BENCH_RECIPES)
def test_recipe_of_each_bench_passes_its_unit_and_recovers_its_figures(shipped_run, name):
    ran = shipped_run(name).ran
    found = (ran.exit_code, ran.json["state"], ran.json["verdict"])
    assert found == (0, "complete", "PASS"), ran.json["reasons"]
    assert {key: metric(ran.json, *key) for key in BENCH_RECIPES[name]} == BENCH_RECIPES[name]
    assert [one["id"] for one in ran.json["metrics"] if one["value"] is None] == []
    presets = {"rv-40e-121-output": "output", "static-50nm": "static"}
    asked = {one.id for one in PRESETS[presets[name]].metrics} if name in presets else set()
    assert asked <= {one["id"] for one in ran.json["metrics"]}


@pytest.mark.parametrize(
    ("unit", "failing"),
    [
        ("worn", {"backlash_width_3pct"}),
        ("soft", {"spring_constant", "stiffness_50_100"}),
        ("tight", {"torque_ratio_offset"}),
        ("cracked", {"spring_constant", "stiffness_50_100"}),
    ],
)
def test_a_bad_unit_fails_for_the_right_metric(lostmotion, quarter, worn_run, unit, failing):
    words = ("--virtual-time", "--json", "--unit", unit, "--serial", unit)
    ran = worn_run.ran if unit == "worn" else lostmotion("run", quarter("rv-40e-121-quick"), *words)
    assert (ran.exit_code, ran.json["verdict"], ran.json["state"]) == (1, "FAIL", "complete")
    assert {m["id"] for m in ran.json["metrics"] if m["verdict"] == "FAIL"} == failing
    assert all(any(name in reason for reason in ran.json["reasons"]) for name in failing)


def test_a_loose_lock_ends_in_a_fault_that_names_it(lostmotion):
    ran = lostmotion(
        "run", recipe("rv-40e-121-quick"), "--virtual-time", "--json", "--unit", "loose-lock", "--serial", "L"
    )
    result = ran.json
    assert (ran.exit_code, result["state"]) == (4, "fault")
    assert result["verdict"] != "PASS"
    assert result["alarms"][0]["id"] in ("lock_slip", "lock_unproven")
    assert "lock" in result["alarms"][0]["next_action"].lower()


def test_same_seed_same_bytes_another_seed_other_bytes(lostmotion, tmp_path):
    recipe_file, bench = str(short_recipe(tmp_path, AT_4_MS)), str(patient_bench(tmp_path))
    runs = [
        lostmotion("run", recipe_file, "--bench", bench, "--virtual-time", "--json", "--unit", unit, "--serial", "S")
        for unit in ("P1:7", "P1:7", "P1:8")
    ]
    first, again, other = (recorded(run.record) for run in runs)
    assert first == again
    assert first != other


def test_wrong_recipe_is_refused_before_anything_happens(lostmotion, tmp_path):
    path = tmp_path / "bad.yaml"
    text = Path(recipe("rv-40e-121-quick")).read_text(encoding="utf-8")
    path.write_text(text.replace("peak_torque: 110 %", "peak_torqe: 110 %").replace("1 ms", "1 mm"), encoding="utf-8")
    before = set(tmp_path.iterdir())
    for args in (("run", str(path), "--serial", "X"), ("check", str(path))):
        ran = lostmotion(*args)
        assert ran.exit_code == 2
        assert "Did you mean 'peak_torque'?" in ran.err + ran.out
        assert f"{path}:" in ran.err + ran.out
    assert set(tmp_path.iterdir()) == before


def test_published_loop_through_analyze_gives_its_check_values(lostmotion, tmp_path):
    trace = "tests/data/loop_published_curve.csv"
    ran = lostmotion("analyze", trace, "--recipe", simple_acceptance(tmp_path, "rv-40e-121-inverse"), "--json")
    result = ran.json
    assert metric(result, "backlash_width_3pct") == pytest.approx(0.9400, abs=5e-5)
    assert metric(result, "backlash_width_zero") == pytest.approx(0.9408, abs=5e-5)
    assert metric(result, "lost_motion") == pytest.approx(0.9591, abs=5e-5)
    assert metric(result, "spring_constant") == pytest.approx(115.17, abs=5e-3)
    assert metric(result, "hysteresis_energy") == pytest.approx(526.86, abs=5e-3)
    # the published unit is soft on its negative side; what the file does not hold is named
    assert (ran.exit_code, result["verdict"]) == (1, "FAIL")
    assert any("torque_ratio_offset" in reason for reason in result["reasons"])


def test_stored_run_is_shown_listed_and_analysed_again(lostmotion, tmp_path):
    recipe_file, bench = str(short_recipe(tmp_path, AT_4_MS)), str(patient_bench(tmp_path))
    ran = lostmotion("run", recipe_file, "--bench", bench, "--virtual-time", "--json", "--serial", "S1")
    run_id = ran.json["run"]
    assert run_id in lostmotion("list").out.replace("\n", "") or "S1" in lostmotion("list").out
    assert "PASS" in lostmotion("show", run_id).out
    again = lostmotion("analyze", str(ran.record), "--recipe", recipe_file, "--json").json
    assert alike(*([m["value"] for m in found["metrics"]] for found in (again, ran.json)))


def test_a_scenario_acts_in_a_run_as_it_does_in_its_own_command(lostmotion):
    scenario = str(Path(__file__).parents[2] / "scenarios" / "heartbeat-lost.yaml")
    ran = lostmotion("run", recipe("rv-40e-121-faults"), "--virtual-time", "--json", "--serial", "H",
                     "--scenario", scenario)  # fmt: skip
    assert ran.exit_code == 4
    assert ran.json["state"] == "fault"
    assert [alarm["id"] for alarm in ran.json["alarms"] if alarm["first"]] == ["drive_heartbeat_lost"]


def test_injected_faults_are_told_wherever_the_run_is_looked_at(lostmotion, tmp_path):
    scenario = tmp_path / "late sample.yaml"
    scenario.write_text(
        "scenario: {name: late sample}\nfaults:\n  - {target: modbus.amplifier, verb: slow, value: 14, "
        "when: {state: ramp_neg, after_scans: 50}, for_ms: 50}\n",
        encoding="utf-8",
    )
    recipe_file, bench = str(short_recipe(tmp_path, AT_4_MS)), str(patient_bench(tmp_path))
    words = ("--serial", "G1", "--operator", "A. Tester", "--scenario", str(scenario))
    ran = lostmotion("run", recipe_file, "--bench", bench, "--virtual-time", "--json", *words)
    assert (ran.json["scenario"], ran.json["operator"]) == (str(scenario), "A. Tester")
    assert lostmotion("show", "G1", "--json").json["scenario"] == str(scenario)
    assert lostmotion("analyze", str(ran.record), "--json").json["scenario"] == str(scenario)
    for words in (("show", "G1"), ("analyze", str(ran.record))):
        assert "FAULTS INJECTED" in lostmotion(*words).out
    out = tmp_path / "g1.parquet"
    assert lostmotion("export", str(ran.record), "--out", str(out)).exit_code == 0
    run = json.loads(pq.read_schema(out).metadata[b"lostmotion"])
    assert (run["scenario"], run["operator"], run["virtual_unit"]) == (str(scenario), "A. Tester", "P1")
    lostmotion("report", str(ran.record), "--out", str(tmp_path / "report"))
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert '<span class="badge">FAULTS INJECTED</span>' in page
    assert f"<dt>faults injected</dt><dd>{scenario}</dd>" in page
