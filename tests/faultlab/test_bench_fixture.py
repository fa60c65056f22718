"""The examples of the documentation run as they stand, and a test that should fail does."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from faultlab import bench_under_test
from faultlab.bench_under_test import BenchUnderTest

PAGE = Path(__file__).parents[2] / "docs" / "fault-tests.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("number", range(3))
def test_example_of_the_documentation(number):
    names: dict = {}
    exec(EXAMPLES[number], names)  # noqa: S102 - our own page
    (example,) = [value for name, value in names.items() if name.startswith("test_")]
    markers = {mark.name: mark.kwargs for mark in getattr(example, "pytestmark", [])}
    example(BenchUnderTest(**markers.get("lostmotion", {})))


def test_the_fixture_is_there(lostmotion_bench):
    assert lostmotion_bench.until(state="home").state == 1
    assert lostmotion_bench.state == "home"


def test_what_does_not_hold_fails(lostmotion_bench):
    lostmotion_bench.until(state="lock")
    lostmotion_bench.inject("io.guard", "open")
    with pytest.raises(pytest.fail.Exception, match="expected final_state complete: was fault"):
        lostmotion_bench.expect(final_state="complete")


@pytest.mark.parametrize(("target", "verb", "value"), [("machine.disk", "full", None), ("can.bus", "errors", 5.0)])
def test_a_fault_that_needs_wires_is_refused_in_virtual_time(lostmotion_bench, target, verb, value):
    with pytest.raises(ValueError, match=f"{target} {verb} acts over real wires only.*faults run FILE --wires"):
        lostmotion_bench.inject(target, verb, value)


def test_an_unknown_fault_or_state_is_refused_with_what_is_allowed(lostmotion_bench):
    with pytest.raises(ValueError, match="allowed: open"):
        lostmotion_bench.inject("io.guard", "close")
    with pytest.raises(ValueError, match="allowed: idle"):
        lostmotion_bench.until(state="ramp")


def test_until_a_state_that_does_not_come_fails_there_and_lists_what_came(lostmotion_bench):
    lostmotion_bench.until(state="ramp_pos", after_scans=300)
    lostmotion_bench.inject("io.guard", "open")
    with pytest.raises(pytest.fail.Exception) as failed:
        lostmotion_bench.until(state="complete")
    said = str(failed.value)
    assert said.startswith("until state complete never came: the run ended in fault")
    for word in ("io.guard open at scan", "guard_open at scan", "quick_stop at scan", "disable_voltage at scan"):
        assert word in said
    assert "ramp_pos at scan" in said


def test_until_more_scans_than_a_state_lasts_fails_where_it_is_left(lostmotion_bench):
    lostmotion_bench.until(state="home")
    with pytest.raises(
        pytest.fail.Exception, match="until state home, after_scans 5000 never came: home was left for lock"
    ):
        lostmotion_bench.until(state="home", after_scans=5000)
    assert lostmotion_bench.state == "lock", "nothing goes on after that"


def test_until_the_end_of_time_fails_too(lostmotion_bench, monkeypatch):
    monkeypatch.setattr(bench_under_test, "LONGEST_RUN_S", 1.0)
    lostmotion_bench.until(state="lock")
    with pytest.raises(pytest.fail.Exception, match="1 s later the run is in lock"):
        lostmotion_bench.until(state="lock", after_scans=1_000_000)


MINE = """
def test_mine(lostmotion_bench):
    lostmotion_bench.until(state="lock")
    lostmotion_bench.inject("io.guard", "open")
    lostmotion_bench.until(state="complete")


def test_verb(lostmotion_bench):
    lostmotion_bench.inject("io.guard", "oppen")


def test_expectation(lostmotion_bench):
    lostmotion_bench.until(state="lock")
    lostmotion_bench.inject("io.guard", "open")
    lostmotion_bench.expect(reaction="power_off", within_scans=0)


import pytest


@pytest.mark.lostmotion(recpe="rv-40e-121-faults")
def test_name(lostmotion_bench):
    pass


@pytest.mark.lostmotion("rv-40e-121-faults")
def test_without_name(lostmotion_bench):
    pass


@pytest.mark.lostmotion(recipe="nowhere.yaml")
def test_recipe(lostmotion_bench):
    pass


@pytest.mark.lostmotion(unit="P9")
def test_unit(lostmotion_bench):
    pass


def test_old_name(bench):
    pass
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What pytest says of such a file in a folder outside of the project: the plug-in comes with the package."""
    folder = tmp_path_factory.mktemp("mine")
    (folder / "test_mine.py").write_text(MINE.lstrip(), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "test_mine.py"]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder).stdout


def test_a_failure_is_shown_at_the_line_of_the_test(said):
    assert "test_mine.py:4: Failed" in said
    assert "test_mine.py:8: ValueError" in said
    assert "ValueError: test_mine.py:8:5: verb: found 'oppen'" in said
    assert "test_mine.py:14: Failed" in said
    assert "reactions were: quick_stop at scan" in said
    assert "bench_under_test.py" not in said.partition("FAILURES")[2].replace("BenchUnderTest object", "")
    assert "warning" not in said.lower()
    assert "3 failed" in said


def test_a_marker_that_cannot_be_followed_fails_its_test_and_says_what_is_allowed(said):
    assert "found 'recpe'; allowed: recipe, bench, unit or seed, each as NAME=VALUE" in said
    assert "found 'rv-40e-121-faults'; allowed: recipe" in said
    assert "nowhere.yaml:1:1: found no such file" in said
    assert "found 'P9', allowed P1" in said
    assert "Traceback" not in said
    assert "pytest_plugin.py" not in said
    assert "5 errors" in said, "these four and the one below"


def test_the_old_name_is_free_for_others(said):
    assert "fixture 'bench' not found" in said


def test_what_comes_after_the_end_fails_because_nothing_judges_it(lostmotion_bench):
    lostmotion_bench.until(state="home")
    lostmotion_bench.inject("io.guard", "open")
    lostmotion_bench.expect(event="guard_open", within_scans=12)
    lostmotion_bench.never(state="complete")
    for call in (
        lambda: lostmotion_bench.inject("io.estop", "trip"),
        lambda: lostmotion_bench.until(state="fault"),
        lambda: lostmotion_bench.order("acknowledge"),
        lostmotion_bench.go,
    ):
        with pytest.raises(pytest.fail.Exception, match="the run has ended"):
            call()


@pytest.mark.parametrize(
    ("call", "options", "words"),
    [
        ("inject", {"target": "io.gard", "verb": "open"}, "target: found 'io.gard'.*Did you mean 'io.guard'"),
        ("inject", {"target": "lock", "verb": "slip"}, "needs value"),
        ("inject", {"target": "lock", "verb": "slip", "value": "10 %"}, "value: found '10 %'.*without a unit"),
        ("inject", {"target": "lock", "verb": "slip", "value": 3.0}, "allowed: a number from 0 to 1"),
        ("inject", {"target": "io.guard", "verb": "open", "for_ms": "50 ms"}, "for_ms: found '50 ms'"),
        ("until", {"state": "lock", "after_scans": -1}, "after_scans: found -1"),
        ("until", {"state": "lock", "after_scans": 0.5}, "after_scans: found 0.5"),
        ("order", {"command": "halt"}, "command: found 'halt'.*allowed: start, stop"),
        ("order", {"command": "none"}, "command: found 'none'"),
        ("go", {"scans": 0}, "found 0 scans"),
        ("expect", {}, "found none of them"),
        ("expect", {"evnt": "estop", "within_scans": 3}, "unknown option 'evnt'.*Did you mean 'event'"),
        ("expect", {"event": "gard_open", "within_scans": 3}, "event: found 'gard_open'"),
        ("expect", {"order": "power_off", "within_scans": 3}, "which is a reaction.*disable_voltage"),
        ("never", {"event": "gard_open"}, "event: found 'gard_open'"),
    ],
)
def test_a_wrong_call_is_refused_in_one_line_and_nothing_has_moved(lostmotion_bench, call, options, words):
    with pytest.raises(ValueError, match=words) as refused:
        getattr(lostmotion_bench, call)(**options)
    assert len(str(refused.value).splitlines()) == 1
    assert not lostmotion_bench.run.scans
