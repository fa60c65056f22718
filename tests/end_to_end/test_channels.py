"""The main job on benches whose channels come from other devices, over real wires, on the bench's own clock.

Every value is held against what is true of the virtual unit: the same recipe in virtual time, evaluated from torque and
wind-up inside the unit.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from libmodbus import compiled
from lostmotion_command import served
from patient import QUICK_RECIPE, VIRTUAL_BENCH, write_changed
from ruamel.yaml import YAML

from benchmarks.slow_amplifier import bench_of, samples
from station.bench.request import DRIVER_PROFILES, load_job

pytestmark = [pytest.mark.wires, pytest.mark.long]
BENCHES = Path(__file__).parents[1] / "data" / "benches"


PERIOD_MS = 4
"""Of the quick recipe here: the wires are looked at once in a scan, and a quarter of them shows what they carry."""


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The quick recipe, with fewer scans."""
    folder = tmp_path_factory.mktemp("recipe")
    return str(write_changed(QUICK_RECIPE, folder / "quick.yaml", {"sampling": {"period": f"{PERIOD_MS} ms"}}))


@pytest.fixture(scope="module")
def truth(recipe: str) -> dict[str, float]:
    """What is true of P1 in this recipe, by metric and side."""
    return true_of(recipe)


def true_of(recipe: str) -> dict[str, float]:
    job = load_job(recipe, "virtual")
    return samples(job, bench_of(job, 1), None)[2]


def beyond_its_uncertainty(result: dict, truth: dict[str, float], limit: float = 1.0) -> list[str]:
    """The values of a result that are farther from the truth than limit times their U; all metrics must be there."""
    sides = {f"{m['id']} {name}": side for m in result["metrics"] for name, side in m["sides"].items()}
    assert set(truth) <= set(sides)
    return [
        f"{name}: {sides[name]['value']} ± {sides[name]['uncertainty']}, true {true}"
        for name, true in truth.items()
        if abs(sides[name]["value"] - true) > limit * sides[name]["uncertainty"]
    ]


def run_on(
    lostmotion, recipe: str, bench: str, folder: Path = BENCHES, seed: tuple[str, ...] = ("--seed", "1")
) -> dict:
    """The result of the recipe on a bench, which completes; a bench that was started has its own seed."""
    ran = lostmotion(
        "run", recipe, "--bench", str(folder / f"{bench}.yaml"), *seed, "--serial", "P1-0001",
        "--json", "--pace", "fast", "--no-report",
    )  # fmt: skip
    assert ran.json.get("state") == "complete", str((ran.json["reasons"], ran.json["alarms"], ran.json["timing"]))
    assert ran.json["alarms"] == [], ran.json["reasons"]
    return ran.json


def test_two_amplifiers_of_swapped_floats_and_a_brake_that_is_a_coil(lostmotion, recipe, truth):
    result = run_on(lostmotion, recipe, "two-amplifiers", seed=("--seed", "2"))
    assert (result["verdict"], beyond_its_uncertainty(result, truth)) == ("PASS", [])
    wires = result["timing"]["wires"]
    assert wires["torques.replies"] > 0.95 * result["timing"]["scans"]
    assert wires["angles.replies"] > 0.95 * result["timing"]["scans"], "two blocks, one after the other"
    said = " ".join(result["notes"])
    for unproven in ("brake_current_lost", "set to by hand", "torques: no identity"):
        assert unproven in said
    assert "angles: no identity" not in said


def test_a_brake_that_is_an_output_of_the_remote_io(lostmotion, recipe, truth, tmp_path):
    """One device on one connection: contacts by one profile, the coil of the brake by the other."""
    folder = Path(shutil.copytree(BENCHES, tmp_path / "benches"))
    bench = folder / "two-amplifiers.yaml"
    text = bench.read_text(encoding="utf-8")
    assert "port: 1503, unit_id: 2, profile: coil-brake" in text
    text = text.replace("port: 1503, unit_id: 2, profile: coil-brake", "port: 1504, unit_id: 3, profile: coil-brake")
    bench.write_text(text, encoding="utf-8")
    result = run_on(lostmotion, recipe, "two-amplifiers", folder, seed=("--seed", "2"))
    assert (result["verdict"], beyond_its_uncertainty(result, truth)) == ("PASS", [])
    wires = result["timing"]["wires"]
    assert min(wires["brake.replies"], wires["remote_io.replies"]) > 0.3 * result["timing"]["scans"]
    assert wires["brake.timeouts"] == wires["remote_io.timeouts"] == wires["brake.strangers"] == 0


def test_torques_and_angles_of_two_canopen_sensors(lostmotion, recipe, truth):
    """A transducer that sends every millisecond in its own time, and encoders that answer SYNC."""
    result = run_on(lostmotion, recipe, "can-sensors")
    assert (result["verdict"], beyond_its_uncertainty(result, truth)) == ("PASS", [])
    wires, scans = result["timing"]["wires"], result["timing"]["scans"]
    assert min(wires["flange.frames"], wires["encoders.frames"] / 2) > 0.99 * scans
    assert wires["flange.malformed"] == wires["encoders.malformed"] == wires["can.frames_foreign"] == 0
    assert any("Channel angle_in of encoders: this device cannot prove" in note for note in result["notes"])
    assert wires["flange.heartbeats"] > 0.99 * scans / 50
    of_sensors = [note for note in result["notes"] if note.startswith("Sensor ")]
    assert len(of_sensors) == 2, "identity and heartbeat of the flange are looked at"
    assert all("encoders" in note for note in of_sensors)


SYNC_AND_ITS_PERIOD = {
    "2 ms": ("2 ms", "node_id: 12}"),
    "4 ms, encoders in their own time": ("4 ms", "node_id: 12, update_every: 10 ms}"),
}
"""Recipe's period, and what stands in the bench file of the encoders: with 4 ms they answer SYNC in the test above."""


@pytest.mark.parametrize("case", SYNC_AND_ITS_PERIOD)
def test_values_that_answer_sync_are_as_old_as_the_period_and_no_wider_loop(lostmotion, tmp_path, case):
    """The lag that the bench file declares is the sensor's own, so the same file is right at every period.

    An age that is wrong shows in the width of the loop. Of the other values one in twenty may lie beyond U.
    """
    period, encoders = SYNC_AND_ITS_PERIOD[case]
    recipe = str(write_changed(QUICK_RECIPE, tmp_path / "quick.yaml", {"sampling": {"period": period}}))
    folder = Path(shutil.copytree(BENCHES, tmp_path / "benches"))
    bench = folder / "can-sensors.yaml"
    bench.write_text(bench.read_text(encoding="utf-8").replace("node_id: 12}", encoders), encoding="utf-8")
    truth = true_of(recipe)
    widths = {name: value for name, value in truth.items() if name.startswith(("hysteresis_energy", "windup"))}
    beyond = []
    for seed in ("1", "2"):
        result = run_on(lostmotion, recipe, "can-sensors", folder, ("--seed", seed))
        assert result["verdict"] == "PASS"
        assert beyond_its_uncertainty(result, widths, 0.5) == []
        assert beyond_its_uncertainty(result, truth, 2.0) == []
        beyond += beyond_its_uncertainty(result, truth)
    assert len(beyond) <= 1, beyond


def test_raw_frames_that_a_dbc_file_describes_and_a_brake_at_an_output_of_the_drive(lostmotion, recipe, truth):
    result = run_on(lostmotion, recipe, "can-dbc")
    assert (result["verdict"], beyond_its_uncertainty(result, truth)) == ("PASS", [])
    assert result["timing"]["wires"]["box.frames"] > 1.98 * result["timing"]["scans"]
    assert not any("torque_out of box: this device cannot prove" in note for note in result["notes"]), (
        "its noise proves it new"
    )
    (said,) = [note for note in result["notes"] if "its outputs may fall then" in note]
    assert said.startswith("Brake: this device cannot prove that the lock stays closed")
    assert not any("brake is on: what was ordered" in note for note in result["notes"]), "a contact says so"


@pytest.fixture
def on_libmodbus(tmp_path: Path) -> Iterator[Path]:
    """Two amplifiers, a brake on a coil and remote I/O on libmodbus, with the virtual unit behind them."""
    program = compiled(Path(__file__).with_name("libmodbus_devices.c"), tmp_path)
    folder = Path(shutil.copytree(BENCHES, tmp_path / "benches"))
    (folder / "profiles" / "coil-brake.yaml").write_bytes((DRIVER_PROFILES / "coil-brake.yaml").read_bytes())
    here = write_changed(folder / "two-amplifiers.yaml", folder / "c.yaml", {"bench": {"name": "c", "embedded": False}})
    parts = ("torques", "angles", "brake", "remote_io")
    with served(here) as ready:
        command = [str(program), *(str(ready[part]["port"]) for part in parts)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as devices:
            assert devices.stdin is not None
            assert devices.stdout is not None
            ports = dict(zip(parts, map(int, devices.stdout.readline().split()), strict=True))
            measuring = YAML(typ="safe").load(here)["devices"]
            at: dict[str, object] = {part: {"port": ports[part]} for part in ("brake", "remote_io")}
            at["devices"] = [one | {"port": ports[one["name"]]} for one in measuring]
            at |= {"can": {"port": ready["can"]["port"]}, "pace": ready["pace"]}
            yield write_changed(here, here, at).parent
            devices.stdin.close()


def test_the_main_job_over_devices_on_libmodbus(lostmotion, recipe, truth, on_libmodbus):
    """No Modbus device is of ours here: requests are decoded and answered by libmodbus, in C."""
    result = run_on(lostmotion, recipe, "c", on_libmodbus, ())
    assert (result["verdict"], beyond_its_uncertainty(result, truth)) == ("PASS", [])
    wires, scans = result["timing"]["wires"], result["timing"]["scans"]
    assert min(wires["torques.replies"], wires["angles.replies"]) > 0.95 * scans
    for part in ("torques", "angles", "brake", "remote_io"):
        # an answer that a busy machine keeps for longer than the time-out is missing among the replies, no more
        assert wires[f"{part}.garbage"] == wires[f"{part}.exceptions"] == 0


@pytest.fixture
def rtu_amplifier() -> Iterator[Path]:
    """The virtual bench as a process of its own, its amplifier on a serial line and asked every 10 ms."""
    with tempfile.TemporaryDirectory() as folder:  # names of ports below /dev are refused
        line = {"transport": "rtu", "serial_port": f"{folder}/box", "baudrate": 115200, "unit_id": 1}
        box = {"name": "box", "profile": "virtual-amplifier", "poll_every": "10 ms", "timeout": "20 ms"} | line
        units = {"torque_in": "nm", "torque_out": "nm", "angle_in": "rad", "angle_out": "rad"}
        common = {"device": "box", "alive": "counter", "alive_field": "sample_counter"}
        channels = {name: common | {"field": f"{name}_{unit}"} for name, unit in units.items()}
        here = Path(folder) / "rtu.yaml"
        changes = {
            "bench": {"name": "rtu", "embedded": False},
            "amplifier": None,
            "devices": [box],
            "channels": channels,
        }
        write_changed(VIRTUAL_BENCH, here, changes)
        with served(here) as ready:
            at = {part: {key: ready[part][key] for key in ("host", "port")} for part in ("can", "brake", "remote_io")}
            yield write_changed(here, here, at, {"pace": ready["pace"]}).parent


def test_an_amplifier_on_a_serial_line_that_is_asked_every_10_ms(lostmotion, recipe, truth, rtu_amplifier):
    """A serial line keeps its own time, so no two runs have the same noise: one value in twenty may lie beyond U.

    A value beyond 2 U, or three of nine beyond U, is no chance any more: less than 1 in 100 runs of a sound bench.
    """
    result = run_on(lostmotion, recipe, "rtu", rtu_amplifier, ())
    assert result["verdict"] == "PASS"
    assert beyond_its_uncertainty(result, truth, 2.0) == []
    assert len(beyond_its_uncertainty(result, truth)) < 3
    wires = result["timing"]["wires"]
    assert wires["box.replies"] > 0.095 * PERIOD_MS * result["timing"]["scans"]
    assert wires["box.timeouts"] == wires["box.garbage"] == 0


def test_encoders_that_send_every_20_ms_cost_uncertainty_and_no_stop(lostmotion, recipe, truth, tmp_path):
    folder = Path(shutil.copytree(BENCHES, tmp_path / "benches"))
    bench = folder / "can-sensors.yaml"
    slow = bench.read_text(encoding="utf-8").replace("node_id: 12}", "node_id: 12, update_every: 20 ms}")
    bench.write_text(slow, encoding="utf-8")
    result = run_on(lostmotion, recipe, "can-sensors", folder)
    assert beyond_its_uncertainty(result, truth) == []
    assert result["verdict"] == "NOT DECIDABLE"
    (backlash,) = [one for one in result["metrics"] if one["id"] == "backlash_width_3pct"]
    assert max(backlash["budget"], key=lambda row: row["share"])["quantity"] == "skew"
    wires, scans = result["timing"]["wires"], result["timing"]["scans"]
    assert wires["encoders.frames"] / 2 < 1.1 * scans * PERIOD_MS / 20
