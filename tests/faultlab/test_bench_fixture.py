"""The examples of the documentation run as they stand, and a test that should fail does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

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


def test_the_fixture_is_there(bench):
    assert bench.until(state="home").state == 1
    assert bench.state == "home"


def test_what_does_not_hold_fails(bench):
    bench.until(state="lock")
    bench.inject("io.guard", "open")
    with pytest.raises(pytest.fail.Exception, match="expected final_state complete: was fault"):
        bench.expect(final_state="complete")


@pytest.mark.parametrize(("target", "verb", "value"), [("machine.disk", "full", None), ("can.bus", "errors", 5.0)])
def test_a_fault_that_needs_wires_is_refused_in_virtual_time(bench, target, verb, value):
    with pytest.raises(ValueError, match=f"{target} {verb} acts over wires only.*faults run FILE --wires"):
        bench.inject(target, verb, value)


def test_an_unknown_fault_or_state_is_refused_with_what_is_allowed(bench):
    with pytest.raises(ValueError, match="allowed open"):
        bench.inject("io.guard", "close")
    with pytest.raises(ValueError, match="allowed idle"):
        bench.until(state="ramp")
