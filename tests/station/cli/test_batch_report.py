"""The report of a batch: page, PDF, tables that a German spreadsheet opens, and what no spreadsheet may execute."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from station.quality.batch.content import batch_of
from station.quality.batch.files import HTML, PDF, _histograms, csv_of
from station.reports.pdf_pages import layout
from station.results.export import LOCALES
from station.store.quality.lot import Lot
from station.store.view import look_at

FORMULA = "=HYPERLINK(1)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("batch") / "runs"
    for number in range(12):
        store_run(data, f"U{number}", [metric(0.5 + 0.01 * number)], day=number)
    store_run(data, FORMULA, [metric(1.5, verdict="FAIL")], day=12, failed="lost_motion")
    return data


def test_tables_are_those_of_the_figures(folder: Path) -> None:
    batch = batch_of(folder, Lot(), 0)
    tables = {table.name: table for table in batch.tables}
    assert [row[0] for row in tables["capability"].rows] == ["Lost motion side +", "Lost motion side −"]
    mean = (sum(0.5 + 0.01 * number for number in range(12)) + 1.5) / 13
    assert tables["capability"].rows[0][4] == pytest.approx(mean)
    assert [row[2] for row in tables["pareto"].rows] == [1]
    assert len(batch.values.rows) == 13
    text = csv_of(batch.values, LOCALES["de"])
    rows = list(csv.reader(text.splitlines(), delimiter=";"))
    assert rows[1][3] == "0,5"
    assert f"'{FORMULA}" in {row[1] for row in rows}


def test_a_histogram_names_its_metric_and_unit_and_counts_whole_units(folder: Path) -> None:
    axes = _histograms(batch_of(folder, Lot(), 0)).axes[0]
    assert axes.get_xlabel() == "Lost motion side +  [arcmin]"
    assert axes.get_ylabel()
    assert all(float(tick).is_integer() for tick in axes.get_yticks())


def test_metrics_that_are_called_alike_keep_their_own_values_and_names(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    alike = {
        ("stiffness_50_100", "load"): 95.0, ("stiffness_50_100", "unload"): 90.0, ("stiffness_lsq", "load"): 80.0,
        ("lost_motion", "mean"): 0.5,
    }  # fmt: skip
    for number in range(4):
        metrics = [metric(value + number, id=name, branch=branch) for (name, branch), value in alike.items()]
        store_run(data, f"U{number}", metrics, day=number)
    batch = batch_of(data, Lot(), 0)
    heads, first = batch.values.heads[3:], batch.values.rows[0][3:]
    assert len(set(heads)) == len(heads) == 8
    assert first[::2] == tuple(alike.values())
    assert heads[0] == "Stiffness (secant, 50–100 % T_r) branch load side + [arcmin]"
    assert heads[6] == "Lost motion side + [arcmin]", "a name has no more than it needs"
    names = [row[0] for row in batch.tables[0].rows]
    assert len(set(names)) == 8
    assert [values[0] for (_, side), values in batch.numbers.items() if side == "+"] == list(alike.values())


def test_what_was_tested_by_other_limits_is_said_beside_the_indices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, paragraphs = tmp_path / "runs", list[str]()
    plain = layout.paragraph

    def kept(text: str, *words: Any, **options: Any) -> Any:
        paragraphs.append(text)
        return plain(text, *words, **options)

    monkeypatch.setattr(layout, "paragraph", kept)
    for number in range(5):
        revision, highest = (2, 1.0) if number < 3 else (3, 0.6)
        one = metric(0.5 + 0.01 * number, limits={"min": None, "max": highest})
        store_run(data, f"U{number}", [one], day=number, revision=revision)
    out = tmp_path / "out"
    told = here("quality", "report", "--loops", "0", "--data", str(data), "--out", str(out))
    said = "3 of 5 values were tested by ≤ 1 arcmin (recipe revision 2)"
    assert f"Lost motion: {said}" in told.out
    assert f"Lost motion: {said}" in (out / HTML).read_text(encoding="utf-8")
    rows = list(csv.DictReader((out / "capability.csv").read_text(encoding="utf-8-sig").splitlines()))
    assert [row["remark"] for row in rows if row["Cpk"]] == [said]
    assert f"Lost motion: {said}" in paragraphs, "the PDF says it too"


def test_units_that_were_measured_again_are_named(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    store_run(data, "U1", [metric(1.5, verdict="FAIL")], failed="lost_motion")
    store_run(data, "U2", [metric(0.5)], day=1)
    assert "retests" not in {table.name for table in batch_of(data, Lot(), 0).tables}
    again = store_run(data, "U1", [metric(0.5)], day=2)
    tables = {table.name: table for table in batch_of(data, Lot(), 0).tables}
    assert tables["retests"].rows == ((again.id, "U1", "PASS", "attempt 2; attempt 1 FAIL Lost motion"),)


def test_a_report_says_how_many_runs_it_leaves_out(tmp_path: Path) -> None:
    for day in range(3):
        store_run(tmp_path, f"U{day}", [metric(0.5)], day=day)
    assert not any("not counted" in note for note in batch_of(tmp_path, Lot(), 0).notes)
    bad = store_run(tmp_path, "BAD", [metric(1.5)], day=4, failed="lost_motion").folder / "result.json"
    bad.write_bytes(bad.read_bytes() + b" ")
    with look_at(tmp_path):
        assert any("not counted: 1 run " in note for note in batch_of(tmp_path, Lot(), 0).notes)


def test_a_page_a_pdf_and_files_with_every_loop(quick_run: Any, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("quality", "report", "--virtual", "--locale", "de", "--data", str(quick_run.data), "--out", str(out))
    told = here(*words, "--json")
    assert told.exit_code == 0, told.err
    assert told.json["loops"] == 1
    assert {Path(one).name for one in told.json["files"]} == {
        HTML, PDF, "capability.csv", "pareto.csv", "values.csv", "loops.csv"
    }  # fmt: skip
    assert (out / PDF).read_bytes().startswith(b"%PDF-")
    page = (out / HTML).read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 1, "one unit has no capability"
    assert "VIRTUAL" in page
    loops = (out / "loops.csv").read_text(encoding="utf-8-sig").splitlines()
    assert loops[0].startswith("run;serial;branch")
    assert "," in loops[1].split(";")[3]
    assert len({line.split(";")[2] for line in loops[1:]}) == 2


def test_a_record_is_no_place_for_a_report(quick_run: Any) -> None:
    told = here("quality", "report", "--virtual", "--loops", "0", "--data", str(quick_run.data), "--out",
                str(quick_run.record))  # fmt: skip
    assert told.exit_code == 2
    assert "lies in the folder of run" in told.err
