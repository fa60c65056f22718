"""The test code of a scanner: what another layout and Caps Lock make of it is told, and nothing else passes."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import update
from station_support import client_of, station_in

from recipes import RecipeError
from station.web.people.database import SCANNER_TESTS
from station.web.scanner_test import AS_GERMAN, CAPS_LOCK, GERMAN, LAYOUT, OTHER, US, is_test_code, misread
from station.web.settings import ScannerTest, Settings, load_settings
from station.web.station import Station

TEST = ScannerTest()
CODE = TEST.code
SERIALS = st.text(alphabet="ABCXYZabcxyz0123456789-/_.", min_size=1, max_size=24)


def test_the_table_of_a_layout_is_whole() -> None:
    assert len(US) == len(GERMAN) == len(set(US)) == len(set(GERMAN))
    assert not set(US) & set("ABCabc0123456789 "), "what all layouts have in common stays"


@pytest.mark.parametrize(
    ("scanned", "why"),
    [
        (CODE, None),
        (f"\r{CODE}\t\n", None),
        (f"]C0{CODE}", None),
        (CODE.translate(AS_GERMAN), LAYOUT),
        (CODE.translate(AS_GERMAN).replace("´", "\ufffd").replace("`", "\ufffd"), LAYOUT),
        (CODE.translate(AS_GERMAN).replace("´", "").replace("`", ""), LAYOUT),
        (CODE.swapcase(), CAPS_LOCK),
        (CODE.swapcase().translate(AS_GERMAN), CAPS_LOCK),
        (CODE[1:], OTHER),
        (CODE + CODE, OTHER),
        ("SN-1", OTHER),
        ("", OTHER),
    ],
)
def test_what_is_wrong_with_a_reading_is_told(scanned: str, why: str | None) -> None:
    assert misread(CODE, scanned) == why
    assert is_test_code(CODE, scanned) == (why != OTHER)


@given(serial=SERIALS)
def test_a_layout_that_passes_the_test_changes_no_serial_number(serial: str) -> None:
    """Each way in which a keyboard may change characters is told by the test code, unless it changes no serial."""
    for changed in (str.swapcase, lambda text: text.translate(AS_GERMAN)):
        if changed(serial) != serial:
            assert misread(CODE, changed(CODE)) is not None


def with_test(tmp_path: Path) -> Station:
    found = station_in(tmp_path / "runs")
    object.__setattr__(found, "settings", Settings(scanner_test=TEST))
    return found


def test_a_unit_waits_for_the_test_of_the_shift(tmp_path: Path) -> None:
    station = with_test(tmp_path)
    operator = client_of(station, "operator")

    def reasons() -> list[str]:
        return [one["id"] for one in operator.post("ask_permission", {"scanned": "SN-1"}).json()["reasons"]]

    assert reasons() == ["scanner_tested"]
    refused = operator.post("test_scanner", {"scanned": CODE.translate(AS_GERMAN)})
    assert (refused.status_code, refused.json()["refused"][0]["text"]) == (409, LAYOUT)
    assert reasons() == ["scanner_tested"]
    assert operator.post("test_scanner", {"scanned": CODE}).status_code == 200
    assert reasons() == []
    for at_s in (time.time() - 3600.0 * TEST.hours - 1.0, time.time() + 60.0):
        with station.database.writing() as connection:
            connection.execute(update(SCANNER_TESTS).values(at_s=at_s))
        assert reasons() == ["scanner_tested"]
    bypass = {"condition": "scanner_tested", "reason": "the card is lost", "hours": 1.0}
    assert operator.post("add_bypass", bypass).status_code == 403
    assert client_of(station, "technician").post("add_bypass", bypass).status_code == 200
    assert reasons() == []
    station.close()


@pytest.mark.parametrize("text", ["scanner_test: {code: ABC}", "badge: '['", "operator_by_badge_alone: maybe"])
def test_wrong_settings_are_refused(tmp_path: Path, text: str) -> None:
    assert load_settings(tmp_path) == Settings()
    (tmp_path / "station.yaml").write_text(text)
    with pytest.raises(RecipeError):
        load_settings(tmp_path)
