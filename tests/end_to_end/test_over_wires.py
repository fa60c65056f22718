"""The main job over real wires: a pass, faults in mid-ramp, interruptions, a killed controller."""

from __future__ import annotations

import contextlib
import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from patient import QUICK_RECIPE
from run_samples import records_of

from definitions.faults import FAULT_BY_ID
from definitions.image import DriveState, Orders, State
from recipes import shipped_recipes
from station.records.samples.layout import CURRENT

pytestmark = pytest.mark.wires
RATED_NM = 412.0
LOADED_NM = 60.0
"""From here on a ramp is under way, and more stands on the unit than the friction that a quick stop leaves in it."""


class Samples:
    """Every whole scan record of a run, its channels by name; the sequence numbers have no gap."""

    def __init__(self, record: Path) -> None:
        self.table = records_of(record)
        assert (np.diff(self.table["sequence"].astype(np.int64)) == 1).all()

    def __getitem__(self, channel: str) -> np.ndarray:
        part = "orders" if channel in Orders._fields else "image"
        return self.table[part][channel]

    @property
    def torque_out_nm(self) -> np.ndarray:
        return self["torque_out_nm"] - self["torque_out_tare_nm"]


def write_scenario(folder: Path, target: str, verb: str, value: str = "") -> str:
    path = folder / "scenario.yaml"
    extra = f", value: {value}" if value else ""
    path.write_text(
        f"scenario: {{name: {target} {verb}}}\n"
        f"faults:\n  - {{target: {target}, verb: {verb}{extra}, when: {{torque_out_above_nm: {LOADED_NM}}}}}\n",
        encoding="utf-8",
    )
    return str(path)


@pytest.mark.parametrize("recipe_at", ["4 ms", pytest.param("as shipped", marks=pytest.mark.long)])
def test_quick_recipe_measures_right_over_wires_and_passes(lostmotion, quarter, recipe_at):
    """On the shipped bench, with all limits of both, however busy the machine is. `make run` is the same as shipped."""
    recipe = quarter("rv-40e-121-quick") if recipe_at == "4 ms" else str(QUICK_RECIPE)
    ran = lostmotion("run", recipe, "--serial", "P1-0001", "--json", "--pace", "fast")
    result, timing = ran.json, ran.json["timing"]
    assert (ran.exit_code, result["state"], result["verdict"]) == (0, "complete", "PASS")
    values = {m["id"]: m["value"] for m in result["metrics"]}
    assert values["backlash_width_3pct"] == pytest.approx(0.940, abs=0.03)
    assert values["lost_motion"] == pytest.approx(0.376, abs=0.03)
    assert values["spring_constant"] == pytest.approx(115.17, rel=0.02)
    assert values["stiffness_50_100"] == pytest.approx(104.70, rel=0.01)
    assert len(Samples(ran.record).table) == timing["scans"]
    for name in (
        "recipe.yaml",
        "bench.yaml",
        "events.jsonl",
        "timing.json",
        "calibration.json",
    ):
        assert (ran.record / name).stat().st_size > 0


@pytest.mark.long
def test_a_sweep_over_wires_answers_as_in_virtual_time(lostmotion, tmp_path):
    """The drive's delay on the wires is in torque and angle alike: the response is that of the unit."""
    text = shipped_recipes()["rv-40e-121-sweep"].read_text(encoding="utf-8")
    recipe = tmp_path / "sweep.yaml"
    recipe.write_text(text.replace("period: 32 s", "period: 16 s").replace("period: 1 ms", "period: 4 ms"), "utf-8")
    lines = []
    for clock in (("--pace", "fast"), ("--virtual-time",)):
        ran = lostmotion("run", str(recipe), "--serial", "P1-0001", "--json", *clock)
        assert ran.exit_code == 0, ran.err
        found = lostmotion("study", "frequency", str(ran.record), "--json")
        assert found.exit_code == 0, found.err
        lines.append(found.json["response"])
    for wires, virtual in zip(*lines, strict=True):
        assert wires["used"]
        assert wires["stiffness_nm_per_arcmin"] == pytest.approx(virtual["stiffness_nm_per_arcmin"], rel=0.03)
        assert wires["phase_deg"] == pytest.approx(virtual["phase_deg"], abs=1.5)


@pytest.mark.parametrize(
    ("target", "verb", "value", "cause"),
    [
        ("can.drive.heartbeat", "off", "", {"drive_heartbeat_lost"}),
        ("io.estop", "trip", "", {"estop", "drive_dropped_out"}),
        ("modbus.amplifier", "off", "", {"amplifier_lost", "sample_stale"}),
        ("lock", "slip", "0.2", {"lock_slip"}),
    ],
)
def test_fault_in_the_middle_of_a_ramp(lostmotion, one_ramp, tmp_path, *, target, verb, value, cause):
    scenario = write_scenario(tmp_path, target, verb, value)
    ran = lostmotion("run", *one_ramp, "--serial", "F", "--json", "--scenario", scenario, "--pace", "fast")
    result = ran.json
    assert (ran.exit_code, result["state"]) == (4, "fault")
    assert result["verdict"] != "PASS"
    first = result["alarms"][0]
    assert first["id"] in cause
    assert first["state"] == "ramp_pos"
    assert first["next_action"] == FAULT_BY_ID[first["id"]].next_action
    assert FAULT_BY_ID[first["id"]].text in ran.err

    samples = Samples(ran.record)
    assert samples["state"][-1] == State.FAULT
    assert samples["fault"][-1] == FAULT_BY_ID[first["id"]].number
    assert samples["brake_on"][-1], "the lock stays closed"
    tripped = int(np.argmax(samples["state"] == State.FAULT))
    assert samples.torque_out_nm[:tripped].max() > 0.9 * LOADED_NM
    assert (samples["drive_target_torque_nm"][-1], samples["drive_command"][-1]) == (0.0, 0)
    if target != "can.drive.heartbeat":  # a silent drive cannot say that it is off
        assert samples["drive_state"][-1] != DriveState.OPERATION_ENABLED
    if not target.startswith("modbus"):  # a cut sensor cannot show it
        # friction keeps a rest in the unit when the drive lets go; 6 % is what the unloading line leaves
        assert abs(samples.torque_out_nm[-1]) < 0.08 * RATED_NM


def scan_process_of(run_folder: Path) -> int:
    """Process id of the scan process, by its command line."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            words = path.read_bytes().split(b"\0")
            if b"station.scan.scan_process" in words and str(run_folder).encode() in words[-2]:
                return int(path.parent.name)
    message = "there is no scan process"
    raise AssertionError(message)


def in_ramp(data: Path) -> bool:
    """True once the newest run has more than LOADED_NM on the unit, by its own samples on disk."""
    files = sorted(data.glob("*/samples.bin"))
    if not files:
        return False
    size = files[-1].stat().st_size // CURRENT.record_bytes * CURRENT.record_bytes
    if not size:
        return False
    with files[-1].open("rb") as stream:
        stream.seek(size - CURRENT.record_bytes)
        last = np.frombuffer(stream.read(CURRENT.record_bytes), CURRENT.dtype)[0]
    return bool(last["image"]["torque_out_nm"] > LOADED_NM and last["orders"]["state"] == State.RAMP_POS)


def test_ctrl_c_unloads_releases_and_ends_stopped(start, one_ramp):
    run = start("run", *one_ramp, "--serial", "C", "--json")
    run.wait_for(lambda: in_ramp(run.data))
    run.interrupt()
    ran = run.finish()
    assert (ran.exit_code, ran.json["state"]) == (4, "stopped")
    samples = Samples(ran.record)
    assert list(dict.fromkeys(samples["state"]))[-3:] == [State.UNLOAD, State.RELEASE, State.STOPPED]
    assert not samples["brake_on"][-1]
    opened = int(np.argmax((samples["brake_on"] == 0) & (samples["state"] == State.RELEASE)))
    assert abs(samples.torque_out_nm[opened]) < 0.02 * RATED_NM


def test_second_ctrl_c_is_a_quick_stop(start, one_ramp):
    run = start("run", *one_ramp, "--serial", "CC", "--json")
    run.wait_for(lambda: in_ramp(run.data))
    run.interrupt()
    run.wait_for(lambda: not in_ramp(run.data))
    run.interrupt()
    ran = run.finish()
    assert (ran.exit_code, ran.json["state"]) == (4, "fault")
    assert ran.json["alarms"][0]["id"] == "operator_quick_stop"


@pytest.mark.wall_clock
def test_killed_controller_drive_stops_itself_and_nothing_recorded_is_lost(start, lostmotion, ramp_by_wall_clock):
    run = start("run", *ramp_by_wall_clock, "--serial", "K", "--json")
    run.wait_for(lambda: in_ramp(run.data))
    (folder,) = (path.parent for path in run.data.glob("*/run.json"))
    os.kill(scan_process_of(folder), signal.SIGKILL)
    ran = run.finish()
    assert ran.exit_code == 4
    assert ran.json["verdict"] != "PASS"
    assert ran.json["state"] == "interrupted"
    samples = Samples(folder)
    assert samples["state"][-1] == State.RAMP_POS
    assert samples.torque_out_nm[-1] > 0.9 * LOADED_NM
    said = [json.loads(line) for line in (folder / "virtual-bench.jsonl").read_text(encoding="utf-8").splitlines()]
    lost = [line for line in said if line["event"] == "controller_lost"]
    assert lost, "the drive said nothing"
    assert "0x1016" in json.dumps(lost) or "0x1400" in json.dumps(lost)
    assert "0x6007" in json.dumps(lost)
    assert any(line["event"] == "quick_stop" for line in said)
    assert "interrupted" in lostmotion("list").out
