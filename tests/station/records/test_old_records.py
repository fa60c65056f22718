"""Records of earlier formats, and of versions with other channels: they open with their verdicts, now and for ever."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from lostmotion_command import ROOT, here
from old_runs import CONCLUDED, NAMES, run_of, unpack, with_channels

from definitions.image import IMAGE_FIELDS
from recipes import RecipeError, load_bench
from station.bench.files import load_named_bench
from station.bench.request import as_written, load_job, stored_job, stored_job_on
from station.documents.reading import of_plain
from station.errors import RecordError
from station.records.program_file import ProgramEntries, StoredProgram
from station.records.run_record import BENCH_COPY, RECIPE_COPY, RunRecord
from station.records.samples.layout import CURRENT, Channel, Layout, layout_in
from station.records.samples.packed import column_name
from station.records.samples.samples import read_samples
from station.records.samples.table import AbsentChannelError
from station.version import PACKAGES

STATES = {"passed": "complete", "worn": "complete", "tripped": "fault", "stopped": "stopped", "torn": "interrupted"}
VERDICTS = {"passed": "PASS", "worn": "FAIL"}
COMPLETE = ("passed", "worn")
BY_THE_MEAN_CURVE = ("spring_constant", "windup")
"""Metrics that read the curve fitted over the whole branch: it goes into the stretch after a reversal gradually now."""
MOVED_U = 0.5
"""What that may move them by, in the expanded uncertainties that the record gives them."""

UNKNOWN = Channel("image", 0, "vibration_m_s2", "d", "m/s²", "acceleration of the housing")


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The runs of format 1, to be looked at only."""
    return unpack(tmp_path_factory.mktemp("format-1") / "runs")


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """The runs of format 1, to be changed."""
    return unpack(tmp_path / "runs")


def values(metrics: list[dict[str, Any]]) -> dict[tuple[Any, ...], float]:
    return {(one["id"], one["branch"], one["side"], one["torque_nm"]): one["value"] for one in metrics}


def same_values(run: RunRecord, found: list[dict[str, Any]]) -> None:
    stored = run.read_json("result.json")["metrics"]
    of_curve = {one["id"]: one["uncertainty"] for one in stored if one["id"] in BY_THE_MEAN_CURVE}
    now, then = values(found), values(stored)
    assert now.keys() == then.keys()
    for key, value in now.items():
        most = MOVED_U * of_curve[key[0]] if key[0] in of_curve else 1e-9 * abs(then[key])
        assert abs(value - then[key]) <= most, key


@pytest.mark.parametrize("name", CONCLUDED)
def test_an_old_run_opens_with_its_verdict(kept: Path, name: str) -> None:
    run = run_of(kept, name)
    stored = run.read_json("result.json")
    shown = here("show", str(run.folder), "--json").json
    assert (shown["state"], shown["verdict"]) == (STATES[name], VERDICTS.get(name, "NOT DECIDABLE"))
    assert shown["metrics"] == stored["metrics"]
    assert shown["reasons"] == stored["reasons"]
    (row,) = [row for row in here("list", "--data", str(kept), "--json").json if row["run"] == run.id]
    assert (row["state"], row["verdict"]) == (shown["state"], shown["verdict"])
    assert row["records"] == stored["timing"]["scans"]


@pytest.mark.parametrize("name", NAMES)
def test_an_old_run_replays_or_says_which_version_decided_otherwise(kept: Path, name: str) -> None:
    run = run_of(kept, name)
    ran = here("replay", str(run.folder), "--json")
    decisions = ran.json["decisions"]
    assert (decisions["recorded"], decisions["recorded_by"], ran.json["damage"]) == (1, "0.1.0", "")
    if decisions["now"] == 1:
        assert (ran.exit_code, ran.json["identical_scans"]) == (0, run.records())
        return
    # Decisions have a new version: whether this run is one of those that differ, it is told.
    assert ran.exit_code == (0 if ran.json["difference"] is None else 1)
    told = here("replay", str(run.folder)).out
    assert "Recorded by version 1 of the controller's decisions (lostmotion 0.1.0), replayed by version" in told


@pytest.mark.parametrize("name", COMPLETE)
def test_an_old_run_is_evaluated_anew(kept: Path, name: str) -> None:
    run = run_of(kept, name)
    ran = here("analyze", str(run.folder), "--json")
    assert ran.json["verdict"] == VERDICTS[name]
    same_values(run, ran.json["metrics"])


@pytest.mark.parametrize("name", NAMES)
def test_an_old_run_is_exported_as_it_was_recorded(kept: Path, tmp_path: Path, name: str) -> None:
    run = run_of(kept, name)
    path = tmp_path / "out.parquet"
    assert here("export", str(run.folder), "--out", str(path)).exit_code == 0
    table, exported = read_samples(run), pq.read_table(path)
    for channel in run.layout().channels[:-1]:
        part = table.rows if channel.group == "record" else table.rows[channel.group]
        column = column_name(channel)
        column = f"image_{column}" if f"image_{column}" in exported.column_names else column
        assert exported[column].to_numpy().tobytes() == np.ascontiguousarray(part[channel.name]).tobytes()


@pytest.mark.parametrize("name", CONCLUDED)
def test_an_old_run_is_reported(kept: Path, tmp_path: Path, name: str) -> None:
    assert here("report", str(run_of(kept, name).folder), "--out", str(tmp_path)).exit_code == 0
    assert (tmp_path / "report.html").stat().st_size > 0
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize("name", COMPLETE)
def test_a_channel_that_only_the_record_knows_is_kept_and_exported(data: Path, tmp_path: Path, name: str) -> None:
    run = run_of(data, name)
    with_channels(run, more=(UNKNOWN,), less=frozenset({"sample_time_us", "ambient_temp_c"}))
    assert here("show", str(run.folder), "--json").json["verdict"] == VERDICTS[name]
    assert here("replay", str(run.folder), "--json").json["damage"] == ""
    ran = here("analyze", str(run.folder), "--json")
    assert ran.json["verdict"] == VERDICTS[name]
    same_values(run, ran.json["metrics"])
    path = tmp_path / "out.parquet"
    assert here("export", str(run.folder), "--out", str(path)).exit_code == 0
    exported = pq.read_table(path)
    assert exported[UNKNOWN.name].to_pylist() == [7.0 + n for n in range(run.records())]
    assert exported.schema.field(UNKNOWN.name).metadata[b"unit"].decode() == UNKNOWN.unit
    assert not {"sample_time_us", "ambient_temp_c"} & set(exported.column_names)
    page = tmp_path / "report"
    assert here("report", str(run.folder), "--out", str(page)).exit_code == 0
    assert "not recorded" in (page / "report.html").read_text(encoding="utf-8")


def test_a_channel_that_the_record_lacks_is_absent_and_never_zero(data: Path) -> None:
    run = run_of(data, "passed")
    with_channels(run, less=frozenset({"housing_temp_c"}))
    table = read_samples(run)
    assert table["image"].get("housing_temp_c") is None
    with pytest.raises(AbsentChannelError, match=r"image\.housing_temp_c"):
        _ = table["image"]["housing_temp_c"]
    with pytest.raises(AbsentChannelError, match=r"image\.housing_temp_c"):
        _ = table[-1]["image"]["housing_temp_c"]
    assert here("show", str(run.folder), "--json").json["verdict"] == "PASS"
    # The controller looks at it, so nothing can be said of what it would have ordered.
    replayed = here("replay", str(run.folder))
    assert replayed.exit_code == 2
    assert "image.housing_temp_c" in replayed.err
    # The loop does not need it; what is judged by it is not judged, and does not pass.
    ran = here("analyze", str(run.folder), "--json").json
    gates = {gate["id"]: gate["passed"] for gate in ran["gates"]}
    assert [gates[name] for name in gates if name.startswith("temperature")] == [None] * 3
    same_values(run, ran["metrics"])


def test_a_loop_cannot_be_evaluated_without_its_torque(data: Path) -> None:
    run = run_of(data, "passed")
    with_channels(run, less=frozenset({"torque_out_nm"}))
    ran = here("analyze", str(run.folder))
    assert ran.exit_code == 2
    assert "image.torque_out_nm" in ran.err


def scratch_copy(folder: Path) -> Path:
    """Copy the program and give its process image another channel, in the middle of the record."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package)
    path = folder / "definitions" / "image.py"
    rows = re.compile(r'^    (?:torque_in_nm: |Field\("torque_in_nm", ).*\n', re.MULTILINE)
    text, found = rows.subn(lambda row: row[0].replace("torque_in_nm", UNKNOWN.name) + row[0], path.read_text("utf-8"))
    assert found, "every row of the inputs that defines torque_in_nm has one before it"
    path.write_text(text, encoding="utf-8")
    return folder


ASK = """
import json, sys
from contextlib import redirect_stdout
from io import StringIO
sys.path.insert(0, sys.argv[1])
import definitions.image
assert definitions.image.__file__.startswith(sys.argv[1])
assert "vibration_m_s2" in definitions.image.Image._fields
assert "vibration_m_s2" in [field.name for field in definitions.image.IMAGE_FIELDS]
from station import cli
answers = []
for words in json.loads(sys.argv[2]):
    sys.argv = ["lostmotion", *words]
    with redirect_stdout(StringIO()) as out:
        try:
            cli.main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
    answers.append([code, out.getvalue()])
print(json.dumps(answers))
"""


def test_code_with_a_channel_more_reads_what_was_recorded_before(kept: Path, golden_run: Any, tmp_path: Path) -> None:
    """Raw runs of format 1 and a packed one of today, read by a copy of the program with another process image."""
    folder = scratch_copy(tmp_path / "copy")
    old, packed = run_of(kept, "passed"), RunRecord(golden_run.copy(tmp_path / "runs"))
    assert packed.is_packed()
    asked = [[word, str(run.folder), "--json"] for run in (old, packed) for word in ("show", "replay", "analyze")]
    asked += [["export", str(run.folder), "--out", str(tmp_path / f"{run.id}.parquet")] for run in (old, packed)]
    words = [sys.executable, "-c", ASK, str(folder), json.dumps(asked)]
    done = subprocess.run(words, cwd=tmp_path, text=True, capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    answers = json.loads(done.stdout)
    codes = [code for code, _ in answers]
    shown, replayed, analysed = (json.loads(text) for _, text in answers[:3])
    assert (shown["verdict"], analysed["verdict"]) == ("PASS", "PASS")
    assert replayed["damage"] == ""
    if replayed["decisions"]["now"] == 1:
        assert replayed["identical_scans"] == old.records()
    assert json.loads(answers[3][1])["verdict"] == golden_run.ran.json["verdict"]
    assert json.loads(answers[4][1])["identical_scans"] == packed.records()
    assert codes[6:] == [0, 0]
    for run in (old, packed):
        assert "vibration_m_s2" not in pq.read_schema(tmp_path / f"{run.id}.parquet").names


def test_a_deserted_old_run_is_concluded_by_its_own_layout(data: Path) -> None:
    from station.run.way_back.recover import recover  # noqa: PLC0415 - brings the analysis

    run = run_of(data, "deserted")
    content = run.samples.read_bytes()
    recover(run)
    assert run.manifest().state == "interrupted"
    assert (run.is_packed(), run.samples.read_bytes()) == (False, content)
    assert here("show", str(run.folder), "--json").json["verdict"] == "NOT DECIDABLE"


GOOD = CURRENT.as_json()
DAMAGED: dict[str, tuple[dict[str, Any], str]] = {
    "newer format": ({"format": 99}, "format: found 99"),
    "no size": ({"record_bytes": 0}, "record_bytes: found 0"),
    "other size": ({"record_bytes": 243}, "record_bytes: found 243"),
    "big endian": ({"byte_order": "big"}, "byte_order: found 'big'"),
    "no channels": ({"fields": []}, "record_bytes"),
    "no list": ({"fields": 5}, "fields"),
    "no check": ({"fields": GOOD["fields"][:-1], "record_bytes": CURRENT.body_bytes}, "crc32"),
    "twice": ({"fields": [*GOOD["fields"][:1], *GOOD["fields"]]}, "overlaps"),
    "another format": ({"fields": [GOOD["fields"][0] | {"format": "x"}, *GOOD["fields"][1:]]}, "fields[0]"),
    "another group": ({"fields": [GOOD["fields"][0] | {"group": "x"}, *GOOD["fields"][1:]]}, "fields[0]"),
    "no offset": ({"fields": [GOOD["fields"][0] | {"offset": None}, *GOOD["fields"][1:]]}, "offset"),
    "names of what": ({"fields": [GOOD["fields"][0] | {"values": 7}, *GOOD["fields"][1:]]}, "names"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_description_that_cannot_be_obeyed_is_refused_with_its_place(tmp_path: Path, name: str) -> None:
    change, told = DAMAGED[name]
    with pytest.raises(RecordError, match=r"samples\.json") as caught:
        layout_in(GOOD | change, tmp_path / "samples.json")
    assert told in str(caught.value)


def test_a_description_reads_back_as_the_layout_that_it_describes() -> None:
    assert layout_in(json.loads(json.dumps(GOOD)), Path("samples.json")) == CURRENT
    assert [one.name for one in CURRENT.group("image")] == [field.name for field in IMAGE_FIELDS]
    gap = Layout((*CURRENT.channels[:2], CURRENT.channels[-1]._replace(offset=40)), 44)
    assert (gap.struct.size, gap.dtype.itemsize, gap.body_bytes) == (44, 44, 40)


def test_a_program_says_what_is_missing_in_it() -> None:
    place = Path("program.json")
    program = StoredProgram(of_plain(ProgramEntries, {"period_s": 0.001}, place), place)
    assert (program.period_s, program.loading_input) == (0.001, True)
    with pytest.raises(RecordError, match="release_torque_nm"):
        _ = program.release_torque_nm
    with pytest.raises(RecordError, match="segments"):
        _ = program.segments
    with pytest.raises(RecordError, match=r"segments\[0\].role: is missing.*direction: is missing.*cycle: is missing"):
        of_plain(ProgramEntries, {"segments": [{"index": 0}]}, place)


def test_copies_with_an_empty_option_open_and_no_run_is_begun_by_such_a_recipe(quick_run: Any, tmp_path: Path) -> None:
    run = RunRecord(quick_run.copy(tmp_path / "runs"))
    for name, section, option in ((RECIPE_COPY, "decision", "guard_factor"), (BENCH_COPY, "bench", "public_key")):
        path = run.folder / name
        text, found = re.subn(rf"(?m)^{section}:$", f"{section}:\n  {option}:", path.read_text(encoding="utf-8"))
        assert found == 1
        path.write_text(text, encoding="utf-8")
    recipe, bench = (str(run.folder / name) for name in (RECIPE_COPY, BENCH_COPY))
    assert stored_job(run).recipe == stored_job_on(run, bench).recipe
    assert load_named_bench(bench) == as_written(Path(bench)).bench() == stored_job(run).bench
    with pytest.raises(RecipeError) as refused:
        load_job(recipe, bench)
    assert [one.option for one in refused.value.problems] == ["decision.guard_factor"]
    written = tmp_path / BENCH_COPY  # no run beside it
    shutil.copy(bench, written)
    with pytest.raises(RecipeError, match="public_key"):
        load_bench(bench)  # which knows nothing of records
    for load in (load_named_bench, as_written, lambda path: stored_job_on(run, str(path))):
        with pytest.raises(RecipeError, match="public_key"):
            load(written)
