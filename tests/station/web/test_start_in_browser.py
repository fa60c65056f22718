"""Each condition of a start fails alone in a real browser, with its text, and nothing is begun."""

from __future__ import annotations

import json
import os
import re
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from browser import needs_browser, opened, playwright
from serve_conditions import CHOSEN
from served import Served, prepared, served_by
from station_support import write_models
from test_start_permission import cases

from station.web.models import load_models
from station.web.permission import CONDITIONS, Situation, Wanted, refusals, situation_of

pytestmark = [pytest.mark.wires, pytest.mark.long, needs_browser]

SCAN = """text => [...text, "Enter"].forEach(
    key => document.body.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true})))"""


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A station whose conditions fail as the file `chosen` says."""
    data = prepared(tmp_path_factory.mktemp("conditions") / "runs")
    script = Path(__file__).with_name("serve_conditions.py")
    with served_by(
        [sys.executable, "-W", "ignore", str(script), str(data)], data, {**os.environ, "PYTHONPATH": path()}
    ) as found:
        found.log_in("operator")
        yield found


def path() -> str:
    """Return where this process finds its modules, for one that needs the same."""
    return os.pathsep.join(one for one in sys.path if one)


@pytest.fixture(scope="module")
def page(failing: Served) -> Iterator[playwright.Page]:
    with opened(failing.url) as enter:
        yield enter("operator")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Situation:
    data = tmp_path_factory.mktemp("texts") / "runs"
    write_models(data)
    return situation_of(data, load_models(data, None), Wanted("SN-1"), busy=False, confirmed=frozenset())


def newest(station: Served) -> tuple[str, list[str]]:
    with closing(sqlite3.connect(station.data / "station.sqlite3")) as database:
        asked = "SELECT outcome, detail FROM audit WHERE action = 'start_run' ORDER BY number DESC LIMIT 1"
        outcome, detail = database.execute(asked).fetchone()
    return outcome, json.loads(detail)["reasons"]


def told_of(text: str) -> str:
    """Return a text without the time of day at which it was said."""
    return re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d", "NOW", " ".join(text.split()))


@pytest.mark.parametrize("condition", [one.id for one in CONDITIONS])
def test_each_condition_fails_alone_with_its_text_in_the_browser(
    failing: Served, page: playwright.Page, good: Situation, monkeypatch: pytest.MonkeyPatch, condition: str
) -> None:
    ((refused, why),) = refusals(cases(good, monkeypatch)[condition])
    assert refused == condition
    (failing.data / CHOSEN).write_text(condition, encoding="utf-8")
    page.evaluate("document.querySelectorAll('.lm-refused *').forEach(one => one.dataset.seen = '')")
    page.evaluate(SCAN, "SN-1")
    page.wait_for_selector(".lm-refused:visible *:not([data-seen])")
    shown = page.evaluate("[...document.querySelectorAll('.lm-refused .lm-refusal')].map(one => one.innerText).join()")
    told = why.replace(str(good.data.parent), str(failing.data.parent))
    assert told_of(shown) == told_of(told)
    assert "SN-1" in page.inner_text(".lm-scanned")
    assert newest(failing) == ("refused", [condition])
    assert page.inner_text(".lm-word") == "READY"
    assert failing.now()["stage"] == "ready"
    assert list(failing.data.glob("*/run.json")) == [], "nothing was begun"
