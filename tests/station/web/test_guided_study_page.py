"""A guided study at a station: begun and evaluated on the page, measured by two people by what it says comes next."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served

from station.quality.guided.progress import look
from station.records.run_record import RunRecord
from station.records.studies import read_study

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

LONGEST_MS = 60_000
MOST_RUNS = 14
PEOPLE = ("operator", "technician")


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(prepared(tmp_path_factory.mktemp("studies") / "runs")) as found:
        yield found


def start(station: Served, role: str, serial: str, study: str = "") -> dict[str, str]:
    """Ask for a run as somebody, and wait for its end; return the reasons of a refusal by their ids."""
    station.log_in(role)
    answer = station.post("start_run", {"scanned": serial, "study": study}, uuid.uuid4().hex).json()
    refused = {one["id"]: one["text"] for one in answer.get("refused", [])}
    if not refused:
        station.wait("starting", "running")
        station.wait("ended", "ready")
    return refused


def test_two_people_measure_a_gage_study_and_its_page_leads_them(station: Served, enter: Enter) -> None:
    page: playwright.Page = enter("technician")
    page.set_default_timeout(LONGEST_MS)
    page.goto(f"{station.url}/quality")
    page.get_by_role("tab", name="Guided studies").click()
    page.wait_for_selector("text=No study was begun.")
    page.get_by_label("Kind").click()
    page.get_by_role("option", name="Gage: several units, each by several operators").click()
    page.get_by_label("Name of the study").fill("grr-1")
    page.get_by_label("Serial numbers").fill("SN-1")
    page.get_by_label("Operators by").fill("the operator, the technician")
    page.get_by_label("Metrics by id").fill("torque_ratio_slope")
    page.get_by_label("Trials").fill("2")
    page.get_by_role("button", name="Begin").click()
    page.wait_for_selector("[role=alert] >> text=a gage study has 2 units or more")
    page.get_by_label("Serial numbers").fill("SN-1, SN-2")
    page.get_by_role("button", name="Begin").click()
    page.wait_for_selector("[role=status] >> text=Step 1 of 8: put unit")

    found = look(station.data, "grr-1")
    assert found.study.person == "the technician"
    _, first = found.next
    page.get_by_label("Scanned label").fill("SN-2" if first.part == "SN-1" else "SN-1")
    page.get_by_role("button", name="Measure").click()
    page.wait_for_selector("[role=alert] >> text=is next. Put that unit on the bench")
    page.get_by_role("button", name="Evaluate").click()
    page.wait_for_selector("[role=alert] >> text=0 of 8 steps are measured. Missing:")

    role, other = PEOPLE if first.operator == "the operator" else PEOPLE[::-1]
    refused = start(station, other, first.part, "grr-1")
    assert set(refused) == {"study_step"}
    assert f"found operator the {other}; this step is for operator the {role}" in refused["study_step"]
    for _ in range(MOST_RUNS):
        if (now := look(station.data, "grr-1").next) is None:
            break
        assert start(station, now[1].operator.removeprefix("the "), now[1].part, "grr-1") == {}
    found = look(station.data, "grr-1")
    assert found.open == (), found.does_not_count

    page.wait_for_selector("[role=status] >> text=Every step is measured.")
    page.get_by_role("button", name="Evaluate").click()
    page.wait_for_selector("[role=alert] >> text=of the total spread")
    assert len(read_study(station.data, "grr-1").taken) == 8, "the last one too is in the file"

    manifests = [RunRecord(station.data / run).manifest() for run in found.measured.values()]
    assert max(one.attempt for one in manifests) >= 4, "more often than the model allows: the study is the reason"
    assert all(one.study is not None and one.retest_reason == (str(one.study) if one.attempt > 1 else None)
               for one in manifests)  # fmt: skip
    assert set(start(station, "operator", "SN-1")) == {"attempts_left"}, "for the production it is another matter"
