"""Runs that are looked for: the page of results and its REST; no verdict on a record that is not as it was left."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from sqlalchemy import update
from station_support import Client, client_of, station_in

from benchmarks.many_runs import make_runs
from station.records.chain.chain_file import Chain
from station.store.run_search import search
from station.store.stored_runs import StoredRun, Wanted
from station.web.languages import ENGLISH, words_of
from station.web.pages.results import COLUMNS, LINKS, Asked, row_of
from station.web.pages.words import verdict_text
from station.web.people.database import PEOPLE
from station.web.rest.runs import FILES, begin_of
from station.web.station import Station

COUNT = 60
"""Three of these units failed, and were measured twice."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("results") / "runs"
    make_runs(data, COUNT)
    return data


def test_pages_are_of_the_newest_first_and_hold_each_run_once(folder: Path) -> None:
    pages = [search(folder, Wanted(), first=first, count=25) for first in (0, 25, 50)]
    assert [len(one.rows) for one in pages] == [25, 25, 10]
    assert {one.total for one in pages} == {COUNT}
    runs = [row.run for page in pages for row in page.rows]
    assert runs == sorted({one.name for one in folder.iterdir() if (one / "run.json").is_file()}, reverse=True)
    assert search(folder, Wanted(), first=COUNT, count=25).rows == ()


@pytest.mark.parametrize(
    ("wanted", "total"),
    [
        (Wanted(verdict="FAIL"), 3),
        (Wanted(verdict="PASS"), COUNT - 3),
        (Wanted(begins="U00001"), 10),
        (Wanted(serial="U000018"), 2),
        (Wanted(begins="%"), 0),
        (Wanted(begins="U_0001"), 0),
        (Wanted(recipe="none"), 0),
        (Wanted(model="RV-40E-121"), COUNT),
        (Wanted(model="RV-80E-101"), 0),
        (Wanted(since="2024-01-01T02:00:00.000+00:00"), COUNT - 30),
        (Wanted(until="2024-01-01T02:00:00.000+00:00"), 30),
        (Wanted(since="2024-01-01T01:00:00.000+00:00", until="2024-01-01T02:00:00.000+00:00"), 15),
    ],
)
def test_a_filter_leaves_what_it_says(folder: Path, wanted: Wanted, total: int) -> None:
    assert search(folder, wanted).total == total


def test_a_chain_that_was_restored_is_read_once(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = tmp_path / "runs"
    shutil.copytree(folder, data)
    assert search(data, Wanted()).total == COUNT
    monkeypatch.setattr(Chain, "content", property(lambda _: pytest.fail("nothing has come since")))
    found = search(data, Wanted())
    assert (found.total, found.behind) == (COUNT, 0)
    assert all(row.verdict for row in found.rows)


def test_a_record_that_is_not_as_it_was_left_has_no_verdict(folder: Path, tmp_path: Path) -> None:
    data = tmp_path / "runs"
    shutil.copytree(folder, data)
    newest = search(data, Wanted(), count=3).rows
    changed, gone = data / newest[0].run / "run.json", data / newest[1].run
    changed.write_bytes(changed.read_bytes() + b" ")
    shutil.rmtree(gone)
    rows = {row.run: row for row in search(data, Wanted(), count=3).rows}
    assert [rows[row.run].verdict for row in newest[:2]] == [None, None]
    assert all(rows[row.run].altered for row in newest[:2])
    assert "NO VERDICT" in verdict_text(rows[newest[0].run])


def test_a_row_says_which_metric_failed(folder: Path) -> None:
    page = search(folder, Wanted(verdict="FAIL"), count=10)
    assert set(page.not_passed) == {one.run for one in page.rows}
    for one in page.rows:
        shown = row_of(one, "", words_of(ENGLISH), page.not_passed[one.run])
        assert page.not_passed[one.run][0] in shown["notes"]
    assert search(folder, Wanted(verdict="PASS"), count=10).not_passed == {}


def test_what_is_looked_for_stands_in_the_address() -> None:
    assert Asked().query == ""
    assert Asked(serial="A&B", verdict="FAIL", first=50).query == "?serial=A%26B&verdict=FAIL&first=50"


def stored(**entries: Any) -> StoredRun:
    known = dict.fromkeys(StoredRun._fields, "") | {"attempt": 2, "revision": 3, "virtual": True, "state": "complete"}
    return StoredRun(**known | entries)


def test_the_column_that_makes_a_row_high_is_in_sight_on_a_small_screen() -> None:
    seen = 1024 - 2 * 19 - sum(one["width"] for one in COLUMNS if "pinned" in one)
    place = next(place for place, one in enumerate(COLUMNS) if one.get("autoHeight"))
    assert sum(one.get("width", one.get("minWidth", 0)) for one in COLUMNS[: place + 1]) <= seen


def test_a_row_shows_texts_as_texts() -> None:
    row = stored(run="R 1/../x", serial="<script>alert(1)</script>", recipe="<b>r</b>", scenario="f.yaml",
                 started="2026-01-02T03:04:05.000+00:00", operator="<img src=x onerror=alert(1)>",
                 verdict="FAIL")  # fmt: skip
    shown = row_of(row, "attempt 2; attempt 1 FAIL <b>", words_of(ENGLISH))
    assert shown["operator"] == row.operator, "the table's own cells are text"
    for name in LINKS:
        assert "<script>" not in shown[name]
    assert "/api/runs/R%201%2F..%2Fx/report.html" in shown["report"]
    assert 'href="/runs/R%201%2F..%2Fx"' in shown["open"]
    assert "FAIL" in shown["verdict"]
    altered = row_of(row._replace(altered="result.json: is missing", verdict=None), "", words_of(ENGLISH))
    assert altered["report"] == "", "it would be refused"
    assert "result.json: is missing" in altered["notes"]
    stopped = row._replace(state="stopped", verdict=None)
    assert "STOPPED" in verdict_text(stopped)


def test_a_day_begins_and_ends_where_the_computer_is() -> None:
    begin, end = begin_of(date(2026, 3, 1)), begin_of(date(2026, 3, 1), after=True)
    assert begin is not None
    assert end is not None
    assert begin < end
    assert (begin_of(None), begin_of(date.max, after=True)) == (None, None)
    assert begin_of(date.min) is not None


@pytest.fixture(scope="module")
def station(quick_run: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    data = tmp_path_factory.mktemp("reports") / "runs"
    shutil.copytree(quick_run.data, data)
    found = station_in(data)
    found.evaluations.fork()  # it has loaded most of what evaluates
    yield found
    found.close()


@pytest.fixture
def client(station: Station) -> Client:
    return client_of(station, "operator")


def test_runs_and_reports_are_for_who_is_logged_in(station: Station, client: Client) -> None:
    run = client.http.get("/api/runs").json()["runs"][0]["run"]
    for address in ("/api/runs", *(f"/api/runs/{run}/{name}" for name in FILES)):
        assert client_of(station).http.get(address).status_code == 401
        assert client.http.get(address).status_code == 200
    found = client.http.get("/api/runs", params={"verdict": "PASS", "since": "2020-01-01", "count": 5}).json()
    assert found["total"] == len(found["runs"]) == 1
    assert client.http.get("/api/runs", params={"verdict": "GOOD"}).status_code == 422


def test_a_report_is_a_page_that_runs_nothing(client: Client) -> None:
    run = client.http.get("/api/runs").json()["runs"][0]["run"]
    page = client.http.get(f"/api/runs/{run}/report.html")
    assert page.headers["content-security-policy"].startswith("default-src 'none'")
    assert "PASS" in page.text
    assert "<script" not in page.text
    pdf = client.http.get(f"/api/runs/{run}/report.pdf")
    assert pdf.content.startswith(b"%PDF-")
    assert client.http.get("/api/runs/none/report.html").status_code == 404
    assert client.http.get("/api/runs/..%2F..%2Fetc/report.html").status_code == 404
    assert client.http.get(f"/api/runs/{run}/report.exe").status_code in (404, 422)


def test_the_table_of_runs_is_that_of_the_command(
    station: Station, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert client_of(station).http.get("/api/runs.csv").status_code == 401
    for locale in ("en", "de"):
        found = client.http.get("/api/runs.csv", params={"verdict": "PASS", "locale": locale})
        assert found.headers["content-disposition"] == 'attachment; filename="runs.csv"'
        told = here("runs", "--csv", "--verdict", "PASS", "--locale", locale, "--data", str(station.data)).out
        assert found.content.decode("utf-8-sig") == told
        assert len(told.splitlines()) == 2
    assert len(client.http.get("/api/runs.csv", params={"serial": "nobody's"}).content.splitlines()) == 1
    monkeypatch.setattr("station.web.rest.runs.MOST_IN_TABLE", 0)
    refused = client.http.get("/api/runs.csv")
    assert (refused.status_code, "Ask for fewer" in refused.text) == (422, True)


def test_the_files_of_a_run_are_those_of_the_commands(station: Station, client: Client, tmp_path: Path) -> None:
    run = client.http.get("/api/runs").json()["runs"][0]["run"]
    loop = client.http.get(f"/api/runs/{run}/loop.csv")
    assert loop.headers["content-disposition"].startswith("attachment")
    (tmp_path / "loop.csv").write_bytes(loop.content)
    samples = client.http.get(f"/api/runs/{run}/run.parquet").content
    assert here("export", run, "--data", str(station.data), "--out", str(tmp_path / "x.parquet")).exit_code == 0
    assert samples == (tmp_path / "x.parquet").read_bytes()
    recipe = str(station.data / run / "recipe.yaml")
    again = here("analyze", str(tmp_path / "loop.csv"), "--recipe", recipe, "--json").json
    stored = {one["id"]: one["value"] for one in client.http.get(f"/api/runs/{run}").json()["metrics"]}
    assert {one["id"]: one["value"] for one in again["metrics"]}["lost_motion"] == pytest.approx(
        stored["lost_motion"], rel=1e-3
    )


def test_no_report_of_a_record_that_is_not_as_it_was_left(station: Station, client: Client) -> None:
    run = client.http.get("/api/runs").json()["runs"][0]["run"]
    result = station.data / run / "result.json"
    before = result.read_bytes()
    result.write_bytes(before.replace(b'"PASS"', b'"FAIL"', 1))
    try:
        for name in FILES:
            answer = client.http.get(f"/api/runs/{run}/{name}")
            assert answer.status_code == 409, name
            (why,) = answer.json()["refused"]
            assert why["id"] == "run"
            assert "result.json" in why["text"], "what differs is named"
        assert client.http.get(f"/api/runs/{run}").status_code == 409
        assert client.http.get("/api/runs").json()["runs"][0]["verdict"] is None
    finally:
        result.write_bytes(before)


def test_who_must_choose_a_password_first_reads_no_run(station: Station, client: Client) -> None:
    run = client.http.get("/api/runs").json()["runs"][0]["run"]
    other = client_of(station, "quality")
    with station.database.writing() as connection:
        connection.execute(update(PEOPLE).where(PEOPLE.c.name == "the quality").values(must_change=True))
    for address in ("/api/runs", f"/api/runs/{run}", *(f"/api/runs/{run}/{name}" for name in FILES)):
        assert other.http.get(address).status_code == 403
