"""The main job on benches whose channels come from other devices, over real wires, on the bench's own clock.

Every value is held against what is true of the virtual unit: the same recipe in virtual time, evaluated from torque and
wind-up inside the unit.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from patient import QUICK_RECIPE

from benchmarks.slow_amplifier import bench_of, samples
from station.bench.request import load_job

pytestmark = pytest.mark.wires
BENCHES = Path(__file__).parents[1] / "data" / "benches"


@pytest.fixture(scope="module")
def truth() -> dict[str, float]:
    """What is true of P1 in this recipe, by metric and side."""
    job = load_job(str(QUICK_RECIPE), "virtual")
    return samples(job, bench_of(job, 1), None)[2]


def beyond_its_uncertainty(result: dict, truth: dict[str, float]) -> list[str]:
    """The values of a result that are farther from the truth than their U; all metrics of the truth must be there."""
    sides = {f"{m['id']} {name}": side for m in result["metrics"] for name, side in m["sides"].items()}
    assert set(truth) <= set(sides)
    return [
        f"{name}: {sides[name]['value']} ± {sides[name]['uncertainty']}, true {true}"
        for name, true in truth.items()
        if abs(sides[name]["value"] - true) > sides[name]["uncertainty"]
    ]


def run_on(lostmotion, bench: str) -> dict:
    """The result of the quick recipe on a bench."""
    ran = lostmotion(
        "run", str(QUICK_RECIPE), "--bench", str(BENCHES / f"{bench}.yaml"), "--seed", "1", "--serial", "P1-0001",
        "--json", "--pace", "fast", "--no-report",
    )  # fmt: skip
    assert (ran.exit_code, ran.json["state"], ran.json["verdict"]) == (0, "complete", "PASS"), ran.json["reasons"]
    return ran.json


def test_two_amplifiers_of_swapped_floats_and_a_brake_that_is_a_coil(lostmotion, truth):
    result = run_on(lostmotion, "two-amplifiers")
    assert beyond_its_uncertainty(result, truth) == []
    wires = result["timing"]["wires"]
    assert wires["torques.replies"] > 0.95 * result["timing"]["scans"]
    assert wires["angles.replies"] > 0.95 * result["timing"]["scans"], "two blocks, one after the other"
    said = " ".join(result["notes"])
    for unproven in ("brake_current_lost", "set to by hand", "torques: no identity"):
        assert unproven in said
    assert "angles: no identity" not in said


def test_torques_and_angles_of_two_canopen_sensors(lostmotion, truth):
    """A transducer that sends every millisecond in its own time, and encoders that answer SYNC."""
    result = run_on(lostmotion, "can-sensors")
    assert beyond_its_uncertainty(result, truth) == []
    wires, scans = result["timing"]["wires"], result["timing"]["scans"]
    assert min(wires["flange.frames"], wires["encoders.frames"] / 2) > 0.99 * scans
    assert wires["flange.malformed"] == wires["encoders.malformed"] == wires["can.frames_foreign"] == 0
    assert any("Channel angle_in of encoders: not proven" in note for note in result["notes"])


def test_raw_frames_that_a_dbc_file_describes(lostmotion, truth):
    result = run_on(lostmotion, "can-dbc")
    assert beyond_its_uncertainty(result, truth) == []
    assert result["timing"]["wires"]["box.frames"] > 1.98 * result["timing"]["scans"]
    assert not any("torque_out of box: not proven" in note for note in result["notes"]), "its noise proves it new"
