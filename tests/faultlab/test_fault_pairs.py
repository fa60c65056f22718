"""Pairs of faults are drawn the same again, and judged by the plant and by a run without faults."""

from __future__ import annotations

import json

import pytest
from lostmotion_command import here

from faultlab.pairs.draw import DRAWN, SIZES, pair_of
from faultlab.pairs.judge import clean, measure
from station.cli.faults.pairs import wrong_text
from virtual_bench.faults.scenario import Fault, Header, Scenario, When
from virtual_bench.faults.vocabulary import FAULTS, ONLY_OVER_WIRES


def one_fault(target: str, verb: str, value: float | None, state: str) -> Scenario:
    fault = Fault(target=target, verb=verb, value=value, when=When(state=state))
    return Scenario(scenario=Header(name="one"), faults=(fault,))


def test_every_fault_of_virtual_time_is_drawn_and_each_value_has_a_size() -> None:
    assert set(DRAWN) == set(FAULTS) - ONLY_OVER_WIRES
    assert set(SIZES) == {key for key in DRAWN if FAULTS[key].value}
    for key, size in SIZES.items():
        assert 0.0 < size.low <= size.high
        assert size.around is not None or size.low >= FAULTS[key].low
        assert size.around is not None or size.high <= FAULTS[key].high


def test_the_same_numbers_draw_the_same_pair() -> None:
    drawn = [pair_of(seed, number) for seed in (1, 2) for number in range(100)]
    assert drawn == [pair_of(seed, number) for seed in (1, 2) for number in range(100)]
    assert len({pair.model_dump_json() for pair in drawn}) == len(drawn)
    assert all(len({(fault.target, fault.verb) for fault in pair.faults}) == 2 for pair in drawn)


@pytest.mark.parametrize(
    ("target", "verb", "value", "state"),
    [
        ("sensor.angle_in", "noise", 0.2e-3, "home"),
        ("sensor.angle_out", "lag", 0.253, "home"),
    ],
)
def test_what_once_passed_with_a_wrong_value_is_refused_or_in_its_uncertainty(
    target: str, verb: str, value: float, state: str
) -> None:
    found = measure(one_fault(target, verb, value, state))
    assert found.state == "complete"
    assert found.wrong == ()
    assert found.verdict == "NOT DECIDABLE" or 0.05 < found.largest_en <= 1.0


def test_an_angle_that_lags_for_a_part_of_a_cycle_is_seen_by_the_drive() -> None:
    # 2.5 ms for 3.9 s: the backlash was off by 2.6 of its U, and the verdict PASS.
    found = measure(pair_of(7, 18))
    assert found.verdict == "NOT DECIDABLE"


def test_a_gain_that_changes_after_the_calibration_is_seen_by_its_torques() -> None:
    # 1.5 %: the wind-up was off by 1.2 % with a U of 0.1 %, and the verdict PASS.
    found = measure(pair_of(12, 80))
    assert found.verdict == "NOT DECIDABLE"


def test_a_verdict_on_a_value_that_is_not_true_is_wrong() -> None:
    # No run can tell the gain of a sensor: the bench's master part does.
    found = measure(one_fault("sensor.torque_out", "scale", 1.005, "lock"))
    assert found.verdict == "PASS"
    assert "windup" in found.verdict_wrong
    assert found.wrong


def test_a_sensor_without_a_number_ends_the_run_with_a_result() -> None:
    found = measure(one_fault("sensor.torque_out", "nan", None, "ramp_pos"))
    assert (found.state, found.alarm, found.verdict) == ("fault", "sensor_not_a_number", "NOT DECIDABLE")


def test_the_command_says_each_pair() -> None:
    ran = here("faults", "pairs", "--seed", "1", "--first", "41", "--count", "1", "--workers", "1", "--json")
    assert ran.exit_code == 0
    (one,) = json.loads(ran.out)["pairs"]
    assert one["number"] == 41
    assert one["peak_nm"] > 0.0
    assert len(one["faults"]) == 2
    assert set(clean()) >= {"backlash_width_3pct", "windup"}


def test_how_many_pairs_are_wrong_is_no_number_of_a_pair() -> None:
    assert wrong_text([0]) == "1 (pair 0)"
    assert wrong_text([3, 17]) == "2 (pairs 3, 17)"
    assert wrong_text([]) == "none"
