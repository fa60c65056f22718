"""`analyze` of stored runs: by the run's own recipe, by another one, and of runs that have nothing to evaluate."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from lostmotion_command import ROOT, here
from run_copies import alone, begun_anew

from recipes import RecipeError, Selection, load_recipe
from station.atomic_file import as_json
from station.cli.runs.analyze import reevaluation_heading
from station.cli.runs.evaluate_anew import elsewhere, reevaluate
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.seal import seal
from station.reports.export_of_run import export_run

RECIPE = ROOT / "recipes" / "rv-40e-121-quick.yaml"
REVISION = load_recipe(str(RECIPE)).recipe.revision


@pytest.fixture
def failed(worn_run: Any, tmp_path: Path) -> RunRecord:
    worn_run.copy(tmp_path / "data")
    return Store(tmp_path / "data").find("last")


def changed_recipe(folder: Path, *changes: tuple[str, str]) -> str:
    text = RECIPE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "other.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_the_own_recipe_gives_the_own_verdict(failed: RunRecord, quarter: Callable[[str], str]) -> None:
    result = reevaluate(failed, None, None)
    assert (result.verdict, result.original_verdict, result.reevaluated) == ("FAIL", "FAIL", False)
    assert reevaluation_heading(result) == ""
    same_bytes = reevaluate(failed, quarter("rv-40e-121-quick"), None)
    assert not same_bytes.reevaluated


def test_a_preset_is_never_the_runs_own_verdict(failed: RunRecord) -> None:
    result = reevaluate(failed, None, None, Selection("nabtesco"))
    assert (result.preset, result.reevaluated, result.original_verdict) == ("nabtesco", True, "FAIL")
    assert [metric.id for metric in result.metrics] == ["backlash_width_zero", "lost_motion", "stiffness_50_100"]
    assert "by the definitions of preset nabtesco. The run's own verdict was FAIL" in reevaluation_heading(result)
    assert RunRecord(failed.folder).manifest().verdict == "FAIL"


def test_another_recipe_is_never_the_runs_own_verdict(failed: RunRecord, tmp_path: Path) -> None:
    generous = changed_recipe(tmp_path, ("max: 1 arcmin", "max: 9 arcmin"))
    done = here("analyze", str(failed.folder), "--recipe", generous, "--json")
    result = done.json
    assert (done.exit_code, result["verdict"]) == (0, "PASS")
    assert (result["reevaluated"], result["original_verdict"]) == (True, "FAIL")
    shown = here("analyze", str(failed.folder), "--recipe", generous).out
    sha = result["recipe"]["sha256"][:8]
    heading = f"RE-EVALUATED with recipe rv-40e-121-quick revision {REVISION} ({sha}). The run's own verdict was FAIL"
    assert shown.startswith(heading)
    assert shown.rstrip().endswith(heading)


def test_another_bench_is_a_reevaluation_as_well(failed: RunRecord, tmp_path: Path) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_bytes((failed.folder / "bench.yaml").read_bytes() + b"# another\n")
    result = reevaluate(failed, None, str(bench))
    assert result.reevaluated
    assert "on bench virtual rev 1" in reevaluation_heading(result)


def test_a_recipe_for_another_model_is_refused(failed: RunRecord, tmp_path: Path) -> None:
    other = changed_recipe(tmp_path, ("model: RV-40E-121", "model: RV-20E-121"))
    done = here("analyze", str(failed.folder), "--recipe", other)
    assert done.exit_code == 2
    assert "found RV-20E-121" in done.err
    assert "measured a RV-40E-121" in done.err


def test_a_recipe_with_another_ratio_is_refused(failed: RunRecord, tmp_path: Path) -> None:
    """A larger ratio makes the play of the same unit smaller: 1.17 arcmin by 121 are 0.94 by 151."""
    with pytest.raises(StationError, match=r"found 151; run .* with ratio 121\. One model has one ratio"):
        reevaluate(failed, changed_recipe(tmp_path, ("ratio: 121", "ratio: 151")), None)


def test_an_export_is_held_to_the_ratio_and_the_shaft_of_its_run(failed: RunRecord, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    export_run(failed, "parquet", path)
    ratio = changed_recipe(tmp_path, ("ratio: 121", "ratio: 151"))
    with pytest.raises(StationError, match=r"ratio: found 151; run .*run\.parquet.* with ratio 121"):
        elsewhere(path, ratio, "virtual")
    with pytest.raises(StationError, match="the input shaft was loaded"):
        elsewhere(path, "rv-40e-121-output", None)
    table = pq.read_table(path)
    said = json.loads(table.schema.metadata[b"lostmotion"])
    older = json.dumps({key: value for key, value in said.items() if key not in ("ratio", "loading")})
    pq.write_table(table.replace_schema_metadata({"lostmotion": older}), path)
    assert elsewhere(path, ratio, "virtual").reevaluated


def test_a_recipe_that_judges_one_side_of_a_metric_is_told_so(failed: RunRecord, tmp_path: Path) -> None:
    one = changed_recipe(tmp_path, ("{id: spring_constant,", '{id: spring_constant, side: "-",'))
    shown = here("analyze", str(failed.folder), "--recipe", one).out
    assert "judged on one side only: spring_constant side −\n" in shown
    assert "judged on one side" not in here("analyze", str(failed.folder)).out


CURVE = """  curve:
    {id: old, made: 2019-01-01, due: 2020-01-01, angles: both,
     points: [{torque: -500 N·m, deflection: -0.05 arcmin},
              {torque: 500 N·m, deflection: 0.05 arcmin}]}
"""


def test_a_blank_test_out_of_date_on_the_day_of_the_run_decides_nothing(failed: RunRecord, tmp_path: Path) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(
        (failed.folder / "bench.yaml").read_text("utf-8").replace("calibrations:", CURVE + "calibrations:")
    )
    result = reevaluate(failed, None, str(bench))
    assert result.verdict == "NOT DECIDABLE"
    assert "blank test 'old' of bench 'virtual', which was due on 2020-01-01" in result.reasons[0]


def test_a_bench_that_loads_the_other_side_is_refused(failed: RunRecord) -> None:
    with pytest.raises(RecipeError, match="drives the output shaft"):
        reevaluate(failed, None, "virtual-output")


def test_a_recipe_that_loads_the_other_side_is_refused(failed: RunRecord) -> None:
    with pytest.raises(StationError, match="the input shaft was loaded"):
        reevaluate(failed, "rv-40e-121-output", None)


@pytest.mark.parametrize("name", ["recipe.yaml", "bench.yaml", "calibration.json", "result.json"])
def test_an_altered_record_is_not_evaluated(failed: RunRecord, name: str) -> None:
    with (failed.folder / name).open("ab") as file:
        file.write(b"\n")
    done = here("analyze", str(failed.folder), "--json")
    result = done.json
    assert (done.exit_code, result["verdict"], result["metrics"]) == (3, "NOT DECIDABLE", [])
    assert result["reasons"][0].startswith(f"record altered: {name}")


def test_a_verdict_that_the_record_does_not_bear_out_decides_nothing(failed: RunRecord) -> None:
    """As by another version of the software: every checksum is right, the evaluation finds something else."""
    result = failed.read_json("result.json")
    for metric in result["metrics"]:
        metric["verdict"] = metric["verdict"] and "PASS"
    failed.write_json("result.json", result | {"verdict": "PASS"})
    failed = begun_anew(alone(failed))
    seal(failed, verdict="PASS")
    found = reevaluate(failed, None, None)
    assert (found.verdict, found.original_verdict) == ("NOT DECIDABLE", "PASS")
    assert "re-evaluated it is FAIL" in found.reasons[0]


@pytest.mark.parametrize(("state", "code"), [("fault", 4), ("stopped", 4), ("interrupted", 3)])
def test_a_run_without_an_end_is_told_in_a_sentence(failed: RunRecord, state: str, code: int) -> None:
    manifest = {key: value for key, value in failed.read_json("run.json").items() if key != "files"}
    failed.write_json("run.json", manifest)
    failed = begun_anew(alone(failed))
    failed.write_bytes(
        "result.json",
        as_json(failed.read_json("result.json") | {"state": state, "verdict": "NOT DECIDABLE", "metrics": []}),
    )
    if state == "interrupted":
        failed.update(state=state, verdict=None)
    else:
        seal(failed, state=state, verdict="NOT DECIDABLE")
    done = here("analyze", failed.id, "--data", str(failed.folder.parent))
    assert done.exit_code == code
    assert state in done.err
    assert "no complete trace" in done.err


def test_a_folder_that_is_no_run_is_called_so(tmp_path: Path) -> None:
    done = here("analyze", str(tmp_path))
    assert done.exit_code == 2
    assert "this folder is not a run" in done.err


@pytest.mark.parametrize("what", ["nothing", "file"])
def test_list_of_no_folder_is_an_error(tmp_path: Path, what: str) -> None:
    (tmp_path / "file").write_text("x")
    done = here("list", "--data", str(tmp_path / what))
    assert done.exit_code == 2
    assert str(tmp_path / what) in done.err
    assert done.out == ""


@pytest.mark.parametrize("name", ["", "  "])
def test_an_empty_name_finds_no_run(failed: RunRecord, name: str) -> None:
    with pytest.raises(StationError, match="RUN is empty"):
        Store(failed.folder.parent).find(name)
