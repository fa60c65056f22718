"""The main job with every wire a serial port: slcan to the drive, Modbus RTU to the devices, over pseudo-terminals."""

from __future__ import annotations

import json
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from lostmotion_command import COMMAND, ROOT
from patient import patient_bench, short_recipe

pytestmark = [pytest.mark.wires, pytest.mark.wall_clock]

SLOPE_OF_THIS_RECIPE = 85.9
"""What it measures in virtual time: to 15 % of rated torque in a fraction of a second, so less than the unit's 94.7."""


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder that is not below /dev, where the folders of tests may lie and names of ports are refused."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    """The shipped virtual bench, rewired: brake and remote I/O share one RS-485 pair."""
    ports = {"amplifier": "amplifier", "brake": "rs485", "remote_io": "rs485"}
    rtu = {name: {"transport": "rtu", "serial_port": f"{tmp_path}/{port}"} for name, port in ports.items()}
    can = {"can": {"interface": "slcan", "channel": f"{tmp_path}/can"}}
    return patient_bench(tmp_path, {"bench": {"embedded": False}}, can, rtu)


@pytest.fixture
def words(tmp_path: Path, bench_file: Path) -> tuple[str, ...]:
    """Words for a run by a short recipe, at 4 ms, on that bench."""
    recipe = short_recipe(tmp_path, {"sampling": {"period": "4 ms"}})
    return ("run", str(recipe), "--bench", str(bench_file), "--serial", "PTY", "--json", "--no-report")


@pytest.fixture
def served(bench_file: Path, tmp_path: Path) -> Iterator[dict]:
    """The virtual bench on the serial ports that the bench file names."""
    log = (tmp_path / "virtual-bench.jsonl").open("w", encoding="utf-8")
    command = [*COMMAND, "virtual-bench", "--bench", str(bench_file)]
    with log, subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline()) | {"process": process}
        process.send_signal(signal.SIGTERM)
        code = process.wait(60)
    if code == 0:
        assert not (tmp_path / "can").is_symlink(), "its serial ports are gone with it"


def test_main_job_over_serial_ports(lostmotion, served, words, tmp_path):
    assert served["can"] == {"interface": "slcan", "channel": f"{tmp_path}/can"}
    assert served["brake"]["serial_port"] == served["remote_io"]["serial_port"] == f"{tmp_path}/rs485"
    result = lostmotion(*words).json
    wires = result["timing"]["wires"]
    assert result["state"] == "complete"
    slope = next(row["value"] for row in result["metrics"] if row["id"] == "torque_ratio_slope")
    assert slope == pytest.approx(SLOPE_OF_THIS_RECIPE, rel=0.1)
    assert wires["amplifier.garbage"] == wires["brake.garbage"] == wires["remote_io.garbage"] == 0
    assert wires["can.sends_failed"] == wires["can.frames_malformed"] == 0
    assert min(wires[f"{name}.replies"] for name in ("amplifier", "brake", "remote_io")) > 200


def test_adapters_pulled_out_in_the_middle_of_a_run(start, served, words):
    """SIGKILL of the virtual bench hangs its ports up one after the other, as a pulled plug of a hub does."""
    run = start(*words)
    run.wait_for(lambda: any(path.stat().st_size > 100_000 for path in run.data.glob("*/samples.bin")))
    served["process"].kill()
    ran = run.finish()
    assert (ran.exit_code, ran.json["state"], ran.json["verdict"]) == (4, "fault", "NOT DECIDABLE")
    alarms = [alarm["id"] for alarm in ran.json["alarms"]]
    assert alarms[0] in ("can_lost", "amplifier_lost", "brake_link_lost", "remote_io_lost")
    assert "can_lost" in alarms
    assert "Traceback" not in ran.err


def test_an_adapter_that_is_not_there_is_a_clear_fault(lostmotion, words, tmp_path):
    ran = lostmotion(*words)
    assert ran.exit_code == 4
    said = " ".join(ran.json["reasons"])
    assert f"slcan {tmp_path}/can" in said
    assert "port name" in said
    assert f"{tmp_path}/rs485" in said
