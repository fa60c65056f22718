"""Where nothing was calibrated, the metrics of the torque ratio come from the measured cycles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from check_support import GOOD, METHOD

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from analysis.trace.trace import Trace

WANTED = [MetricWanted("torque_ratio_slope"), MetricWanted("torque_ratio_offset", min=-100.0)]


def without_calibration() -> Trace:
    keep = np.isin(GOOD.segment, [key for key, one in GOOD.segments.items() if one.role != "calibrate"])
    fields = {one.name: getattr(GOOD, one.name) for one in dataclasses.fields(Trace)}
    return Trace(**{name: value[keep] if isinstance(value, np.ndarray) else value for name, value in fields.items()})


def test_slope_and_offset_are_those_of_the_calibration() -> None:
    calibrated, cycles = analyse(GOOD, METHOD, WANTED), analyse(without_calibration(), METHOD, WANTED)
    for one, other in zip(calibrated.metrics, cycles.metrics, strict=True):
        assert other.headline.value == pytest.approx(one.headline.value, rel=0.01)
    assert "of the measured cycles" in " ".join(cycles.notes)
    assert "of the measured cycles" not in " ".join(calibrated.notes)
    assert cycles.quadrants is not None


def test_without_the_input_torque_a_limit_decides_nothing() -> None:
    alone = dataclasses.replace(without_calibration(), torque_in_nm=None)
    result = analyse(alone, METHOD, WANTED)
    assert result.verdict.value == "NOT DECIDABLE"
    assert any("torque_in_nm" in reason for reason in result.reasons)
