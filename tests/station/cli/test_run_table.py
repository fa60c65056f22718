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
from station.store.run_search import search
from station.store.stored_runs import Wanted


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
    "words",
    [
        ("--verdict", "GOOD"),
        ("--since", "yesterday"),
        ("--since", "0001-01-01T00:00+14:00"),
        ("--since", "9999-12-31T23:59-12:00"),
        ("--locale", "fr"),
        ("--data", "nowhere"),
    ],
)
def test_bad_input_is_refused(data: Path, words: tuple[str, ...]) -> None:
    ran = here("runs", *(() if words[0] == "--data" else ("--data", str(data))), *words)
    assert ran.exit_code == 2
    assert words[0] in ran.err


def test_every_list_says_what_became_of_the_attempts_before(tmp_path: Path) -> None:
    """Of a unit that was measured until it passed: on the screen, as CSV and as JSON, from the folder and the store."""
    data = tmp_path / "runs"
    store_run(data, "A1", [metric(1.2, verdict="FAIL", title="Lost motion (x)")], failed="too wide")
    store_run(data, "B2", [metric(0.4)], day=1)
    store_run(data, "A1", [metric(0.5)], day=2, state="stopped")
    store_run(data, "A1", [metric(0.5)], day=3)
    third = "attempt 3; attempt 1 FAIL Lost motion; attempt 2 NOT DECIDABLE"
    assert [row["attempts"] for row in table("--data", str(data))] == [
        "attempt 1", "attempt 1", "attempt 2; attempt 1 FAIL Lost motion", third,
    ]  # fmt: skip
    assert here("runs", "--data", str(data), "--json").json["runs"][-1]["attempts"] == third
    assert "attempt 1 FAIL Lost motion; attempt 2" in here("runs", "--data", str(data)).out, "and the rest below"
    assert here("list", "--data", str(data), "--json").json[-1]["attempts"] == third
    assert "attempt 1 FAIL Lost motion; attempt 2 NOT DECIDABLE" in here("list", "--data", str(data)).out
    for number in range(60):  # older ones are read from the store
        store_run(data, f"C{number}", [metric(0.4)], day=4 + number)
    assert here("list", "--all", "--data", str(data), "--json").json[3]["attempts"] == third
    page = search(data, Wanted(serial="A1"))
    assert page.attempts[page.rows[0].run] == third


def test_an_earlier_attempt_whose_record_was_changed_has_no_verdict_here_either(tmp_path: Path) -> None:
    data = tmp_path / "runs"
    first = store_run(data, "A1", [metric(1.2, verdict="FAIL")], failed="too wide")
    store_run(data, "A1", [metric(0.5)], day=1)
    (first.folder / "result.json").write_text("{}")
    assert [row["attempts"] for row in table("--data", str(data))] == ["attempt 1", "attempt 2; attempt 1 altered"]


def test_where_no_run_is_meant_it_is_said_whether_there_are_any(data: Path, tmp_path: Path) -> None:
    assert here("runs", "--data", str(data), "--serial", "nobody").out == f"{data}: none of 4 runs is meant\n"
    empty = tmp_path / "empty"
    empty.mkdir()
    assert here("runs", "--data", str(empty)).out == f"{empty}: holds no runs\n"
    assert here("runs", "--data", str(empty), "--json").json == {"runs": []}
