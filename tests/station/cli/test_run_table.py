"""`lostmotion runs`: a row for each run, filtered, as a spreadsheet takes it."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest
from lostmotion_command import here
from stored_runs import metric, store_run

from station.cli.csv_columns import read_csv_columns


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    for day, (serial, value) in enumerate((("A1", 0.41), ("=A2", 0.52), ("A3", 1.2))):
        sides = {
            "+": {"value": value, "uncertainty": 0.02, "verdict": "PASS"},
            "-": {"value": value + 0.1, "uncertainty": 0.03, "verdict": "PASS"},
        }
        failed = "too wide" if value > 1.0 else None
        store_run(folder, serial, [metric(value, sides=sides)], day=day, failed=failed, operator="A. Tester")
    store_run(folder, "A1", [metric(0.42)], day=3, recipe="other", state="stopped")
    return folder


def table(*words: str) -> list[dict[str, str]]:
    ran = here("runs", *words, "--csv")
    assert ran.exit_code == 0, ran.err
    return list(csv.DictReader(io.StringIO(ran.out)))


def test_each_run_is_a_row_with_every_side_of_its_metrics(data: Path) -> None:
    rows = table("--data", str(data))
    assert [row["serial"] for row in rows] == ["A1", "'=A2", "A3", "A1"]
    assert [row["verdict"] for row in rows] == ["PASS", "PASS", "FAIL", "NOT DECIDABLE"]
    assert rows[0]["lost_motion mean + [arcmin]"] == "0.41"
    assert rows[0]["lost_motion mean - [arcmin]"] == "0.51"
    assert rows[0]["U(lost_motion mean -) [arcmin]"] == "0.03"
    assert rows[0]["operator"] == "A. Tester"


@pytest.mark.parametrize(
    ("words", "serials"),
    [
        (("--serial", "A1"), ["A1", "A1"]),
        (("--recipe", "other"), ["A1"]),
        (("--verdict", "FAIL"), ["A3"]),
        (("--since", "2026-01-06T12:00+00:00"), ["A3", "A1"]),
        (("--serial", "A1", "--verdict", "PASS"), ["A1"]),
        (("--serial", "nobody"), []),
    ],
)
def test_runs_are_filtered(data: Path, words: tuple[str, ...], serials: list[str]) -> None:
    assert [row["serial"] for row in table("--data", str(data), *words)] == serials


def test_an_altered_run_has_no_verdict(data: Path) -> None:
    bad = next(folder for folder in data.iterdir() if folder.name.endswith("-A3"))
    result = bad / "result.json"
    result.write_text(result.read_text(encoding="utf-8").replace("FAIL", "PASS"), encoding="utf-8")
    row = next(row for row in table("--data", str(data)) if row["serial"] == "A3")
    assert row["verdict"] == ""
    assert "result.json" in row["altered"]
    assert table("--data", str(data), "--verdict", "FAIL") == []


def test_a_german_spreadsheet_takes_the_file(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "runs.csv"
    assert here("runs", "--data", str(data), "--out", str(out), "--locale", "de").exit_code == 0
    assert out.read_bytes().startswith(b"\xef\xbb\xbf")
    assert ";0,41;" in out.read_text(encoding="utf-8-sig")
    assert read_csv_columns(out).texts("serial") == ["A1", "'=A2", "A3", "A1"]


def test_the_screen_names_what_failed_and_json_has_the_numbers(data: Path) -> None:
    said = here("runs", "--data", str(data), "--verdict", "FAIL").out
    assert "A3" in said
    assert "1 run" in said
    found = json.loads(here("runs", "--data", str(data), "--json").out)["runs"]
    assert [len(run["metrics"]) for run in found] == [2, 2, 2, 2]
    first = found[0]["metrics"][0]
    assert (first["metric"], first["side"], first["unit"], first["value"]) == ("lost_motion", "+", "arcmin", 0.41)


@pytest.mark.parametrize(
    "words", [("--verdict", "GOOD"), ("--since", "yesterday"), ("--locale", "fr"), ("--data", "nowhere")]
)
def test_bad_input_is_refused(data: Path, words: tuple[str, ...]) -> None:
    ran = here("runs", *(() if words[0] == "--data" else ("--data", str(data))), *words)
    assert ran.exit_code == 2
    assert words[0] in ran.err
