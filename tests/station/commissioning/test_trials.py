"""What small runs tell: lags of signals that are known, and signs and gains in runs by the controller itself.

The runs are made in virtual time: the same recipe, controller and physics as over wires.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lostmotion_command import here
from patient import QUICK_RECIPE

from station.bench.request import Source
from station.commissioning import direction, latency, tune
from station.commissioning.on_wires import OnWires
from station.commissioning.trial_run import Plan, Tried, trial_job
from station.documents.reading import read_document
from station.documents.result import Result
from station.records.run_record import RESULT, RunRecord
from station.records.samples.check import sound_table
from station.records.samples.samples import samples_bytes

VIRTUAL = Path(__file__).parents[3] / "recipes" / "benches" / "virtual.yaml"


def bench_of(source: Path) -> OnWires:
    read = Source.read(source)
    return OnWires(read, read.bench())


@pytest.fixture(scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory):
    """Make the small run of a plan on the virtual bench in virtual time, with a fault of a sensor if one is named."""
    folder = tmp_path_factory.mktemp("small-runs")

    def run(plan: Plan, fault: str = "") -> Tried:
        job = trial_job(bench_of(VIRTUAL), str(QUICK_RECIPE), plan)
        files = {"recipe.yaml": job.recipe_source.content, "bench.yaml": job.bench_source.content}
        for name, content in files.items():
            (folder / name).write_bytes(content)
        words = ["run", str(folder / "recipe.yaml"), "--bench", str(folder / "bench.yaml"), "--virtual-time", "--json"]
        if fault:
            scenario = f"scenario: {{name: sensor}}\nfaults: [{{{fault}, when: {{time_s: 0.0}}}}]\n"
            (folder / "scenario.yaml").write_text(scenario, encoding="utf-8")
            words += ["--scenario", str(folder / "scenario.yaml")]
        ran = here(*words, "--no-report", "--data", str(folder / "runs"))
        record = RunRecord(ran.record)
        table = sound_table(samples_bytes(record), record.layout())
        return Tried(job, record, read_document(Result, record.folder / RESULT), table)

    return run


SCALE_OF = bench_of(VIRTUAL).scale_of
TURNED = {"angle_in": "angle_in_rad", "torque_in": "torque_in_nm", "torque_out": "torque_out_nm"}


@pytest.mark.parametrize("sensor", [None, *TURNED])
def test_the_channel_that_counts_the_wrong_way_is_named(small_run, sensor: str | None) -> None:
    tried = small_run(direction.PLAN, f"target: sensor.{sensor}, verb: flip" if sensor else "")
    findings = direction.judged(tried, direction.look(tried), SCALE_OF)
    refusing = [finding for finding in findings if finding.refuses]
    assert [TURNED[sensor] in finding.what for finding in refusing] == [True] if sensor else not refusing, refusing
    if sensor:
        assert "Write 'scale: -" in refusing[0].cure


def test_a_motor_the_other_way_round_is_not_taken_for_three_wrong_sensors(small_run) -> None:
    tried = small_run(direction.PLAN)
    turned = [one._replace(sign=-one.sign) if "drive" in one.against else one for one in direction.look(tried)]
    assert turned[0].against == "torque_out_nm"
    turned[0] = turned[0]._replace(sign=-1)  # that torque comes the other way
    (finding,) = [one for one in direction.judged(tried, turned, SCALE_OF) if one.refuses]
    assert "reversed: true" in finding.cure


def test_a_scale_that_is_wrong_by_much_is_told(small_run) -> None:
    tried = small_run(direction.PLAN)
    seen = [one._replace(slope=57.3) if one.channel == "angle_in_rad" else one for one in direction.look(tried)]
    (finding,) = [one for one in direction.judged(tried, seen, SCALE_OF) if one.refuses]
    assert "gear_ratio" in finding.cure


@pytest.mark.parametrize("late", [-7, 0, 3, 20])
def test_the_lag_of_a_signal_is_found_to_a_part_of_a_scan(late: int) -> None:
    times = np.arange(3000.0)
    signal = np.interp(times, [0, 500, 700, 1500, 1900, 3000], [0, 0, 10, 10, -10, -10])
    noise = np.random.default_rng(1).normal(0.0, 0.005, (2, times.size))
    follows = np.interp(times - late, times, signal)
    assert latency.lag_scans(signal + noise[0], -3.0 * -follows + noise[1], 100) == pytest.approx(late, abs=0.5)


def test_signals_that_have_nothing_to_do_with_each_other_have_no_lag() -> None:
    noise = np.random.default_rng(2).normal(0.0, 1.0, (2, 3000))
    assert latency.lag_scans(noise[0], noise[1], 100) is None


def test_lags_and_ages_of_a_sound_bench_are_those_of_its_file_and_another_filter_is_found(small_run) -> None:
    tried = small_run(latency.PLAN)
    assert latency.judged(tried, latency.ages(tried), latency.lags(tried)) == ()
    slow = small_run(latency.PLAN, "target: sensor.torque_out, verb: lag, value: 0.02")
    (finding,) = latency.judged(slow, latency.ages(slow), latency.lags(slow))
    assert "sensors.torque_out.lag" in finding.cure


def test_a_gain_is_right_when_twice_of_it_is_quiet_too_and_halved_until_one_is(small_run) -> None:
    sound = small_run(tune.PLAN)
    loud = small_run(replace(tune.PLAN, gain_per_s=150.0))
    assert tune.setback(sound) < tune.QUIET < tune.setback(loud)

    def found(quiet_up_to: float, gain: float) -> tune.Tuned:
        return tune.tune(gain, lambda plan: sound if (plan.gain_per_s or 0.0) <= quiet_up_to else loud)

    assert [step.gain_per_s for step in found(40.0, 15.0).steps] == [15.0, 30.0]
    assert tune.judged(15.0, found(40.0, 15.0)) == ()
    assert found(20.0, 15.0).proposed_per_s == 7.5
    assert found(40.0, 150.0).proposed_per_s == 150.0 / 8
    assert found(0.0, 150.0).proposed_per_s is None
    assert [finding.refuses for finding in tune.judged(150.0, found(40.0, 150.0))] == [True]
