"""A fixture stated by its parts: what it does at the output follows with the ratio, and the unit keeps its own loop."""

from __future__ import annotations

import dataclasses

import pytest
from printed_numbers import reads
from reference_unit import ARC, RATIO, ReferenceUnit, exact_trace

from analysis.evaluation.pipeline import analyse
from analysis.loop.fixture_curve import compensated_stiffness
from analysis.loop.method import Method, MetricWanted
from analysis.trace.trace import Trace
from recipes import Bench, check, find_recipe, load_recipe, parse_bench, shipped_benches
from station.bench.assemble_virtual import virtual_config
from station.bench.figures import fixture_of
from station.bench.request import DRIVER_PROFILES
from station.bench.virtual_unit import VirtualUnit
from station.results.evaluation import method_of

P1 = ReferenceUnit()
OUTPUT, AT_INPUT = 2000.0, 0.3
WHOLE = 1 / (1 / OUTPUT + 1 / (AT_INPUT * RATIO**2))
WANTED = [MetricWanted("spring_constant"), MetricWanted("lost_motion"), MetricWanted("backlash_width_3pct")]
PROFILES = {path.stem: path for path in DRIVER_PROFILES.glob("*.yaml")}


def bench(name: str = "virtual", **changes: str) -> Bench:
    """A shipped bench whose fixture is stated by its parts."""
    text = shipped_benches()[name].read_text(encoding="utf-8")
    parts = f"parts: {{output: {OUTPUT} N·m/arcmin, input: {AT_INPUT} N·m/arcmin}} "
    for old, new in {"stiffness: 10000 N·m/arcmin ": parts, **changes}.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    return parse_bench(text.encode(), "b.yaml")


def method() -> Method:
    return method_of(load_recipe(find_recipe("rv-40e-121-inverse")), bench())


def on_parts() -> Trace:
    """P1 on a soft lock and a soft coupling: the output turns by T/K_1, the coupling twists by (T/i)/K_i."""
    exact = exact_trace(P1, 480.0)
    torque = exact.torque_out_nm
    at_output = exact.angle_out_rad + torque / OUTPUT * ARC
    twist = torque / RATIO / AT_INPUT * ARC
    return dataclasses.replace(exact, angle_in_rad=at_output * RATIO + twist, angle_out_rad=None)


def test_the_unit_has_its_own_stiffness_and_lost_motion_behind_the_parts() -> None:
    found = [metric.headline.value for metric in analyse(on_parts(), method(), WANTED).metrics]
    assert found == pytest.approx([115.170, 0.3756, 0.9400], abs=5e-4)
    stiff = dataclasses.replace(method(), fixture_stiffness_nm_per_arcmin=1e9)
    read = analyse(on_parts(), stiff, WANTED).metrics[0].headline.value
    assert read == pytest.approx(1 / (1 / 115.170 + 1 / WHOLE), rel=1e-4)
    assert compensated_stiffness(read, OUTPUT, AT_INPUT, RATIO) == pytest.approx(115.170, rel=1e-4)


def test_the_part_at_the_input_counts_by_the_ratio_of_the_unit() -> None:
    assert fixture_of(bench(), RATIO) == (pytest.approx(WHOLE), OUTPUT)
    assert fixture_of(bench(), 81.0)[0] == pytest.approx(1 / (1 / OUTPUT + 1 / (AT_INPUT * 81**2)))
    assert method().fixture_stiffness_nm_per_arcmin == pytest.approx(WHOLE)


def test_the_locked_side_is_that_of_the_shaft_that_the_servo_does_not_load() -> None:
    assert fixture_of(bench("virtual-output"), RATIO)[1] == pytest.approx(AT_INPUT * RATIO**2)
    shipped = parse_bench(shipped_benches()["virtual"].read_bytes(), "b.yaml")
    assert fixture_of(shipped, RATIO) == (10_000.0, None)


def test_the_slip_that_is_allowed_looks_at_the_lock_alone() -> None:
    """453.2 N·m turn a lock of 2000 N·m/arcmin by 0.2266 arcmin; the coupling at the input is no slip."""
    recipe = load_recipe(find_recipe("rv-40e-121-inverse"))
    soft = {"output: 2000.0": "output: 800.0"}
    assert check(recipe, bench()) == []
    (problem,) = check(recipe, bench(**soft))
    assert problem.option == "interlocks.lock_slip"
    assert reads(problem.allowed, "above 0.566 arcmin")


@pytest.mark.parametrize(("name", "stiffness"), [("virtual", OUTPUT), ("virtual-output", AT_INPUT)])
def test_the_virtual_lock_gives_way_as_its_part(name: str, stiffness: float) -> None:
    assert virtual_config(
        bench(name), PROFILES, VirtualUnit("P1", seed=1)
    ).fixture_stiffness_nm_per_arcmin == pytest.approx(stiffness)
