"""Guided studies: what a plan refuses, which runs count, what is missing in words, and the figures."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lostmotion_command import here
from stored_runs import BENCH_TEXT, metric, recipe_text, store_run

from recipes import RecipeError
from station.documents.study import GAGE, TYPE_ONE, StudyCell, StudyMetric, StudyPlan
from station.errors import StationError
from station.quality.guided.plan import Asked, plan_of
from station.quality.guided.progress import look, settle
from station.records.studies import Study, StudyError, begin_study, read_study, study_names
from station.records.verify import verify_folder
from station.store.quality.lot import Lot, production
from virtual_bench.errors import VirtualBenchError

GOLDEN = str(Path(__file__).parents[2] / "proofs" / "golden" / "golden.yaml")
SLOPE = ("--metric", "torque_ratio_slope")
GAGE_ASKED = Asked(GAGE, GOLDEN, None, ("A=P1:1", "B=P1:2"), ("Anna", "Ben"), ("torque_ratio_slope",), trials=2)
TYPE_ONE_ASKED = replace(
    GAGE_ASKED, kind=TYPE_ONE, parts=("M",), operators=(), trials=25, references=(94.0,), tolerances=(9.0,)
)


def sha256(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()


def plan(kind: str, parts: tuple[str, ...], operators: tuple[str, ...], trials: int) -> StudyPlan:
    """A plan that fits the runs of `store_run`, in the order of parts within operators within trials."""
    cells = [
        StudyCell(part=part, operator=one, trial=trial)
        for trial in range(1, trials + 1) for one in operators or ("",) for part in parts
    ]  # fmt: skip
    wanted = StudyMetric(id="lost_motion", reference=0.5 if kind == TYPE_ONE else None, tolerance=0.2)
    return StudyPlan(
        kind=kind, metrics=(wanted,), recipe="inverse", revision=1, recipe_file="r",
        recipe_sha256=sha256(recipe_text("inverse", 1)),
        bench="b", bench_file="b", bench_sha256=sha256(BENCH_TEXT), virtual=False, parts=parts, units={},
        operators=operators, trials=trials, share=20.0, seed=1, order=tuple(cells),
    )  # fmt: skip


def measured(data: Path, study: Study, step: int, value: float | None = 0.5, **changes: Any) -> str:
    cell = study.plan.order[step - 1]
    given = {"operator": cell.operator or None, "study": study.place(step)} | changes
    return store_run(data, str(given.pop("serial", cell.part)), [metric(value)], **given).id


@pytest.fixture
def data(tmp_path: Path) -> Path:
    (tmp_path / "runs").mkdir()
    return tmp_path / "runs"


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (replace(GAGE_ASKED, kind="gauge"), "--kind: found 'gauge'; allowed are type1 and gage"),
        (replace(GAGE_ASKED, parts=("A",)), "--part: found 1; a gage study has 2 units or more"),
        (replace(GAGE_ASKED, operators=("Anna",)), "name who puts the unit on, or the shifts"),
        (replace(GAGE_ASKED, operators=("Anna", "Anna")), "--operator: found 'Anna' twice"),
        (replace(GAGE_ASKED, trials=1), "--trials: found 1; a gage study has 2 trials or more"),
        (replace(GAGE_ASKED, trials=999), "allowed are up to 1000"),
        (replace(GAGE_ASKED, references=(1.0,)), "only a type 1 study has a reference value"),
        (replace(GAGE_ASKED, metrics=()), "--metric: found none"),
        (replace(GAGE_ASKED, metrics=("backlash",)), "the recipe golden has the metrics torque_ratio_slope"),
        (replace(GAGE_ASKED, parts=("A=Z9", "B")), "Z9"),
        (replace(GAGE_ASKED, tolerances=(-1.0,)), "--tolerance: found -1"),
        (replace(TYPE_ONE_ASKED, parts=("M", "N")), "--part: found 2 units; a type 1 study measures exactly one"),
        (replace(TYPE_ONE_ASKED, trials=24), "--trials: found 24; a type 1 study has 25 measurements"),
        (replace(GAGE_ASKED, tolerances=(math.inf,)), "--tolerance: found inf"),
        (replace(GAGE_ASKED, tolerances=(math.nan,)), "--tolerance: found nan"),
        (replace(TYPE_ONE_ASKED, references=(math.nan,)), "--reference: found nan; allowed is the value of the part"),
        (replace(TYPE_ONE_ASKED, references=(-math.inf,)), "--reference: found -inf"),
        (replace(TYPE_ONE_ASKED, references=()), "--reference: found 0 values for 1 metric;"),
        (replace(TYPE_ONE_ASKED, tolerances=()), "has one limit or none, so its tolerance is not known"),
        (replace(TYPE_ONE_ASKED, recipe="nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_a_plan_that_could_not_be_evaluated_is_refused_before_anything_is_measured(asked: Asked, said: str) -> None:
    with pytest.raises((StationError, RecipeError, VirtualBenchError)) as refused:
        plan_of(asked)
    assert said in str(refused.value)


def test_a_plan_keeps_the_seed_and_the_order() -> None:
    found, same = (plan_of(replace(GAGE_ASKED, seed=7)) for _ in range(2))
    assert found == same
    assert (len(found.order), found.seed, found.units) == (8, 7, {"A": "P1:1", "B": "P1:2"})
    assert plan_of(GAGE_ASKED).seed != plan_of(GAGE_ASKED).seed, "drawn where nobody gives one"


def test_a_name_that_is_no_file_name_is_refused(data: Path) -> None:
    for name in ("", "../a", "a/b", ".a", "a" * 41, "a\n"):
        with pytest.raises(StudyError, match="allowed are 1 to 40 letters"):
            begin_study(data, name, plan(TYPE_ONE, ("M",), (), 2), "Q")


NO_MEASUREMENTS: dict[str, tuple[dict[str, Any], str]] = {
    "another unit": ({"serial": "B"}, "the run measured unit B, and the plan of the study has unit A here"),
    "another operator": ({"operator": "Ben"}, "the run has the operator Ben, and the plan of the study has Anna"),
    "nobody": ({"operator": None}, "the run has the operator none"),
    "stopped": ({"state": "stopped"}, "the run ended as stopped"),
    "faulted": ({"state": "fault"}, "the run ended as fault"),
    "faults injected": ({"scenario": "s.yaml"}, "faults were injected"),
    "not decidable": ({"reasons": ["measurement invalid: drift"]}, "not decidable: measurement invalid: drift"),
    "virtual": ({"virtual": "P1"}, "the run is simulated"),
    "no value": ({"value": None}, "the run has no value of lost_motion"),
}


@pytest.mark.parametrize("case", NO_MEASUREMENTS)
def test_a_run_that_is_no_measurement_leaves_its_step_open(data: Path, case: str) -> None:
    changes, said = NO_MEASUREMENTS[case]
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    run = measured(data, study, 1, **changes)
    found = look(data, "g")
    assert (found.next or (0,))[0] == 1
    assert [(one.step, one.run) for one in found.does_not_count] == [(1, run)]
    assert said in found.does_not_count[0].why
    good = measured(data, study, 1)
    assert settle(data, "g", "Q").measured == {1: good}
    assert read_study(data, "g").taken[1].run == good


def test_a_unit_that_fails_and_one_near_its_limit_are_measurements(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    runs = [measured(data, study, 1, failed="lost_motion"), measured(data, study, 2, reasons=["lost_motion: near"])]
    assert look(data, "g").measured == {1: runs[0], 2: runs[1]}


def test_the_first_good_run_of_a_step_counts_and_nobody_measures_until_it_pleases(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    first, second = measured(data, study, 1, 0.9), measured(data, study, 1, 0.5)
    found = look(data, "g")
    assert found.measured == {1: first}
    assert (found.does_not_count[0].run, found.does_not_count[0].why) == (
        second,
        f"the step was measured by run {first}",
    )


def test_a_run_that_is_altered_later_opens_its_step_again(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    first = measured(data, study, 1)
    measured(data, study, 2)
    settle(data, "g", "Q")
    path = data / first / "result.json"
    path.write_text(path.read_text("utf-8").replace("0.5", "0.6"), "utf-8")
    found = look(data, "g")
    assert (found.next or (0,))[0] == 1
    assert found.does_not_count[0].why.startswith("altered: result.json")
    again = measured(data, study, 1)
    assert settle(data, "g", "Q").measured[1] == again
    assert read_study(data, "g").taken[1].run == again


def test_a_run_whose_folder_is_gone_is_named(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    run = measured(data, study, 1)
    settle(data, "g", "Q")
    (data / run).rename(data.parent / "elsewhere")
    found = look(data, "g")
    assert (found.next or (0,))[0] == 1
    assert "missing or damaged" in found.does_not_count[0].why


def test_runs_of_another_study_and_of_the_production_do_not_count_and_are_told(data: Path) -> None:
    begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    other = begin_study(data, "h", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 3), "Q")
    runs = {measured(data, other, 1, day=3000), store_run(data, "A", [metric(0.5)], operator="Anna", day=3000).id}
    found = look(data, "g")
    assert found.measured == {}
    assert set(found.beside) == runs


def changed(text: str) -> str:
    return text.replace('"person":"Q"', '"person":"R"', 1)


@pytest.mark.parametrize(
    ("deed", "said"),
    [
        (changed, "line 1 is not signed"),
        (lambda text: text.split("\n", 1)[1], "line 1 does not follow"),
        (lambda text: "\n".join(text.split("\n")[:1] + text.split("\n")[2:]), "line 2 does not follow"),
        (lambda text: f"{text[:-2]})\n", "its last line"),
        (lambda text: f"{text.split(chr(10))[0][:-1]})\n", "its last line"),
    ],
)
def test_a_file_that_was_changed_measures_and_evaluates_nothing(
    data: Path, deed: Callable[[str], str], said: str
) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    for step in (1, 2):
        measured(data, study, step)
    settle(data, "g", "Q")
    study.path.with_name("killed.jsonl").touch()
    assert verify_folder(data).problems == []
    study.path.write_text(deed(study.path.read_text("utf-8")), "utf-8")
    with pytest.raises(StudyError, match=said):
        look(data, "g")
    assert [(one.kind, said in one.text) for one in verify_folder(data).problems] == [("study", True)]
    for words in (("next",), ("status",), ("evaluate",), ("measure",)):
        assert here("quality", "study", *words, "g", "--data", str(data)).exit_code == 2


def test_a_torn_line_is_none_and_the_next_one_stands_behind_it(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    with study.path.open("ab") as file:
        file.write(b'{"kind":"study_taken","counter":2')
    run = measured(data, study, 1)
    settle(data, "g", "Q")
    assert read_study(data, "g").taken[1].run == run


@pytest.mark.parametrize("left", [b"", b'{"kind": "study beg'])
def test_a_study_whose_beginning_was_cut_off_keeps_no_other_from_being_listed(data: Path, left: bytes) -> None:
    begin_study(data, "whole", plan(GAGE, ("A", "B"), ("x", "y"), 2), "Anna")
    (data / "studies" / "cut.jsonl").write_bytes(left)
    (data / "studies" / "a copy of whole.jsonl").write_bytes(b"of another hand\n")
    assert study_names(data) == ["whole"]
    shown = here("quality", "study", "status", "--data", str(data))
    assert "0 of 8" in shown.out
    assert verify_folder(data).problems == []
    begin_study(data, "cut", plan(GAGE, ("A", "B"), ("x", "y"), 2), "Anna")
    assert study_names(data) == ["cut", "whole"], "it is begun anew"


def test_the_same_name_is_begun_once(data: Path) -> None:
    begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    with pytest.raises(StudyError, match="was begun already"):
        begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 3), "Q")


def test_a_type_one_study_of_25_is_evaluated_on_its_runs_alone(data: Path) -> None:
    values = 0.503 + 0.002 * np.random.default_rng(3).standard_normal(25)
    study = begin_study(data, "cg", plan(TYPE_ONE, ("M",), (), 25), "Q")
    for step, value in enumerate(values, start=1):
        store_run(data, "M", [metric(0.9)])  # of the production, between them
        measured(data, study, step, float(value))
    found = here("quality", "study", "evaluate", "cg", "--data", str(data), "--json")
    assert found.exit_code in (0, 1), found.err
    said = found.json["figures"][0]["study"]
    sd = float(np.std(values, ddof=1))
    assert said["measurements"] == 25
    assert said["cg"] == pytest.approx(0.2 * 0.2 / (6 * sd))
    assert said["cgk"] == pytest.approx((0.1 * 0.2 - abs(values.mean() - 0.5)) / (3 * sd))
    assert found.exit_code == (0 if said["capable"] else 1)


def test_a_gage_study_gives_the_figures_of_the_same_values_in_a_file(data: Path, tmp_path: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B", "C"), ("Anna", "Ben"), 2), "Q")
    random, rows = np.random.default_rng(5), ["operator,part,value"]
    for step, cell in enumerate(study.plan.order, start=1):
        value = {"A": 0.4, "B": 0.5, "C": 0.6}[cell.part] + 0.01 * float(random.standard_normal())
        measured(data, study, step, value)
        rows.append(f"{cell.operator},{cell.part},{value!r}")
    (tmp_path / "study.csv").write_text("\n".join(rows), "utf-8")
    wanted = here("gage", str(tmp_path / "study.csv"), "--tolerance", "0.2", "--json").json["anova"]
    found = here("quality", "study", "evaluate", "g", "--data", str(data), "--json")
    assert found.exit_code == 0, found.err
    said = found.json["figures"][0]["anova"]
    for name in ("sd_gage", "sd_repeatability", "sd_part", "grr_pct"):
        assert said[name] == pytest.approx(wanted[name])
    assert said["tolerance_pct"] == pytest.approx(wanted["tolerance_pct"])
    assert "3 parts × 2 operators × 2 trials" in here("quality", "study", "evaluate", "g", "--data", str(data)).out


def test_an_incomplete_design_is_refused_by_what_is_missing(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 3), "Q")
    for step, cell in enumerate(study.plan.order, start=1):
        if cell.part == "A" or cell.operator == "Anna":
            measured(data, study, step)
    bad = measured(data, study, 4, state="stopped")
    found = here("quality", "study", "evaluate", "g", "--data", str(data))
    assert found.exit_code == 2
    assert "study g: 9 of 12 steps are measured" in found.err
    assert "unit B by Ben: trials 1 to 3" in found.err
    assert f"step 4, run {bad} does not count: the run ended as stopped" in found.err
    status = here("quality", "study", "status", "g", "--data", str(data))
    assert status.exit_code == 1
    assert "missing: unit B by Ben: trials 1 to 3" in status.out
    assert "study g: gage study of lost_motion" in status.out
    assert "9 of 12" in here("quality", "study", "status", "--data", str(data)).out
    begin_study(data, "t", plan(TYPE_ONE, ("A",), (), 25), "Q")
    assert "study t: type 1 study of lost_motion" in here("quality", "study", "status", "t", "--data", str(data)).out
    assert " type 1 " in here("quality", "study", "status", "--data", str(data)).out


def test_runs_of_a_study_are_no_production(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    store_run(data, "U", [metric(0.5)])
    measured(data, study, 1, failed="lost_motion")
    with production(data) as view:
        assert view._number(Lot()) == 1
    said = here("quality", "yield", "--data", str(data), "--json").json
    assert (said["whole"]["first_pass"]["number"], said["whole"]["first_pass"]["of"]) == (1, 1)


def test_the_capability_of_the_production_is_not_that_of_the_units_of_a_study(data: Path) -> None:
    study = begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    for value in (0.4, 0.5, 0.6):
        store_run(data, f"U{value}", [metric(value)])
    for step in (1, 2, 3):
        measured(data, study, step, 0.9)
    for command in ("capability", "units"):
        said = here(command, "--metric", "lost_motion", "--data", str(data), "--json")
        assert said.exit_code in (0, 1), said.err
        assert (len(said.json["runs"]), said.json["left_out"]) == (3, {"of a guided study": 3})
    gage = here("gage", "--metric", "lost_motion", "--data", str(data), "--by", "run")
    assert "of a guided study" not in gage.out + gage.err


def test_a_real_bench_wants_the_label_of_every_unit(data: Path) -> None:
    begin_study(data, "g", plan(GAGE, ("A", "B"), ("Anna", "Ben"), 2), "Q")
    for words in ((), ("--serial", "A", "--all")):
        found = here("quality", "study", "measure", "g", *words, "--data", str(data))
        assert found.exit_code == 2
        assert "Scan the label of the unit on the bench" in found.err


def test_a_gage_study_on_the_virtual_bench_from_its_plan_to_its_figures(tmp_path: Path) -> None:
    data = str(tmp_path / "runs")
    parts = ("--part", "A=P1:1", "--part", "B=P1:2", "--operator", "Anna", "--operator", "Ben", "--trials", "2")
    words = (
        "begin",
        "g",
        "--kind",
        "gage",
        "--recipe",
        GOLDEN,
        *parts,
        *SLOPE,
        "--seed",
        "4",
        "--by",
        "Q",
        "--data",
        data,
    )
    begun = here("quality", "study", *words, "--json")
    assert begun.exit_code == 0, begun.err
    first = begun.json["plan"]["order"][0]
    other = "B" if first["part"] == "A" else "A"
    run = ("run", GOLDEN, "--virtual-time", "--no-report", "--data", data, "--study", "g")
    refused = here(*run, "--serial", other, "--operator", first["operator"])
    assert refused.exit_code == 2
    assert f"found unit {other}; unit {first['part']} is next" in refused.err
    refused = here(*run, "--serial", first["part"], "--operator", "Cem")
    assert f"found operator Cem; this step is for operator {first['operator']}" in refused.err
    quick = here(*run[:1], "rv-40e-121-quick", *run[2:], "--serial", first["part"], "--operator", first["operator"])
    assert quick.exit_code == 2
    assert "All steps of a study need the same file" in quick.err
    assert not [one for one in Path(data).iterdir() if (one / "run.json").exists()], "nothing was started"

    one = here("quality", "study", "measure", "g", "--virtual-time", "--seed", "100", "--data", data)
    assert one.exit_code == 3, one.err
    assert "step 2 of 8: put unit" in one.out
    rest = here("quality", "study", "measure", "g", "--all", "--virtual-time", "--seed", "100", "--data", data)
    assert rest.exit_code == 0, rest.err
    status = here("quality", "study", "status", "g", "--data", data, "--json").json
    runs = list(status["measured"].values())
    assert (len(runs), status["missing"], status["does_not_count"]) == (8, [], [])
    for step, (name, cell) in enumerate(zip(runs, status["plan"]["order"], strict=True), start=1):
        manifest = json.loads((Path(data) / name / "run.json").read_text("utf-8"))
        assert (manifest["serial"], manifest["operator"]) == (cell["part"], cell["operator"])
        assert f"study g, step {step} of 8: not production" in manifest["notes"]
        assert manifest["unit"]["virtual"] == status["plan"]["units"][cell["part"]]
        assert (manifest.get("retest_reason") is None) == (manifest["attempt"] == 1)
    found = here("quality", "study", "evaluate", "g", "--data", data)
    assert found.exit_code == 0, found.err
    assert "2 parts × 2 operators × 2 trials" in found.out
    assert "VIRTUAL" in found.out
    more = here("quality", "study", "measure", "g", "--virtual-time", "--data", data)
    assert more.exit_code == 2
    assert "every step is measured" in more.err
    with pytest.raises(StationError, match="no run of a virtual unit"), production(Path(data)) as view:
        view.refuse_empty(Lot(virtual=True))
