"""Bench files that say where each channel comes from: what contradicts itself is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from recipes import RecipeError, load_bench, parse_bench

FOLDER = Path(__file__).parents[1] / "data" / "benches"
BENCH = (FOLDER / "two-amplifiers.yaml").read_text(encoding="utf-8")
AMPLIFIER = "amplifier: {transport: tcp, host: a, unit_id: 1, profile: one, poll_every: 1 ms, timeout: 5 ms}"

CASES = {
    "no such device": ("angle_in: {device: angles", "angle_in: {device: angels", "found 'angels'; allowed: torques or"),
    "counter that is not named": (", alive: counter, alive_field: cycle", ", alive: counter", "without alive_field"),
    "noise without a time": ("alive: time_stamp", "alive: noise", "alive: noise with still"),
    "a time without noise": ("input_stamp}", "input_stamp, still: 5 ms}", "with alive: noise only"),
    "a proof that is not asked for": ("alive: time_stamp", "alive: arrival", "alive: arrival with alive_field"),
    "nothing of the sensor": ("scale: -1, offset: 0.001", "scale: 0", "any other number; a negative scale reverses"),
    "a sensor without source": ("  angle_out: {device", "  # {device", "angle_out in sensors alone"),
    "two of one name": ("name: angles,", "name: torques,", "a name that no other device has"),
    "a name of the bench": ("name: angles,", "name: brake,", "a name that no other device has"),
    "an amplifier besides": ("remote_io:", AMPLIFIER + "\nremote_io:", "both amplifier and channels"),
    "devices that measure nothing": ("channels:\n", "pace: {port: 1}\nx:\n", "unknown option .x."),
}


@pytest.mark.parametrize(("old", "new", "expected"), CASES.values(), ids=CASES)
def test_wrong_channels(old: str, new: str, expected: str) -> None:
    assert old in BENCH
    with pytest.raises(RecipeError, match=expected.replace("(", "\\(")):
        parse_bench(BENCH.replace(old, new, 1).encode(), "bench.yaml")


def test_channels_measured_each_in_its_time_have_a_skew_of_the_slowest() -> None:
    bench = load_bench(FOLDER / "two-amplifiers.yaml")
    assert bench.sample_every_s == pytest.approx(0.5e-3)
    assert bench.sample_every(1e-3) == pytest.approx(2e-3), "two blocks of one device, one after the other"
    assert bench.skew(1e-3) == pytest.approx(bench.sensors.skew_s + 2e-3)
    one_sample = BENCH.replace("input_stamp", "cycle").replace("output_stamp", "cycle")
    one_sample = one_sample.replace("time_stamp", "counter").replace("{device: angles", "{device: torques")
    together = parse_bench(one_sample.encode(), "bench.yaml")
    assert together.skew(1e-3) == together.sensors.skew_s, "a shared counter is one sample"


def test_what_answers_sync_was_measured_at_sync_whatever_the_period() -> None:
    bench = load_bench(FOLDER / "can-sensors.yaml")
    for period_s in (1e-3, 4e-3):
        assert bench.skew(period_s) == pytest.approx(bench.sensors.skew_s + 1e-3), "the flange sends every millisecond"
        assert bench.unasked_delay("torque_out", period_s) == pytest.approx(0.5e-3)
        assert bench.unasked_delay("angle_out", period_s) == 0.0, "of SYNC the record knows"
    assert bench.unasked_delay("torque_in", 0.5e-3) == pytest.approx(0.25e-3), "a scan takes the newest"
