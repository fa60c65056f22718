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
