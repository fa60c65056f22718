"""Scenarios over real wires: the same files and the same judge, on a bench that waits; and on one on a cable."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from patient import brisk_recipe, patient_bench, short_recipe

from faultlab.matrix.over_wires import measure_over_wires, wire_rows
from faultlab.rows import ROWS
from station.bench.request import load_job
from station.cli.faults import faults as command_faults

pytestmark = [pytest.mark.wires, pytest.mark.long]
ROOT = Path(__file__).parents[2]
BENCHES = ROOT / "tests" / "data" / "benches"


def patient_run(folder: Path, bench: Path) -> command_faults.How:
    return command_faults.How(str(short_recipe(folder)), wires=True, bench=str(bench), data=folder / "runs")


def test_a_scenario_holds_over_wires_and_its_record_is_kept(tmp_path, capsys):
    path = ROOT / "scenarios" / "heartbeat-lost.yaml"
    how = command_faults.How(str(brisk_recipe(tmp_path)), wires=True, data=tmp_path / "runs")
    code = command_faults.run(path, how, as_json=True)
    said = json.loads(capsys.readouterr().out)
    assert (code, said["wrong"]) == (0, [])
    assert [row["fault"] for row in said["acted"]] == ["can.drive.heartbeat off"]
    assert said["detect_scans"] > 0
    record = Path(said["record"])
    assert record.parent == tmp_path / "runs"
    assert json.loads((record / "result.json").read_bytes())["state"] == "fault"
    assert json.loads((record / "run.json").read_bytes())["notes"] == ["faults were injected: heartbeat lost"]


def test_a_drive_that_lies_is_refused_before_anything_moves(tmp_path, capsys):
    path = ROOT / "scenarios" / "drive-that-lies.yaml"
    assert command_faults.run(path, command_faults.How(wires=True, data=tmp_path), as_json=True) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["wrong"] == []
    assert "6072:00" in said["refused"]
    assert said["states"] == []


SILENT_ENCODERS = """
scenario: {name: silent encoders}
faults:
  - {target: can.encoders, verb: off, when: {state: ramp_pos, after_scans: 100}}
expect:
  - {event: sample_late, within_scans: 22}
  - {event: sample_stale, within_scans: 42}
  - {reaction: hold, within_scans: 0}
  - {reaction: quick_stop, within_scans: 21}
  - {torque_below_nm: 33, within_s: 0.5}
  - {final_state: fault}
  - {latched: true}
never:
  - {torque_above_nm: 260}
  - {order_after_fault: enable_operation}
"""

STANDING_COUNTER = """
scenario: {name: counter that stands still}
faults:
  - {target: modbus.torques.cycle, verb: freeze, when: {state: lock, after_scans: 50}}
expect:
  - {event: sample_stale, within_scans: 42}
  - {reaction: quick_stop, within_scans: 0}
  - {final_state: fault}
"""


@pytest.mark.parametrize(
    ("bench", "scenario"),
    [("can-sensors", SILENT_ENCODERS), ("two-amplifiers", STANDING_COUNTER)],
    ids=["silence", "counter"],
)
def test_a_device_that_has_a_name_in_the_bench_file_is_made_wrong_by_it(tmp_path, capsys, bench, scenario):
    """CAN encoders that fall silent in the middle of a ramp; a counter that stands still while its torques go on."""
    path = tmp_path / "scenario.yaml"
    path.write_text(scenario, encoding="utf-8")
    recipe = str(brisk_recipe(tmp_path))
    how = command_faults.How(recipe, wires=True, bench=str(BENCHES / f"{bench}.yaml"), data=tmp_path / "runs")
    code = command_faults.run(path, how, as_json=True)
    said = json.loads(capsys.readouterr().out)
    assert (code, said["wrong"]) == (0, []), said["wrong"]


def test_a_row_of_the_matrix_holds_over_wires(tmp_path):
    job = load_job(str(brisk_recipe(tmp_path)), None)
    (number,) = [number for number in wire_rows() if ROWS[number].name == "modbus.brake.brake_current_a freeze"]
    found = measure_over_wires(job, number, tmp_path, lambda _: None)
    assert found.repeated == 0
    assert found.cell.wrong == ()
    assert found.cell.alarm in ROWS[number].causes
    assert found.cell.order_scans == 0


def test_the_documentation_has_every_row_that_is_run_over_wires():
    page = (ROOT / "docs" / "wire-faults.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1].strip(" `") for line in page.splitlines() if line.startswith("| `")]
    assert rows == [ROWS[number].name for number in wire_rows()], "run 'lostmotion faults matrix --wires --page ...'"
    assert len(rows) >= 12


class BenchOnACable:
    """A virtual bench as a process of its own on known ports, and the bench file that describes it as a real one."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "station", "virtual-bench", "--can", "127.0.0.1:0", "--modbus", "127.0.0.1:0"]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        ready = json.loads(self.process.stdout.readline())
        ports = {part: {"port": ready[part]["port"]} for part in ("can", "amplifier", "brake", "remote_io")}
        self.file = patient_bench(folder, {"bench": {"name": "cable", "embedded": False}}, ports)

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(10)
        self.process.stdout.close()


@pytest.fixture(scope="module")
def cable(tmp_path_factory) -> Iterator[BenchOnACable]:
    bench = BenchOnACable(tmp_path_factory.mktemp("cable"))
    yield bench
    bench.close()


@pytest.mark.wall_clock
def test_a_gateway_brings_faults_to_a_bench_on_a_cable(cable, tmp_path, capsys):
    path = tmp_path / "silence.yaml"
    path.write_text(
        "scenario: {name: silence on the cable}\n"
        "faults:\n  - {target: modbus.amplifier, verb: silence, when: {state: lock, after_scans: 300}}\n"
        "expect:\n  - {event: sample_stale, within_scans: 1500}\n  - {order: quick_stop, within_scans: 0}\n"
        "  - {final_state: fault}\nnever:\n  - {event: drive_heartbeat_lost}\n",
        encoding="utf-8",
    )
    how = patient_run(tmp_path, cable.file)
    code = command_faults.run(path, how, as_json=True)
    said = json.loads(capsys.readouterr().out)
    assert (code, said["wrong"], said["refused"]) == (0, [], "")
    assert [row["fault"] for row in said["acted"]] == ["modbus.amplifier silence"]
    assert said["alarms"][0]["state"] == "lock"


def test_a_gateway_refuses_what_is_not_on_the_wire(cable, tmp_path, capsys):
    path = tmp_path / "guard.yaml"
    path.write_text(
        "scenario: {name: guard}\nfaults:\n  - {target: io.guard, verb: open, when: {state: lock}}\n", encoding="utf-8"
    )
    assert command_faults.run(path, command_faults.How(wires=True, bench=str(cable.file)), as_json=False) == 1
    assert "allowed are faults on the wire" in capsys.readouterr().out
