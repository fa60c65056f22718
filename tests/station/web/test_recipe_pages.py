"""A limit changed and released in a real browser, by two people; the next unit is measured by it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Enter, needs_browser, playwright
from served import Served, prepared, served

from recipes import parse_recipe

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]
MISTAKE = "\nbogus: 1"


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    data = prepared(tmp_path_factory.mktemp("recipes") / "runs")
    (data / "models.yaml").write_text("models: [{model: P1, serial: 'SN-[0-9]+', recipe: good}]\n", encoding="utf-8")
    with served(data) as found:
        yield found


def recipes_of(enter: Enter, role: str) -> playwright.Page:
    page = enter(role)
    page.click("nav >> text=Recipes")
    return page


def tab(page: playwright.Page, name: str) -> None:
    page.get_by_role("tab", name=name, exact=True).click()


def press(page: playwright.Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def state(page: playwright.Page, words: str) -> None:
    page.wait_for_selector(f".lm-recipe-state:text-is('{words}')")


def buttons(page: playwright.Page) -> set[str]:
    return set(page.locator(".lm-recipe-head button").all_inner_texts())


def test_a_limit_is_changed_by_one_person_released_by_another_and_used(station: Served, enter: Enter) -> None:
    technician = recipes_of(enter, "technician")
    technician.click('a[aria-label="open good revision 1"]')
    state(technician, "released")
    assert buttons(technician) == {"Copy to a new revision"}, "what is released cannot be changed"
    technician.click("text=Copy to a new revision")
    state(technician, "not saved")  # the page before says "no errors" too
    technician.wait_for_selector(".lm-in-order")

    technician.click(".cm-content")
    technician.keyboard.press("Control+End")
    technician.keyboard.type(MISTAKE)
    technician.wait_for_selector(".lm-problem:has-text('bogus')")
    assert "line " in technician.inner_text(".lm-problem button")
    for _ in MISTAKE:
        technician.keyboard.press("Backspace")
    technician.wait_for_selector(".lm-in-order")

    tab(technician, "Limits")
    limit = technician.locator("input[aria-label^='Torque ratio, slope'][aria-label$='min']")
    limit.fill("85")
    limit.press("Enter")
    tab(technician, "Changes")
    technician.wait_for_selector(".lm-added:has-text('min: 85')")
    press(technician, "Save")
    technician.wait_for_url("**/recipes/good/2")
    state(technician, "draft")
    press(technician, "Ask for release")
    state(technician, "release asked")
    assert "Release" not in buttons(technician)

    quality = recipes_of(enter, "quality")
    waits = quality.wait_for_selector(".ag-center-cols-container .ag-row[row-index='0'] .lm-waits")
    assert "release asked" in waits.inner_text(), "what waits for this person stands first"
    assert quality.locator(".ag-row[row-index='0'] .ag-cell[col-id=saved]").inner_text()
    quality.click('a[aria-label="open good revision 2"]')
    state(quality, "release asked")
    tab(quality, "Changes")
    quality.wait_for_selector(".lm-removed:has-text('min: 80')")
    assert quality.locator(".lm-added").count() == 2, "the limit, and the number of the revision"
    press(quality, "Send back")
    quality.wait_for_selector(".lm-refused:visible")
    quality.fill(".lm-why-back input", "why 85?")
    press(quality, "Send back")
    state(quality, "draft")
    technician.reload()
    technician.wait_for_selector(".lm-sent-back:has-text('the quality: why 85?')")
    press(technician, "Ask for release")
    state(technician, "release asked")
    quality.reload()
    state(quality, "release asked")
    press(quality, "Release")
    state(quality, "released")

    (text,) = (Path(station.data) / "recipes" / "good").glob("r2.*.yaml")
    changed = parse_recipe(text.read_bytes(), "r2")
    assert [one.min for one in changed.metrics if one.id == "torque_ratio_slope"] == [85.0]
    comments = [line.partition("#")[2] for line in _first(station).splitlines() if "#" in line]
    assert comments == [line.partition("#")[2] for line in text.read_text(encoding="utf-8").splitlines() if "#" in line]

    station.log_in("operator")
    assert station.post("start_run", {"scanned": "SN-1"}, "by the new limit").status_code == 200
    assert station.wait("running", "ended")["recipe"] == "good r2"
    station.post("stop_run", {}, "it has shown its recipe")
    station.wait("ended")


def _first(station: Served) -> str:
    (first,) = (Path(station.data) / "recipes" / "good").glob("r1.*.yaml")
    return first.read_text(encoding="utf-8")


@pytest.mark.parametrize("as_new", [True, False], ids=["new draft", "draft"])
def test_what_was_typed_is_left_only_after_a_question(station: Served, enter: Enter, *, as_new: bool) -> None:
    page, asked = recipes_of(enter, "technician"), list[str]()
    page.set_default_timeout(20_000)
    text = _first(station).replace("name: good", f"name: asks-{as_new}").encode()
    page.set_input_files(".lm-import input[type=file]", {"name": "d.yaml", "mimeType": "text/yaml", "buffer": text})
    page.wait_for_url(f"**/recipes/asks-{as_new}/1")
    if as_new:
        page.goto(f"{station.url}/recipes/good/1?new=1")
    state(page, "not saved" if as_new else "draft")
    page.wait_for_selector(".lm-in-order")
    page.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.dismiss()))
    page.click(".cm-content")
    page.keyboard.type("#")
    page.wait_for_function("window.onbeforeunload")
    page.click("nav >> text=Recipes")
    page.wait_for_timeout(300)
    assert asked == ["beforeunload"]
    page.click(".cm-content")
    page.keyboard.press("Control+z")
    page.wait_for_function("!window.onbeforeunload")
    page.click("nav >> text=Recipes")
    page.wait_for_url("**/recipes")
    assert asked == ["beforeunload"], "nothing is lost that was taken back"


def test_a_form_beside_a_text_with_a_name_twice_says_so_and_changes_nothing(station: Served, enter: Enter) -> None:
    page = recipes_of(enter, "technician")
    page.set_default_timeout(20_000)
    text = _first(station).replace("name: good", "name: twice").encode()
    page.set_input_files(".lm-import input[type=file]", {"name": "t.yaml", "mimeType": "text/yaml", "buffer": text})
    page.wait_for_url("**/recipes/twice/1")
    page.wait_for_selector(".lm-in-order")
    page.click(".cm-content")
    page.keyboard.press("Control+End")
    page.keyboard.type("\nloading: input")
    page.wait_for_selector(".lm-problem:has-text('a second time')")
    tab(page, "Limits")
    limit = page.locator("input[aria-label^='Torque ratio, slope'][aria-label$='min']")
    limit.fill("85")
    limit.press("Enter")
    page.wait_for_selector(".lm-refused:visible:has-text('a second time')")
    tab(page, "Changes")
    page.wait_for_selector(".lm-added:has-text('loading: input')")
    assert page.locator(".lm-added:has-text('min: 85')").count() == 0


def test_whoever_only_operates_may_read_and_change_nothing(enter: Enter) -> None:
    page = recipes_of(enter, "operator")
    assert page.locator(".lm-import").count() == 0
    page.click('a[aria-label="open good revision 1"]')
    page.wait_for_selector(".lm-in-order")
    assert buttons(page) == set()
    tab(page, "Limits")
    assert page.locator("fieldset input:not([readonly])").count() == 0


def test_a_file_is_taken_in_as_a_draft_and_given_out_as_it_came(station: Served, enter: Enter, tmp_path: Path) -> None:
    page = recipes_of(enter, "engineer")
    file = tmp_path / "plant.yaml"
    file.write_text(_first(station).replace("name: good", "name: plant"), encoding="utf-8")
    page.set_input_files(".lm-import input[type=file]", file)
    page.wait_for_url("**/recipes/plant/1")
    state(page, "draft")
    page.click("nav >> text=Recipes")
    with page.expect_download() as download:
        page.click('a[aria-label="export plant revision 1"]')
    assert Path(download.value.path()).read_bytes() == file.read_bytes()
