"""The wall clock is read in one place, and a jump of it is told; what a run is timed by is another clock."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from station.log import open_log
from station.wall_clock import SEEN_FROM_S, WALL_CLOCK, JumpWatch, now_text

ROOT = Path(__file__).parents[2]
READS = re.compile(r"\btime\.time(_ns)?\(|\bdatetime\.(now|utcnow|today)\(|\bdate\.today\(|CLOCK_REALTIME|TimeStamper")

BEFORE_A_RUN = {"recipes/checks/cross_check.py"}
"""Asks what day it is, for calibrations that are out of date, when a recipe is checked: no run has begun then."""


def test_the_wall_clock_is_read_in_one_place() -> None:
    folders = ("station", "controller", "analysis", "recipes", "drivers", "definitions")
    readers = {
        str(path.relative_to(ROOT))
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        if READS.search(path.read_text("utf-8")) and "virtual" not in path.relative_to(ROOT).parts
    }
    assert readers - BEFORE_A_RUN == {"station/wall_clock.py"}, "use WALL_CLOCK, so that a scenario can set it"
    assert readers > BEFORE_A_RUN


@pytest.fixture
def put_back():
    jumped = WALL_CLOCK._jumped
    yield
    WALL_CLOCK._jumped = jumped


@pytest.mark.parametrize("step_s", [-3600.0, 86_400.0])
@pytest.mark.usefixtures("put_back")
def test_a_jump_is_found_and_shows_in_every_time_of_day(step_s, tmp_path) -> None:
    watch, before = JumpWatch(), now_text()
    assert watch.jumped_s() == 0.0
    WALL_CLOCK.step(step_s)
    assert watch.jumped_s() == pytest.approx(step_s, abs=0.01)
    assert (now_text() < before) == (step_s < 0.0)
    with open_log(tmp_path / "log.jsonl") as log:
        log.info("said")
    line = json.loads((tmp_path / "log.jsonl").read_text())
    assert (line["timestamp"] < before) == (step_s < 0.0)
    assert line["timestamp"].endswith("Z")
    WALL_CLOCK.step(-step_s)
    assert watch.jumped_s() == pytest.approx(step_s, abs=0.01), "it was set, whatever was done afterwards"


@pytest.mark.usefixtures("put_back")
def test_a_jump_that_is_put_back_before_the_end_is_told() -> None:
    watch = JumpWatch()
    WALL_CLOCK.step(-7200.0)
    watch.look()
    WALL_CLOCK.step(7200.0)
    watch.look()
    assert watch.jumped_s() == pytest.approx(-7200.0, abs=0.01)


@pytest.mark.usefixtures("put_back")
def test_what_steering_does_to_a_clock_is_not_called_a_jump() -> None:
    watch = JumpWatch()
    WALL_CLOCK.step(0.9 * SEEN_FROM_S)
    assert watch.jumped_s() == 0.0
