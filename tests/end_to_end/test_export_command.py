"""`lostmotion export` of a run in virtual time."""

from __future__ import annotations

import errno
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from lostmotion_command import here
from printed_numbers import alike
from run_samples import as_recorded, flip, records_of

from analysis.trace.trace_files import read_trace
from recipes import shipped_recipes
from station.cli.studies.loop_source import trace_source
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.samples.scan_record import RECORD_BYTES
from station.results.export import FORMATS, sidecar
from station.results.export_origin import fingerprint_of


def test_export_in_each_format_and_of_a_damaged_run(lostmotion, stored, tmp_path):
    scans = len(records_of(stored))
    for file_format in ("parquet", "csv", "mat", "tdms"):
        path = tmp_path / f"out.{file_format}"
        told = lostmotion("export", str(stored), "--format", file_format, "--out", str(path), "--json").json
        assert (told["scans"], told["bytes"]) == (scans, path.stat().st_size)
    assert not list(tmp_path.glob(".*.part*"))
    run = json.loads(pq.read_schema(tmp_path / "out.parquet").metadata[b"lostmotion"])
    verdict = json.loads((stored / "run.json").read_text(encoding="utf-8"))["verdict"]
    assert (run["serial"], run["state"], run["verdict"]) == ("R", "complete", verdict)
    assert [metric["id"] for metric in run["metrics"]] == ["torque_ratio_slope"]
    assert json.loads((tmp_path / "out.csv.json").read_text(encoding="utf-8"))["run"] == run

    refused = lostmotion("export", str(stored), "--format", "xlsx")
    assert refused.exit_code == 2
    assert "parquet, csv, mat, tdms" in refused.err
    as_recorded(RunRecord(stored))
    flip(RunRecord(stored), 100 * RECORD_BYTES + 60, 0xFF)
    damaged = lostmotion("export", str(stored), "--out", str(tmp_path / "no.parquet"))
    assert damaged.exit_code == 2
    assert "CRC" in damaged.err
    assert not (tmp_path / "no.parquet").exists()


def test_a_german_spreadsheet_has_the_same_numbers(lostmotion, stored, tmp_path):
    for locale in ("en", "de"):
        asked = ("--format", "csv", "--locale", locale, "--out", str(tmp_path / f"{locale}.csv"))
        assert lostmotion("export", str(stored), *asked).exit_code == 0
    english, german = (read_trace(tmp_path / f"{locale}.csv") for locale in ("en", "de"))
    assert ";" in (tmp_path / "de.csv").read_text(encoding="utf-8").splitlines()[0]
    for name in ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "segment"):
        assert np.array_equal(getattr(english, name), getattr(german, name)), name
    assert german.segments == english.segments
    assert "decimal commas" in german.reading
    for wrong in (("--locale", "xx", "--format", "csv"), ("--locale", "de")):
        refused = lostmotion("export", str(stored), *wrong)
        assert refused.exit_code == 2
        assert "--locale" in refused.err


SAME = ("verdict", "reasons", "decision", "metrics", "gates", "stages")
"""What `analyze` must give of an exported run as the run has it, to the last digit."""


@pytest.mark.parametrize("file_format", ["csv", "parquet", "tdms"])
def test_an_exported_run_is_evaluated_as_the_run_is(lostmotion, quick_run, tmp_path, file_format):
    record, path = quick_run.record, tmp_path / f"quick.{file_format}"
    assert lostmotion("export", str(record), "--format", file_format, "--out", str(path)).exit_code == 0
    how = ("--recipe", str(record / "recipe.yaml"), "--bench", str(record / "bench.yaml"))
    ran = lostmotion("analyze", str(path), *how, "--json")
    own = json.loads((record / "result.json").read_text(encoding="utf-8"))
    assert ran.exit_code == 0
    assert {key: ran.json[key] for key in SAME} == {key: own[key] for key in SAME}
    assert (ran.json["run"], ran.json["state"], ran.json["serial"]) == (None, "analyzed", "SN 1")
    origin = ran.json["origin"]
    assert (origin["run"], origin["verdict"], origin["changed"]) == (record.name, "PASS", False)
    assert (ran.json["reevaluated"], ran.json["original_verdict"]) == (False, "PASS")
    shown = lostmotion("analyze", str(path), *how).out
    assert "VIRTUAL TIME" in shown
    assert f"exported from run {record.name} of unit SN 1" in " ".join(shown.split())


OTHER_RECIPES = sorted(set(shipped_recipes()) - {"rv-40e-121-quick"})
STEPPED = "rv-40e-121-measurement"


@pytest.mark.parametrize("name", OTHER_RECIPES)
def test_whatever_the_recipe_the_export_of_its_run_is_evaluated_as_the_run_is(lostmotion, shipped_run, tmp_path, name):
    """What a recipe loads by, ramps, steps or a speed, must be in the file: gates and metrics go by it."""
    record, path = shipped_run(name).record, tmp_path / "run.parquet"
    assert lostmotion("export", str(record), "--out", str(path)).exit_code == 0
    how = ("--recipe", str(record / "recipe.yaml"), "--bench", str(record / "bench.yaml"))
    ran = lostmotion("analyze", str(path), *how, "--json")
    own = json.loads((record / "result.json").read_text(encoding="utf-8"))
    assert {key: ran.json[key] for key in SAME} == {key: own[key] for key in SAME}
    assert (ran.json["verdict"], ran.json["origin"]["changed"], ran.json["reevaluated"]) == ("PASS", False, False)


def test_the_steps_of_a_branch_are_numbered_and_belong_to_the_trace(lostmotion, shipped_run, tmp_path):
    """Eleven steps to the peak: 22 ramps and 21 holds from peak to peak; a branch in one ramp has no such number."""
    record, path = shipped_run(STEPPED).record, tmp_path / "run.parquet"
    assert lostmotion("export", str(record), "--out", str(path)).exit_code == 0
    names = {text for text in pq.read_table(path)["segment"].to_pylist() if text.startswith("measure")}
    stepped = {text for text in names if len(text.split()) == 4}
    assert {int(text.split()[3]) for text in stepped} == set(range(1, 44))
    assert names - stepped == {f"measure {sign}1 {cycle}" for sign in "+-" for cycle in (1, 2, 3)}


def test_a_file_that_has_lost_its_steps_is_told_with_the_way_out(lostmotion, shipped_run, quarter, tmp_path):
    """As a version before steps were numbered wrote it: the same trace, by its own account, and another verdict."""
    record, path = shipped_run(STEPPED).record, tmp_path / "run.parquet"
    assert lostmotion("export", str(record), "--out", str(path)).exit_code == 0
    table = pq.read_table(path)
    place = table.schema.get_field_index("segment")
    texts = [" ".join(text.split()[:3]) for text in table["segment"].to_pylist()]
    run = json.loads(table.schema.metadata[b"lostmotion"])
    bare = table.set_column(place, "segment", [texts])
    how = ("--recipe", quarter(STEPPED), "--bench", "virtual", "--json")
    pq.write_table(bare, path)
    assert lostmotion("analyze", str(path), *how).json["origin"]["changed"]
    run["trace"] = fingerprint_of(read_trace(path))
    pq.write_table(bare.replace_schema_metadata({b"lostmotion": json.dumps(run)}), path)
    ran = lostmotion("analyze", str(path), *how)
    assert (ran.exit_code, ran.json["verdict"], ran.json["origin"]["changed"]) == (3, "NOT DECIDABLE", False)
    assert "re-evaluated it is NOT DECIDABLE: both by lostmotion" in ran.json["reasons"][0]
    assert f"Export run {record.name} again" in ran.json["reasons"][0]
    run["software"]["version"] = "0.0.9"
    pq.write_table(bare.replace_schema_metadata({b"lostmotion": json.dumps(run)}), path)
    reason = lostmotion("analyze", str(path), *how).json["reasons"][0]
    assert "by lostmotion 0.0.9 then, and by" in reason


def quick_csv(lostmotion, quick_run, folder):
    path = folder / "quick.csv"
    lostmotion("export", str(quick_run.record), "--format", "csv", "--out", str(path))
    return path


def test_an_exported_trace_that_was_changed_is_not_told_as_that_of_the_run(lostmotion, quick_run, quarter, tmp_path):
    path = quick_csv(lostmotion, quick_run, tmp_path)
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    place = head.split(",").index("angle_in_rad")
    bent = [row.split(",") for row in rows]
    for cells in bent:
        cells[place] = repr(1.001 * float(cells[place]))
    path.write_text("\n".join([head, *map(",".join, bent), ""]), encoding="utf-8")
    how = ("--recipe", quarter("rv-40e-121-quick"), "--bench", "virtual")
    ran = lostmotion("analyze", str(path), *how, "--json")
    assert (ran.json["origin"]["changed"], ran.json["reevaluated"], ran.json["serial"]) == (True, True, None)
    assert "CHANGED SINCE" in ran.json["notes"][0]
    assert "RE-EVALUATED" in lostmotion("analyze", str(path), *how).out


def test_an_export_is_judged_by_what_it_says_of_its_run(lostmotion, quick_run, quarter, tmp_path):
    path = quick_csv(lostmotion, quick_run, tmp_path)
    beside = tmp_path / "quick.csv.json"
    said = json.loads(beside.read_text(encoding="utf-8"))
    how = ("--recipe", quarter("rv-40e-121-quick"), "--bench", "virtual", "--json")

    def analyzed(**changes):
        beside.write_text(json.dumps(said | {"run": said["run"] | changes}), encoding="utf-8")
        return lostmotion("analyze", str(path), *how)

    for changes, reason in (
        ({"altered": ["timing.json: other bytes"]}, "exported from an altered record: timing.json"),
        ({"recorded": said["run"]["recorded"] | {"missed": 30000}, "verdict": "NOT DECIDABLE"}, "missed_periods"),
        ({"verdict": "FAIL"}, "the run's own verdict is FAIL, re-evaluated it is PASS"),
    ):
        ran = analyzed(**changes)
        assert (ran.exit_code, ran.json["verdict"]) == (3, "NOT DECIDABLE"), changes
        assert reason in ran.json["reasons"][0]
    for changes, words in (
        ({"unit": "RV-6E"}, "measured a RV-6E"),
        ({"trace": None, "recorded": {"missed": "many"}}, "is damaged"),
        ({"started": 7}, "is damaged"),
        ({"state": "fault"}, "which ended as fault: it has no complete trace to evaluate"),
        ({"recorded": said["run"]["recorded"] | {"missed": "0"}}, "is damaged"),
        ({"recorded": said["run"]["recorded"] | {"missed": -1}}, "missed: found -1"),
    ):
        ran = analyzed(**changes)
        assert ran.exit_code == 2, changes
        assert words in ran.err
    older = {key: value for key, value in said["run"].items() if key != "trace"}
    beside.write_text(json.dumps({"run": older}), encoding="utf-8")
    assert "Export the run again" in lostmotion("analyze", str(path), *how).err
    beside.unlink()
    alone = lostmotion("analyze", str(path), *how).json
    assert (alone["serial"], alone["verdict"], "origin" in alone) == (None, "PASS", False)
    stored = json.loads((quick_run.record / "result.json").read_text(encoding="utf-8"))
    assert alike(alone["metrics"], stored["metrics"])


def test_a_model_of_an_exported_run_is_that_of_the_unit_as_long_as_the_trace_is(lostmotion, quick_run, tmp_path):
    path = quick_csv(lostmotion, quick_run, tmp_path)
    found = trace_source(str(path), None, tmp_path)
    assert (found.serial, found.virtual) == ("SN 1", True)
    beside = tmp_path / "quick.csv.json"
    beside.write_text(beside.read_text(encoding="utf-8").replace('"trace": "', '"trace": "0'), encoding="utf-8")
    assert trace_source(str(path), None, tmp_path).serial == ""
    said = json.loads(beside.read_text(encoding="utf-8"))
    beside.write_text(json.dumps({"run": said["run"] | {"altered": ["run.json: other"]}}), encoding="utf-8")
    with pytest.raises(StationError, match=r"altered record: run\.json: other; the file was not evaluated"):
        trace_source(str(path), None, tmp_path)
    beside.write_text(json.dumps({"run": said["run"] | {"state": "stopped"}}), encoding="utf-8")
    with pytest.raises(StationError, match="which ended as stopped: it has no complete trace"):
        trace_source(str(path), None, tmp_path)


def test_an_export_of_a_run_whose_bench_cannot_be_read_says_no_trace(lostmotion, stored, tmp_path):
    (stored / "bench.yaml").write_text("bench: [", encoding="utf-8")
    path = tmp_path / "blind.parquet"
    assert lostmotion("export", str(stored), "--out", str(path)).exit_code == 3
    assert "segment" not in pq.read_schema(path).names
    refused = lostmotion("analyze", str(path), "--recipe", "rv-40e-121-quick", "--bench", "virtual")
    assert refused.exit_code == 2
    assert "has no trace" in refused.err


@pytest.mark.parametrize("out", ["/proc/no/such/folder.parquet", "{file}/x.parquet", "{file}/x.csv"])
def test_a_place_that_cannot_be_written_is_told(lostmotion, stored, tmp_path, out):
    """Below a file nothing can be taken away either, as on a read-only disk."""
    (tmp_path / "file").touch()
    place = out.format(file=tmp_path / "file")
    told = lostmotion("export", str(stored), "--format", place.rpartition(".")[2], "--out", place)
    assert told.exit_code == 2
    assert "cannot be written" in told.err
    assert "Choose another place with --out" in told.err


@pytest.mark.parametrize("name", ["samples.bin", "profiles/new.csv", "../chain.jsonl"])
def test_no_record_is_written_over(lostmotion, stored, name):
    place = stored / name
    before = place.read_bytes() if place.exists() else None
    for out in (place, stored / ".." / stored.name / name):
        refused = lostmotion("export", str(stored), "--format", "csv", "--out", str(out))
        assert refused.exit_code == 2
        assert "Choose another" in refused.err
    assert (place.read_bytes() if place.exists() else None) == before
    assert "altered" not in lostmotion("show", str(stored), "--json").json


@pytest.mark.parametrize("name", [".", "../{run}", "profiles/..", "../../link"])
def test_a_run_has_its_name_however_its_folder_is_written(stored, tmp_path, monkeypatch, name):
    (tmp_path / "link").symlink_to(stored)
    monkeypatch.chdir(stored)
    run = Store(tmp_path / "nothing").find(name.format(run=stored.name))
    assert (run.id, run.folder) == (stored.name, stored.resolve())


def test_a_run_is_exported_from_inside_its_folder_to_another_place(stored, tmp_path):
    (tmp_path / "out").mkdir()
    before = sorted(path.name for path in stored.iterdir())
    for out, code, told in (
        ([], 2, f"--out {stored.name}.parquet: lies in the folder of run {stored.name}"),
        (["--out", str(tmp_path / "out")], 0, str(tmp_path / "out" / f"{stored.name}.parquet")),
    ):
        done = here("export", ".", *out, cwd=stored)
        assert done.exit_code == code
        assert told in done.out + done.err
    assert sorted(path.name for path in stored.iterdir()) == before


def test_nothing_is_left_of_an_export_that_filled_the_disk(lostmotion, stored, tmp_path, monkeypatch):
    """The disk is full when the file beside the CSV is written, which is the smaller one and comes last."""

    def full(path, _columns, _run):
        path.write_bytes(b"x")
        sidecar(path).write_bytes(b"{")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setitem(FORMATS, "csv", full)
    (tmp_path / "out").mkdir()
    refused = lostmotion("export", str(stored), "--format", "csv", "--out", str(tmp_path / "out" / "a.csv"))
    assert refused.exit_code == 2
    assert "No space left on device. Choose another place with --out" in refused.err
    assert list((tmp_path / "out").iterdir()) == []


def test_a_name_with_brackets_is_a_name(lostmotion, stored, tmp_path):
    out = tmp_path / "run [a].csv"
    assert lostmotion("export", str(stored), "--format", "csv", "--out", str(out)).exit_code == 0
    assert sorted(path.name for path in tmp_path.glob("run*csv*")) == ["run [a].csv", "run [a].csv.json"]
    assert not list(tmp_path.glob(".*.part*"))


def test_an_altered_record_is_exported_as_one_that_decides_nothing(lostmotion, stored, tmp_path):
    timing = (stored / "timing.json").read_text(encoding="utf-8")
    (stored / "timing.json").write_text(timing.replace('"missed": 0', '"missed": 00'), encoding="utf-8")
    path = tmp_path / "altered.parquet"
    told = lostmotion("export", str(stored), "--out", str(path))
    assert told.exit_code == 3
    assert told.out.splitlines()[0].startswith("RECORD ALTERED")
    run = json.loads(pq.read_schema(path).metadata[b"lostmotion"])
    assert run["altered"][0].startswith("timing.json")
    assert run["verdict"] == "NOT DECIDABLE"
    assert run["reasons"][0].startswith("record altered: timing.json")
    again = lostmotion("export", str(stored), "--out", str(path), "--json")
    assert (again.exit_code, again.json["altered"]) == (3, run["altered"])
