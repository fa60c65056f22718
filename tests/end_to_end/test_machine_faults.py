"""The shipped scenarios of the machine's faults over wires: killed scan or supervisor, full disk, clock that is set."""

from __future__ import annotations

import csv
import json
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from patient import EVERY_STATE, ROOT, patient_bench, patient_scenario, short_recipe, wrong_verdict
from run_samples import read_back

from station.cli.faults import faults as command_faults
from station.cli.runs.replay import replay_run

pytestmark = [pytest.mark.wires, pytest.mark.long]

IN_CALIBRATION = {
    "sampling": {"period": "4 ms"},
    "sequence": [
        *EVERY_STATE["sequence"][:2],
        {"calibrate": {"peak_torque": "30 %", "torque_rate": "120 N·m/s", "dwell": "20 ms"}},
        *EVERY_STATE["sequence"][3:],
    ],
}
"""The calibration, in which the scenarios act, takes seconds: a process that comes late still finds it under torque."""


class Held:
    """A scenario that held: what the command said, and what its record has."""

    def __init__(self, said: dict[str, Any]) -> None:
        self.said = said
        self.record = Path(said["record"])
        self.result = json.loads((self.record / "result.json").read_bytes())
        self.manifest = json.loads((self.record / "run.json").read_bytes())
        self.bench_log = [json.loads(line) for line in (self.record / "virtual-bench.jsonl").read_text().splitlines()]

    def torque_when_it_acted_nm(self) -> float:
        (acted_ns,) = [line["clock_ns"] for line in self.bench_log if line["event"] == "fault_acted"]
        with (self.record / "truth.csv").open(newline="") as stream:
            rows = [(int(row["clock_ns"]), float(row["reducer_torque_nm"])) for row in csv.DictReader(stream)]
        return min(rows, key=lambda row: abs(row[0] - acted_ns))[1]


def held(name: str, data: Path, capsys: pytest.CaptureFixture[str]) -> Held:
    """Run a shipped scenario with more time for all that it expects; it must hold, and its record replay."""
    recipe, bench = short_recipe(data, IN_CALIBRATION), patient_bench(data)
    how = command_faults.How(str(recipe), wires=True, bench=str(bench), data=data / "runs")
    code = command_faults.run(patient_scenario(ROOT / "scenarios" / f"{name}.yaml", data), how, as_json=True)
    said = json.loads(capsys.readouterr().out)
    assert (code, said["wrong"]) == (0, [])
    found = Held(said)
    assert read_back(found.record).problems == ()
    assert found.manifest["ring"] is None
    assert replay_run(str(found.record), found.record.parent, None, as_json=True) == 0
    capsys.readouterr()
    return found


def test_a_scan_that_is_killed_leaves_the_stop_to_the_drive_and_its_record_to_the_supervisor(tmp_path, capsys):
    found = held("scan-killed", tmp_path, capsys)
    assert [row["fault"] for row in found.said["acted"]] == ["process.scan kill"]
    assert abs(found.torque_when_it_acted_nm()) > 33.0, "there was nothing to bring down"
    lost = [line["text"] for line in found.bench_log if line["event"] == "controller_lost"]
    assert any("0x1400:5" in text for text in lost)
    assert any("0x1016" in text for text in lost)
    assert any(line["event"] == "quick_stop" for line in found.bench_log)
    assert "killed by SIGKILL" in found.result["reasons"][0]


def test_a_supervisor_that_is_killed_leaves_a_run_that_unloads_itself(tmp_path, capsys):
    found = held("desk-killed", tmp_path, capsys)
    assert [row["fault"] for row in found.said["acted"]] == ["process.desk kill"]
    assert "the scan process, because the supervisor process ended, stopped the run" in found.result["reasons"][0]


def test_a_disk_that_is_full_stops_the_run_and_costs_no_record(tmp_path, capsys):
    found = held("disk-full", tmp_path, capsys)
    assert [row["fault"] for row in found.said["acted"]] == ["machine.disk full"]
    assert "records could not be written to disk" in found.result["reasons"][0]
    assert found.result["timing"]["disk"]["refused"] >= 1
    assert found.result["timing"]["disk"]["most_waiting"] > 150, "the ring held what the disk did not take"


def test_a_clock_that_is_set_changes_times_of_day_and_nothing_else(tmp_path, capsys):
    found = held("clock-set", tmp_path, capsys)
    assert [row["fault"] for row in found.said["acted"]] == ["machine.clock step"]
    assert not wrong_verdict(found.result)
    started, ended = (datetime.fromisoformat(found.manifest[name]) for name in ("started", "ended"))
    events = [json.loads(line) for line in (found.record / "events.jsonl").read_text("utf-8").splitlines()]
    times_s = [event["t_s"] for event in events]
    timing = found.result["timing"]
    assert (ended - started).total_seconds() < -3000.0, "the end is almost an hour before the start"
    assert times_s == sorted(times_s)
    assert 5.0 < times_s[-1] <= (timing["scans"] + timing["missed"]) * timing["period_ns"] * 1e-9
    assert timing["wall_clock_jumped_s"] == pytest.approx(-3600.0, abs=0.1)
    assert any("was set by -3600.0 s during the run" in note for note in found.result["notes"])
