"""Validity checks that look at torques: ratio and efficiency, the drive's torque, lines of another unit."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from check_support import FACTS, FIGURES, GOOD, KNOWN, P1, WANTED, judged, of
from reference_unit import RATIO, bench_trace

from analysis.evaluation.pipeline import analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.measured import measure
from analysis.loop.method import Method, MetricWanted
from analysis.torque_ratio.quadrants import Quadrants, TorqueLine
from analysis.trace.trace import Trace
from analysis.uncertainty.figures import TorqueFigures
from analysis.validity.torque_checks import FRICTION_DIFFERS, shown_lines, zeroes_shown_nm


def without(role: str) -> Trace:
    """The good run without the segments of a role."""
    kept = np.isin(GOOD.segment, [index for index, info in GOOD.segments.items() if info.role != role])
    names = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "temperature_c", "segment",
             "drive_torque_nm", "drive_angle_rad")  # fmt: skip
    return dataclasses.replace(GOOD, **{name: getattr(GOOD, name)[kept] for name in names})


def test_a_wrong_ratio_is_seen_by_the_torques() -> None:
    """A recipe with 141 instead of 121 makes the backlash read 14 % small, and nothing else shows it."""
    wrong = judged(method=dataclasses.replace(KNOWN, ratio=141.0))
    assert wrong.metrics[0].headline.value < 0.85
    assert wrong.verdict is Verdict.NOT_DECIDABLE
    (reason,) = [one for one in wrong.reasons if "measurement invalid" in one]
    assert "the lines of the calibration show a ratio of 121" in reason
    assert "where the recipe has 141" in reason


@pytest.mark.parametrize(("role", "where"), [("calibrate", "measured cycles"), ("unload", "calibration")])
def test_the_ratio_is_seen_with_and_without_a_calibration(role: str, where: str) -> None:
    right, wrong = (judged(without(role), dataclasses.replace(KNOWN, ratio=ratio)) for ratio in (RATIO, 141.0))
    assert of(right, "ratio_agreement").figure < 1.0
    assert of(right, "efficiency_low").figure == pytest.approx(100.0 * 94.689 / RATIO, abs=0.5)
    assert right.verdict is Verdict.PASS
    assert f"the lines of the {where} show a ratio of 121" in of(wrong, "ratio_agreement").text


def test_stored_lines_of_another_ratio_are_seen() -> None:
    """With one torque sensor the lines that convert its torque are all that knows the ratio."""
    lines = [TorqueLine(sign * c, m) for sign in (1, -1) for c, m in ((-13.9, 94.7), (24.8, 168.0))]
    stored = dataclasses.replace(KNOWN, output_torque="calibrated", quadrants=Quadrants(*lines), ratio=141.0)
    found = of(judged(dataclasses.replace(without("calibrate"), torque_out_nm=None), stored), "ratio_agreement")
    assert found.passed is False
    assert "the torque ratio lines used for the conversion show a ratio of 121" in found.text


@pytest.mark.parametrize("torque", ["reaction", "calibrated"])
@pytest.mark.parametrize("role", ["calibrate", "unload"])
def test_a_zero_of_the_output_sensor_is_seen_where_the_torque_lines_meet(role: str, torque: str) -> None:
    """10 N·m at zero torque move the width by 4.6 times its uncertainty, and what the tare may leave by none of it."""
    trace, method = without(role), dataclasses.replace(KNOWN, output_torque=torque)
    if role == "calibrate" and torque == "calibrated":
        method = dataclasses.replace(method, quadrants=judged(GOOD, method).quadrants)
    for off_nm in (0.0, 0.2, -10.0, 10.0):
        result = judged(dataclasses.replace(trace, torque_out_nm=trace.torque_out_nm + off_nm), method)
        found = of(result, "torque_out_zero")
        assert found.figure == pytest.approx(max(0.0, 100.0 * (abs(off_nm) - 0.2) / 412.0), abs=0.1)
        assert found.passed is (abs(off_nm) < 1.0)
        assert result.verdict is (Verdict.PASS if found.passed else Verdict.NOT_DECIDABLE)
    assert "meet where the output torque reads +" in found.text
    assert "0.2 N·m are declared for its zero" in found.text


def test_a_larger_zero_may_be_declared() -> None:
    """What is declared of the sensor's zero is in the uncertainty, and no fault of the measurement."""
    off = dataclasses.replace(GOOD, torque_out_nm=GOOD.torque_out_nm + 4.0)
    declared = dataclasses.replace(FIGURES, torque_out=TorqueFigures(1000.0, zero_fraction=0.005))
    assert of(judged(off), "torque_out_zero").passed is False
    wider = analyse(off, KNOWN, WANTED, facts=FACTS, figures=declared)
    assert of(wider, "torque_out_zero").figure == 0.0


def test_a_zero_of_the_input_sensor_moves_no_output_torque() -> None:
    """It moves all four lines along the input torque, and where they meet not up or down."""
    off = judged(dataclasses.replace(GOOD, torque_in_nm=GOOD.torque_in_nm + 0.05))
    assert of(off, "torque_out_zero").figure < 0.1


def zeroes_off(out_nm: float, in_nm: float, method: Method = KNOWN) -> tuple[dict[str, float], dict[str, float]]:
    """What is shown of zeroes that are off; and the largest that each can be, by the lines alone."""
    moved = {"torque_out_nm": GOOD.torque_out_nm + out_nm, "torque_in_nm": GOOD.torque_in_nm + in_nm}
    found = measure(dataclasses.replace(GOOD, **moved), method)
    (lines, _) = shown_lines(found)
    told = {"torque_out_nm": lines.zero_nm, "torque_in_nm": lines.zero_in_nm}
    besides_nm = {"torque_out_nm": 0.0, "torque_in_nm": FRICTION_DIFFERS / 2.0 * lines.idle_nm}
    most = {name: abs(zero.value) + zero.expanded + besides_nm[name] for name, zero in told.items()}
    return zeroes_shown_nm(found, FIGURES), most


def test_a_zero_that_is_shown_counts_with_all_that_it_can_be() -> None:
    shown, most = zeroes_off(1.5, 0.004)
    assert shown == pytest.approx(most, rel=1e-6)
    assert shown["torque_out_nm"] > 1.5, "the lines alone show a little less than it is"
    assert shown["torque_in_nm"] > 0.006, "friction that differs between the directions would hide 0.002 N·m"


def test_what_friction_that_differs_between_the_directions_makes_is_no_zero_of_the_input() -> None:
    """0.001 N·m are declared and 0.0002 N·m is the scatter of the lines: friction makes up to 0.0022 N·m besides."""
    assert zeroes_off(0.0, 0.0025)[0] == {}
    assert set(zeroes_off(0.0, 0.0037)[0]) == {"torque_in_nm"}


def test_of_a_locked_input_no_zero_is_shown() -> None:
    """Its lines do not meet where there is no load."""
    assert set(zeroes_off(1.5, 0.05)[0]) == {"torque_out_nm", "torque_in_nm"}
    assert zeroes_off(1.5, 0.05, dataclasses.replace(KNOWN, loading="output"))[0] == {}


def test_a_tight_or_worn_unit_has_the_same_ratio() -> None:
    """A bad unit fails by its metrics: friction moves neither its ratio nor, for the shipped window, its efficiency."""
    limits = {"efficiency_low": 70.0, "efficiency_high": 86.0}
    for friction, slope in ((2.0, 1.0), (1.0, 0.8), (1.0, 1.2)):
        unit = dataclasses.replace(
            P1, input_friction_nm=friction * P1.input_friction_nm, input_friction_slope=slope * P1.input_friction_slope
        )
        result = judged(bench_trace(unit, 453.2), dataclasses.replace(KNOWN, check_limits=limits))
        assert [one.id for one in result.checks if one.passed is False] == []


def test_at_a_locked_input_the_efficiency_is_not_measured() -> None:
    swapped = dataclasses.replace(GOOD, angle_in_rad=-GOOD.angle_in_rad, angle_out_rad=-GOOD.angle_out_rad)
    result = judged(swapped, dataclasses.replace(KNOWN, loading="output"))
    assert of(result, "efficiency_low").passed is None
    assert of(result, "ratio_agreement").figure < 1.0


def test_a_gearbox_before_the_sensor_does_not_look_like_a_gain() -> None:
    """What it takes while loading it gives back while unloading; its friction has no place in the gap."""
    losses = np.sign(np.gradient(GOOD.torque_out_nm)) * (1.0 + 0.1 * np.abs(GOOD.torque_out_nm))
    by_output = {"angle_in_rad": -GOOD.angle_in_rad, "angle_out_rad": -GOOD.angle_out_rad}
    geared = dataclasses.replace(GOOD, drive_torque_nm=GOOD.torque_out_nm + losses, **by_output)
    result = judged(geared, dataclasses.replace(KNOWN, loading="output"))
    assert of(result, "drive_torque_agreement").figure < 1.0
    assert of(result, "drive_torque_gap").passed is None
    assert "gearbox" in of(result, "drive_torque_gap").text


def test_a_drive_that_reports_no_torque_agrees_with_nothing() -> None:
    result = judged(dataclasses.replace(GOOD, drive_torque_nm=np.zeros(GOOD.samples)))
    assert of(result, "drive_torque_agreement").figure == pytest.approx(100.0)
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_without_the_drive_its_gates_are_not_measured() -> None:
    result = judged(dataclasses.replace(GOOD, drive_torque_nm=None))
    for check in ("drive_torque_agreement", "drive_torque_gap"):
        assert of(result, check).passed is None
        assert "not measured: needs the torque that the drive reports in the trace" in of(result, check).text


@pytest.mark.parametrize("stands_at", [0.0, 3.0])
def test_an_output_sensor_that_stands_still_beside_a_converted_torque_is_seen(stands_at: float) -> None:
    """Its torque enters no metric then, and nothing else tells: at 0 N·m the program failed, at 3 N·m it passed."""
    lines = [TorqueLine(sign * c, m) for sign in (1, -1) for c, m in ((-13.9, 94.7), (24.8, 168.0))]
    stored = dataclasses.replace(KNOWN, output_torque="calibrated", quadrants=Quadrants(*lines))
    trace = without("calibrate")
    assert judged(trace, stored).verdict is Verdict.PASS
    dead = judged(dataclasses.replace(trace, torque_out_nm=np.full(trace.samples, stands_at)), stored)
    assert of(dead, "torque_agreement").passed is False
    assert dead.verdict is Verdict.NOT_DECIDABLE


def test_what_passes_by_the_torque_ratio_of_another_unit_alone_is_not_decided() -> None:
    """Lines of a unit with twice the friction make the play of a worn unit read small; the output sensor shows it."""
    lines = [TorqueLine(sign * c, m) for sign in (1, -1) for c, m in ((-27.0, 94.7), (48.0, 168.0))]
    stored = dataclasses.replace(KNOWN, output_torque="calibrated", quadrants=Quadrants(*lines))
    trace, limit = without("calibrate"), MetricWanted("backlash_width_3pct", max=0.8)
    alone = analyse(dataclasses.replace(trace, torque_out_nm=None), stored, [limit], facts=FACTS, figures=FIGURES)
    assert alone.verdict is Verdict.PASS
    shown = analyse(trace, stored, [limit], facts=FACTS, figures=FIGURES)
    assert shown.verdict is Verdict.NOT_DECIDABLE
    assert "backlash_width_3pct, side +: " in shown.reasons[0]
    figure = re.search(r"With the torque measured at the output it is (0\.\d+) arcmin", shown.reasons[0])
    assert figure is not None
    assert float(figure[1]) == pytest.approx(0.94, abs=5e-3)
    assert "output_torque: reaction" in shown.reasons[0]
    wider = analyse(trace, stored, [dataclasses.replace(limit, max=1.1)], facts=FACTS, figures=FIGURES)
    assert wider.verdict is Verdict.PASS
