"""Every metric of three cycles of 600 000 samples comes out in little memory."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

PLACE = Path(__file__).parents[3] / "benchmarks" / "analysis_speed.py"
SPEC = importlib.util.spec_from_file_location("analysis_speed", PLACE)
speed = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(speed)


def test_three_long_cycles_in_little_memory() -> None:
    found = speed.measure()
    assert found.peak_bytes < 10 * found.trace_bytes
    assert all(metric.headline.value is not None for metric in found.result.metrics)
    assert speed.value(found.result, "hysteresis_energy") == pytest.approx(440, rel=0.05)
