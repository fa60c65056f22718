"""Scenarios over real wires, in real time: the same file, the same judge, times from the bench's own notes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from station import command_faults
from station.fault_rows import ROWS
from station.fault_wires_matrix import measure_over_wires, wire_rows
from station.request import load_job

pytestmark = pytest.mark.wires
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def job():
    return load_job("rv-40e-121-faults", None)


def test_a_scenario_holds_over_wires_and_its_record_is_kept(tmp_path, capsys):
    path = ROOT / "scenarios" / "heartbeat-lost.yaml"
    code = command_faults.run(path, None, None, tmp_path, wires=True, as_json=True)
    said = json.loads(capsys.readouterr().out)
    assert (code, said["wrong"]) == (0, [])
    assert [row["fault"] for row in said["acted"]] == ["can.drive.heartbeat off"]
    assert 80 <= said["detect_scans"] <= 122
    record = Path(said["record"])
    assert record.parent == tmp_path
    assert json.loads((record / "result.json").read_bytes())["state"] == "fault"
    assert json.loads((record / "run.json").read_bytes())["notes"] == ["faults were injected: heartbeat lost"]


@pytest.mark.parametrize("name", ["modbus.amplifier off"])
def test_a_row_of_the_matrix_keeps_its_bounds_over_wires(job, tmp_path, name):
    (number,) = [number for number in wire_rows() if ROWS[number].name == name]
    found = measure_over_wires(job, number, tmp_path, lambda _: None)
    assert found.cell.wrong == ()
    assert found.cell.alarm in ROWS[number].causes
    assert found.cell.order_scans == 0


def test_twelve_faults_at_least_are_run_over_wires():
    assert len(wire_rows()) >= 12
