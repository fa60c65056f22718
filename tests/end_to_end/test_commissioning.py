"""Commissioning over real wires: five mistakes in the files of a bench, each found by its step, with its cure.

The virtual bench is a process of its own, as a bench is, and what hands do there is told to its standard input.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from lostmotion_command import COMMAND, ROOT, Ran, forked
from patient import QUICK_RECIPE, VIRTUAL_BENCH, write_changed

from definitions.commissioning import STEPS
from station.bench.commissioned import read_protocol
from station.bench.request import DRIVER_PROFILES
from station.commissioning.on_wires import on_wires
from station.commissioning.steps_done import write_down

pytestmark = [pytest.mark.wires, pytest.mark.long]
CAN_SENSORS = ROOT / "tests" / "data" / "benches" / "can-sensors.yaml"
PATIENT = {
    **{part: {"timeout": "500 ms"} for part in ("amplifier", "brake", "remote_io")},
    "drive": {"controller_heartbeat_timeout": "400 ms", "setpoint_timeout": "200 ms"},
}
"""By the wall clock, on a machine that may hold any process up."""


class Bench:
    """A virtual bench that somebody started, and the file by which a technician reaches it."""

    def __init__(self, folder: Path, template: Path = VIRTUAL_BENCH) -> None:
        self.file = folder / "bench.yaml"
        self.folder = folder
        words = ("virtual-bench", "--hands", "--seed", "1", "--can", "127.0.0.1:0", "--modbus", "127.0.0.1:0")
        if template != VIRTUAL_BENCH:
            words += ("--bench", str(template))
        self._process = subprocess.Popen(
            [*COMMAND, *words],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self._process.stdout is not None
        ready = json.loads(self._process.stdout.readline())
        parts = [part for part in ("amplifier", "brake", "remote_io") if part in ready]
        at = {part: {key: ready[part][key] for key in ("host", "port")} for part in (*parts, "can")}
        patient = {part: change for part, change in PATIENT.items() if part in (*parts, "drive")}
        write_changed(template, self.file, patient, at, {"bench": {"embedded": False}, "pace": ready["pace"]})

    def hand(self, *lines: str) -> None:
        """Do something at the bench."""
        assert self._process.stdin is not None
        self._process.stdin.write("".join(f"{line}\n" for line in lines))
        self._process.stdin.flush()

    def profile(self, name: str, changes: dict[str, str]) -> None:
        """Put a changed copy of a profile beside the bench file."""
        text = (DRIVER_PROFILES / f"{name}.yaml").read_text(encoding="utf-8")
        for before, after in changes.items():
            assert before in text
            text = text.replace(before, after)
        (self.folder / f"{name}.yaml").write_text(text, encoding="utf-8")

    def passed_before(self, step: str) -> None:
        """Let the steps before this one have passed with the files as they are."""
        bench = on_wires(str(self.file))
        for one in STEPS[: [row.id for row in STEPS].index(step)]:
            write_down(bench, one.id, "test", (), ())

    def recipe(self) -> tuple[str, ...]:
        """Words that name the quick recipe with half of its scans: small runs take what they are from it."""
        recipe = write_changed(QUICK_RECIPE, self.folder / "recipe.yaml", {"sampling": {"period": "2 ms"}})
        return ("--recipe", str(recipe))

    def step(self, step: str, *more: str) -> Ran:
        return forked("bench", step, "--bench", str(self.file), *more, "--json")

    def guided(self, step: str, hands: dict[str, tuple[str, ...]]) -> Ran:
        """Do a guided step: what hands do as soon as a line with these words is said."""
        words = ("bench", step, "--bench", str(self.file), "--json", "--seconds", "30")
        with subprocess.Popen(
            [*COMMAND, *words], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as running:
            assert running.stdout is not None
            assert running.stderr is not None
            said = ""
            for line in iter(running.stderr.readline, ""):
                said += line
                for asked, deeds in hands.items():
                    if asked in line:
                        self.hand(*deeds)
            out = running.stdout.read()
        return Ran(running.returncode, out, said)

    def close(self) -> None:
        self._process.terminate()
        self._process.communicate()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    started = Bench(tmp_path)
    yield started
    started.close()


def refused(ran: Ran, step: str) -> str:
    """The cure of the one finding that keeps a step from passing; it stands in the protocol too."""
    told = ran.json
    assert (ran.exit_code, told["step"], told["passed"]) == (1, step, False), ran
    (cure,) = [one["cure"] for one in told["findings"] if one["refuses"]]
    kept = json.loads(Path(told["protocol"]).read_text(encoding="utf-8"))["steps"][-1]
    assert (kept["step"], kept["findings"]) == (step, told["findings"])
    return cure


PRESSED: dict[str, tuple[str, ...]] = {
    "Press the emergency stop": ("io.estop trip",),
    "Release the emergency stop. You": ("io.estop trip end",),
    "Open the guard": ("io.guard open",),
    "Close the guard. You": ("io.guard open end",),
    "Press the enabling device": ("io.enabling_device press",),
    "Let the enabling device go": ("io.enabling_device press end",),
}
PUSHED = {"Press on each": ("sensor.torque_in offset 0.5", "sensor.torque_out offset 30")}


def test_a_bench_whose_files_are_right_passes_until_torque_is_needed(bench: Bench) -> None:
    ran = bench.step("probe")
    assert ran.exit_code == 0, ran
    told = ran.json
    assert {one["channel"] for one in told["live"]} >= {"statusword", "torque_out_nm", "estop_released"}
    assert all(one["age_ms"] < 1000.0 for one in told["live"])
    assert bench.guided("registers", PUSHED).exit_code == 0
    assert bench.guided("io", PRESSED).exit_code == 0
    assert [done.passed for done in read_protocol(bench.file, on_wires(str(bench.file)).bench).steps] == [True] * 3
    assert bench.step("status").exit_code == 1
    ran = bench.step("watchdogs")
    assert (ran.exit_code, "direction (to do)" in ran.err) == (2, True)


def test_a_wrong_word_order_is_found_by_registers(bench: Bench) -> None:
    bench.profile("virtual-amplifier", {"byte_order: big ": "word_order: little\nbyte_order: big "})
    assert bench.step("probe").exit_code == 0, "numbers all the same"
    assert "'word_order: big'" in refused(bench.guided("registers", PUSHED), "registers")


def test_sensors_on_can_are_probed_and_their_frames_browsed(tmp_path: Path) -> None:
    """Objects and live values without a write; torques that are pressed on; a byte order that is the other one."""
    shutil.copytree(CAN_SENSORS.parent / "profiles", tmp_path / "profiles")
    shutil.copy(DRIVER_PROFILES / "can-torque.yaml", tmp_path / "profiles")
    bench = Bench(tmp_path, CAN_SENSORS)
    try:
        told = bench.step("probe").json
        outcomes = {one["place"]: one["outcome"] for one in told["objects"] if one["place"].startswith("flange")}
        assert outcomes == {
            "flange 1018:01": "holds", "flange 1018:02": "holds", "flange 6125:01": "will be written",
            "flange 1017:00": "will be written",
        }  # fmt: skip
        live = {one["channel"]: one for one in told["live"] if "flange" in one["source"] or "encoders" in one["source"]}
        assert set(live) == {"torque_out", "torque_in", "cycle", "input_counts", "output_counts"}
        assert all(one["age_ms"] < 1000.0 for one in live.values())
        assert told["passed"], told["findings"]
        told = bench.guided("registers", PUSHED).json
        assert (told["passed"], told["moved"]) == (True, ["torque_in_nm", "torque_out_nm"]), told["findings"]
        profile = tmp_path / "profiles" / "can-torque.yaml"
        text = profile.read_text(encoding="utf-8")
        profile.write_text(text.replace("bytes: 8", "bytes: 8\n    byte_order: big"), encoding="utf-8")
        bench.passed_before("registers")
        assert "'byte_order: little'" in refused(bench.guided("registers", PUSHED), "registers")
    finally:
        bench.close()


def test_an_emergency_stop_at_the_wrong_contact_is_found_by_io(bench: Bench) -> None:
    at = "offset: 1, type: u16, bit: "
    bench.profile(
        "virtual-remote-io",
        {
            f"estop_released, {at}0": f"estop_released, {at}1",
            f"guard_closed, {at}1": f"guard_closed, {at}0",
        },
    )
    bench.passed_before("io")
    assert "'offset: 1, bit: 0' for estop_released" in refused(bench.guided("io", PRESSED), "io")


def test_an_angle_that_counts_backwards_is_found_by_direction(bench: Bench) -> None:
    right = "5.992112452678286e-06"
    bench.profile("virtual-amplifier", {right: f"-{right}"})
    bench.passed_before("direction")
    ran = bench.step("direction", *bench.recipe(), "--data", str(bench.folder))
    assert f"'scale: {right}' for angle_in_rad" in refused(ran, "direction")
    assert "angle_channels_disagree" in ran.json["ended"]


def test_a_heartbeat_that_nobody_supervises_is_found_by_probe_and_by_watchdogs(bench: Bench) -> None:
    """The profile leaves it out: the time-out of set-points is then all that stops the drive, which is said."""
    bench.profile("virtual-drive", {"scaling:\n": "protections: {controller_heartbeat: none}\nscaling:\n"})
    (told,) = bench.step("probe").json["findings"]
    assert "The drive has 0x1016:1, but its profile does not use it" in told["what"], "before anything is enabled"
    assert "'protections: {controller_heartbeat: consumer_heartbeat}' into profile virtual-drive" in told["cure"]
    bench.passed_before("watchdogs")
    ran = bench.step("watchdogs")
    assert ran.exit_code == 0, ran
    assert [one["acted"] for one in ran.json["trials"]] == [True, False, True], ran
    (finding,) = ran.json["findings"]
    assert "controller_heartbeat: consumer_heartbeat" in finding["cure"]


def test_a_gain_ten_times_too_high_is_found_by_tune(bench: Bench) -> None:
    write_changed(bench.file, bench.file, {"torque_control": {"gain": 150}})
    bench.passed_before("tune")
    ran = bench.step("tune", *bench.recipe(), "--data", str(bench.folder))
    assert "torque_control: {gain: " in refused(ran, "tune")
    assert 10.0 <= ran.json["proposed_per_s"] <= 50.0
