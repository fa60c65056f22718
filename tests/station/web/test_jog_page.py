"""The page of a jog in a real browser, on the virtual bench: the shaft turns while the key is held, and no longer.

What the shaft did is read from the record of the jog, not from the page.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing

import pytest
from browser import Enter, needs_browser, playwright
from run_samples import records_of
from served import LONGEST_S, Served, prepared, served

from definitions.image import State
from definitions.jog import JogPhase
from station.run.jog.jogs import jogs

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

HIDE = """{
    Object.defineProperty(document, 'hidden', { get: () => true, configurable: true });
    document.dispatchEvent(new Event('visibilitychange'));
}"""
"""What a browser does with a tab behind another."""

KEY = ".lm-key[data-jog='{}']"


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(prepared(tmp_path_factory.mktemp("jog") / "runs"), "--port", "0") as found:
        found.log_in("technician")
        yield found


@pytest.fixture(scope="module")
def page(station: Served, enter: Enter) -> playwright.Page:
    page = enter("technician")
    page.goto(f"{station.url}/jog")
    page.get_by_role("button", name="Begin a jog").click()
    page.wait_for_selector(f"{KEY.format(1)}:not([disabled])")
    return page


def phase(station: Served) -> int:
    """Return the phase in the newest record of the newest jog; 0 where it jogs no more."""
    described = sorted(station.data.glob("jogs/*/run.json"))
    table = records_of(described[-1].parent) if described else ()
    on = len(table) > 0 and table["orders"]["state"][-1] == State.JOG
    return int(table["orders"]["phase"][-1]) if on else 0


def until(reached: Callable[[], bool], most_s: float = LONGEST_S) -> bool:
    ends = time.monotonic() + most_s
    while not reached():
        if time.monotonic() > ends:
            return False
        time.sleep(0.1)
    return True


def device(station: Served, *, down: bool) -> None:
    key = f"device {time.monotonic_ns()}"
    assert station.post("press_device", {"down": down}, key).status_code == 200


def stands(station: Served) -> bool:
    return phase(station) in (0, JogPhase.RELEASE_DEVICE, JogPhase.HOLD_KEY)


def turn(station: Served, hold: Callable[[], None], let_go: Callable[[], None]) -> None:
    """Hold the key, then press the enabling device; anew where a busy machine has lost the key in between."""
    for _ in range(8):
        device(station, down=False)
        assert until(lambda: phase(station) == JogPhase.HOLD_KEY)
        hold()
        if until(lambda: phase(station) == JogPhase.PRESS_DEVICE, 10.0):
            device(station, down=True)
            if until(lambda: phase(station) == JogPhase.TURNING, 10.0):
                return
        let_go()
    pytest.fail(f"the shaft does not turn: phase {phase(station)}")


def pointer(page: playwright.Page, direction: int) -> Callable[[], None]:
    def hold() -> None:
        box = page.locator(KEY.format(direction)).bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()

    return hold


def audited(station: Served, action: str) -> list[tuple[str, str, dict]]:
    with closing(sqlite3.connect(station.data / "station.sqlite3")) as database:
        rows = database.execute(
            "SELECT name, outcome, detail FROM audit WHERE action = ? ORDER BY number", (action,)
        ).fetchall()
    return [(name, outcome, json.loads(detail)) for name, outcome, detail in rows]


def released(station: Served) -> list[str]:
    return [detail["why"] for _, outcome, detail in audited(station, "release_jog") if outcome == "done"]


def test_the_shaft_turns_while_the_key_is_held_and_stops_on_release(station: Served, page: playwright.Page) -> None:
    turn(station, pointer(page, 1), page.mouse.up)
    page.wait_for_function("document.querySelector('.lm-jog .lm-word').innerText.startsWith('Shaft turns')")
    page.wait_for_selector(".lm-pressed:has-text('pressed')")
    refused = station.post("start_run", {"scanned": "SN-1"}, "a run in a jog").json()["refused"]
    assert [one["id"] for one in refused] == ["bench_free"]
    assert "jog" in refused[0]["text"]
    page.mouse.up()
    assert until(lambda: stands(station)), "the enabling device is still pressed: the key alone stops the shaft"
    time.sleep(1.0)
    assert stands(station)
    name, outcome, detail = audited(station, "hold_jog")[0]
    assert (name, outcome, detail["direction"]) == ("the technician", "done", 1)
    assert (detail["before"]["held"], detail["after"]["held"]) == (0, 1)
    assert audited(station, "press_device")[-1][1] == "done"
    for _ in range(8):  # a browser that has no processor for a second has lost its key before it is let go
        device(station, down=False)
        pointer(page, 1)()
        assert until(lambda: phase(station) == JogPhase.PRESS_DEVICE)
        page.mouse.up()
        if until(lambda: "released" in released(station), 3.0):
            return
    pytest.fail(f"no key was let go by the pointer: {released(station)}")


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("window.socket.disconnect()", "lost"),
        ("{ const ends = Date.now() + 4000; while (Date.now() < ends); }", "lost"),
        ("window.dispatchEvent(new Event('blur'))", "blurred"),
        (HIDE, "hidden"),
    ],
)
def test_a_key_that_nobody_can_vouch_for_is_not_held(
    station: Served, page: playwright.Page, how: str, why: str
) -> None:
    page.goto(f"{station.url}/jog")
    page.wait_for_selector(f"{KEY.format(-1)}:not([disabled])")
    before = len(released(station))

    def hold() -> None:
        page.locator(KEY.format(-1)).focus()
        page.keyboard.down(" ")

    turn(station, hold, lambda: page.keyboard.up(" "))
    page.evaluate(how)
    assert until(lambda: stands(station)), "the key of the keyboard is still down"
    told = (why, "lost")  # a busy browser may lose the key before it is told to
    assert until(lambda: bool(set(told) & set(released(station)[before:]))), released(station)[before:]
    page.keyboard.up(" ")


def test_who_only_operates_turns_nothing_and_may_end_it(station: Served, enter: Enter) -> None:
    page = enter("operator")
    page.goto(f"{station.url}/jog")
    page.wait_for_selector("text=A technician, an engineer or an admin may jog")
    assert page.locator(".lm-key:not([disabled])").count() == 0
    assert not page.get_by_role("button", name="Begin a jog").is_visible()
    page.evaluate("emitEvent('action', {action: 'hold_jog', values: {direction: 1}})")
    page.evaluate("emitEvent('jog_token', {question: 1, direction: 1})")
    assert until(lambda: ("the operator", "refused") in [one[:2] for one in audited(station, "hold_jog")])
    another = station.post("hold_jog", {"direction": 1}, "of another session")
    assert another.json()["refused"][0]["id"] == "no_jog", "only the page that began it holds the key"
    page.get_by_role("button", name="End the jog").click()
    page.wait_for_selector(".lm-begin", state="hidden")  # nothing is left in it for this person
    (record,) = jogs(station.data).newest(9)
    assert until(lambda: record.manifest().state == "stopped")
    table = records_of(record.folder)
    turning = table["orders"]["phase"] == JogPhase.TURNING
    speed = table["image"]["drive_velocity_rad_s"][turning]
    assert speed.max() > 0.1 > -0.1 > speed.min()
    assert ("the operator", "done") in [one[:2] for one in audited(station, "end_jog")]


def test_no_jog_begins_while_a_run_is_on(station: Served) -> None:
    assert until(lambda: station.post("start_run", {"scanned": "SN-1"}, f"run {time.time_ns()}").status_code == 200)
    refused = station.post("begin_jog", {"model": "P1"}, "a jog in a run").json()["refused"]
    assert [one["id"] for one in refused] == ["bench_free"]
    station.wait("running")
    assert station.post("stop_run", {}, "stop").status_code == 200
    station.wait("ended")


def test_a_server_that_is_killed_takes_the_key_with_it(station: Served) -> None:
    def begun() -> bool:
        return station.post("begin_jog", {"model": "P1"}, f"jog {time.time_ns()}").status_code == 200

    assert until(begun)
    assert until(lambda: phase(station) != 0)
    station.kill()
    record = jogs(station.data).newest(1)[0]
    assert until(lambda: record.manifest().state == "stopped")
