"""The main job with every wire a serial port: slcan to the drive, Modbus RTU to the devices, over pseudo-terminals."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import COMMAND, ROOT

pytestmark = pytest.mark.wires

REPLACED = {
    "embedded: true ": "embedded: false",
    "interface: socketcand": "interface: slcan",
    "channel: vcan0": "channel: {folder}/can",
    "  port: 1502\n": "  serial_port: {folder}/amplifier\n",
    "  port: 1503\n": "  serial_port: {folder}/rs485\n",
    "  port: 1504\n": "  serial_port: {folder}/rs485\n",
    "transport: tcp": "transport: rtu",
    "timeout: 5 ms": "timeout: 20 ms",
}
"""The shipped virtual bench, rewired: brake and remote I/O share one RS-485 pair."""


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    text = (ROOT / "recipes" / "benches" / "virtual.yaml").read_text(encoding="utf-8")
    for old, new in REPLACED.items():
        assert old in text
        text = text.replace(old, new.format(folder=tmp_path))
    path = tmp_path / "bench.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def served(bench_file: Path, tmp_path: Path) -> Iterator[dict]:
    """The virtual bench on the serial ports that the bench file names."""
    log = (tmp_path / "virtual-bench.jsonl").open("w", encoding="utf-8")
    command = [*COMMAND, "virtual-bench", "--bench", str(bench_file)]
    with log, subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline()) | {"process": process}
        process.send_signal(signal.SIGTERM)
        code = process.wait(10)
    if code == 0:
        assert not (tmp_path / "can").is_symlink(), "its serial ports are gone with it"


def test_main_job_over_serial_ports(lostmotion, served, bench_file, tmp_path):
    assert served["can"] == {"interface": "slcan", "channel": f"{tmp_path}/can"}
    assert served["brake"]["serial_port"] == served["remote_io"]["serial_port"] == f"{tmp_path}/rs485"
    recipe = ROOT / "tests" / "golden" / "golden.yaml"
    ran = lostmotion("run", str(recipe), "--bench", str(bench_file), "--serial", "PTY", "--json")
    result = ran.json
    wires = result["timing"]["wires"]
    if result["state"] == "complete":
        slope = next(row["value"] for row in result["metrics"] if row["id"] == "torque_ratio_slope")
        assert slope == pytest.approx(94.7, rel=0.05)
        assert wires["amplifier.garbage"] == wires["brake.garbage"] == wires["remote_io.garbage"] == 0
    else:  # a machine that stood still is no fault of the wires
        assert result["timing"]["missed"] > 0
        assert result["alarms"][0]["id"] in ("missed_periods", "sample_stale", "sample_late", "drive_data_stale")
    assert wires["can.sends_failed"] == wires["can.frames_malformed"] == 0
    assert min(wires[f"{name}.replies"] for name in ("amplifier", "brake", "remote_io")) > 500


def test_adapters_pulled_out_in_the_middle_of_a_run(start, served, bench_file):
    """SIGKILL of the virtual bench hangs all its ports up at once, as a pulled plug of a hub does."""
    recipe = ROOT / "tests" / "golden" / "golden.yaml"
    run = start("run", str(recipe), "--bench", str(bench_file), "--serial", "PULL", "--json")
    run.wait_for(lambda: any(path.stat().st_size > 100_000 for path in run.data.glob("*/samples.bin")))
    served["process"].kill()
    ran = run.finish()
    assert (ran.exit_code, ran.json["state"], ran.json["verdict"]) == (4, "fault", "NOT DECIDABLE")
    assert ran.json["alarms"][0]["id"] in ("can_lost", "amplifier_lost", "missed_periods")
    assert "Traceback" not in ran.err


def test_an_adapter_that_is_not_there_is_a_clear_fault(lostmotion, bench_file, tmp_path):
    recipe = ROOT / "tests" / "golden" / "golden.yaml"
    ran = lostmotion("run", str(recipe), "--bench", str(bench_file), "--serial", "PTY", "--json")
    assert ran.exit_code == 4
    said = " ".join(ran.json["reasons"])
    assert f"slcan {tmp_path}/can" in said
    assert "plugged in" in said
    assert f"{tmp_path}/rs485" in said
