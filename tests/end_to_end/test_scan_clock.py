"""The bench that waits, over real wires: the same samples every time, faults in its time, and who may not use it."""

from __future__ import annotations

from pathlib import Path

import pytest
from patient import brisk_recipe
from run_samples import digest_of

pytestmark = pytest.mark.wires


def words(folder: Path, period: str) -> tuple[str, ...]:
    """Words for `lostmotion run`: a recipe through every state, as shipped in all that is about time; no report."""
    recipe = brisk_recipe(folder, {"sampling": {"period": period}})
    return (str(recipe), "--no-report", "--json", "--pace", "fast", "--seed", "1")


@pytest.fixture
def short(tmp_path: Path) -> tuple[str, ...]:
    return words(tmp_path, "1 ms")


def faults(folder: Path, name: str, *rows: str) -> str:
    path = folder / f"{name}.yaml"
    path.write_text(
        f"scenario: {{name: {name}}}\nfaults:\n" + "".join(f"  - {{{row}}}\n" for row in rows), encoding="utf-8"
    )
    return str(path)


def test_the_same_unit_gives_the_same_samples_and_the_result_names_the_clock(lostmotion, tmp_path):
    ran = [lostmotion("run", *words(tmp_path, "4 ms"), "--serial", "S") for _ in range(2)]
    assert len({digest_of(one.record) for one in ran}) == 1
    for one in ran:
        result = one.json
        assert (result["state"], result["clock"], result["timing"]["clock"]) == ("complete", "scan", "scan")
        assert result["timing"]["missed"] == 0
        pace = result["timing"]["pace"]
        assert (pace["unit"], pace["unanswered"], pace["fast"]) == ("P1", 0, True)
        (gate,) = [gate for gate in result["gates"] if gate["id"] == "missed_periods"]
        assert gate["passed"] is None


BORNE = (
    "target: can.drive.tpdo1, verb: drop, value: 0.3, when: {state: lock, after_scans: 10}, for_ms: 100",
    "target: can.sync, verb: drop, value: 0.3, when: {state: lock, after_scans: 120}, for_ms: 100",
    "target: can.drive.tpdo1, verb: jitter, value: 4, when: {state: lock, after_scans: 230}, for_ms: 100",
    "target: modbus.amplifier, verb: slow, value: 3, when: {state: lock, after_scans: 340}, for_ms: 100",
    "target: modbus.amplifier, verb: jitter, value: 4, when: {state: lock, after_scans: 450}, for_ms: 100",
    "target: modbus.amplifier, verb: split, when: {state: lock, after_scans: 560}, for_ms: 100",
    "target: modbus.brake, verb: truncate, when: {state: lock, after_scans: 670}, for_ms: 30",
    "target: modbus.remote_io, verb: silence, when: {state: lock, after_scans: 710}, for_ms: 30",
    "target: scan.overrun, verb: miss, value: 3, when: {state: lock, after_scans: 750}",
    "target: can.bus, verb: cut, when: {state: calibrate, after_scans: 100}",
)
"""Faults of the wires one after the other: all are borne but the last."""


def test_faults_act_in_the_time_of_the_bench_and_nobody_waits_for_what_cannot_come(lostmotion, short, tmp_path):
    scenario = faults(tmp_path, "disturbed", *BORNE)
    ran = [lostmotion("run", *short, "--serial", "F", "--scenario", scenario) for _ in range(2)]
    assert len({digest_of(one.record) for one in ran}) == 1
    result = ran[0].json
    assert [alarm["id"] for alarm in result["alarms"]][:1] == ["can_lost"]
    assert (result["timing"]["pace"]["unanswered"], result["timing"]["missed"]) == (0, 3)
    bench_log = (ran[0].record / "virtual-bench.jsonl").read_text(encoding="utf-8")
    assert bench_log.count('"fault_acted"') == len(BORNE)
    assert "pace_missing" not in bench_log
