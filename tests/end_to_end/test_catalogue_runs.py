"""Runs of models that are in no table of units: the unit on the virtual bench is made of the recipe's own values."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import pytest
from lostmotion_command import ROOT, Ran, here
from ruamel.yaml import YAML
from run_samples import recorded

RECIPE = ROOT / "recipes" / "rv-40e-121-quick.yaml"
BENCH = ROOT / "recipes" / "benches" / "virtual.yaml"


class Model(NamedTuple):
    """A model by its recipe's values, and the sensors and servo of a bench that can load it; torques in N·m."""

    name: str
    ratio: int
    rated_nm: float
    stiffness: float
    slope: float
    offset_nm: float
    sensor_in_nm: float
    sensor_out_nm: float

    def recipe(self, folder: Path) -> Path:
        torque = self.rated_nm / 412.0
        document = YAML(typ="safe").load(RECIPE)
        document["recipe"]["name"] = self.name.lower()
        document["sampling"]["period"] = "2 ms"  # half of the scans; at 4 ms a bin has too few samples
        document["unit_under_test"] = {
            "model": self.name,
            "ratio": self.ratio,
            "rated_torque": f"{self.rated_nm} N·m",
            "stiffness": f"{self.stiffness} N·m/arcmin",
            "loading_torque_ratio": {"slope": self.slope, "offset": f"{self.offset_nm} N·m"},
        }
        document["sequence"] = [
            {
                "home": {
                    "tare_time": "100 ms",
                    "torque_in_tare": f"{self.sensor_in_nm / 20} N·m",
                    "torque_out_tare": f"{self.sensor_out_nm / 50} N·m",
                }
            },
            {"lock": {"holding_torque": f"{600 * torque} N·m", "proof_torque": "10 %", "max_motion": "0.2 arcmin"}},
            {"calibrate": {"peak_torque": "110 %", "torque_rate": f"{240 * torque} N·m/s", "dwell": "50 ms"}},
            {"torque_cycles": {"count": 1, "peak_torque": "110 %", "torque_rate": f"{240 * torque} N·m/s"}},
            {"unload": {"torque_rate": f"{250 * torque} N·m/s"}},
            {"release": {"max_torque": "2 %"}},
        ]
        document["interlocks"]["torque_in_trip"] = f"{1.05 * self.sensor_in_nm} N·m"
        document["metrics"] = [
            {"id": "backlash_width_3pct", "max": "1 arcmin"},
            {"id": "lost_motion", "max": "1 arcmin"},
            {"id": "spring_constant", "min": f"{1.05 * self.stiffness} N·m/arcmin"},
        ]
        del document["validity"]
        return written(folder / "recipe.yaml", document)

    def bench(self, folder: Path) -> Path:
        document = YAML(typ="safe").load(BENCH)
        torque = self.sensor_out_nm / 1000.0
        document["bench"]["name"] = "made-for-" + self.name.lower()
        document["sensors"]["torque_in"]["full_scale"] = f"{self.sensor_in_nm} N·m"
        document["sensors"]["torque_out"]["full_scale"] = f"{self.sensor_out_nm} N·m"
        document["fixture"]["stiffness"] = f"{10_000 * torque} N·m/arcmin"
        document["brake"]["torque_constant"] = f"{100 * torque} N·m/A"
        document["drive"]["rated_torque"] = f"{0.4 * self.sensor_in_nm} N·m"
        document["drive"]["max_torque"] = f"{1.1 * self.sensor_in_nm} N·m"
        document["drive"]["torque_slope"] = f"{4 * self.sensor_in_nm} N·m/s"
        return written(folder / "bench.yaml", document)


MODELS = (
    Model("RV-20E-81", 81, 167.0, 49.0, 64.0, -5.5, 5.0, 500.0),
    Model("RV-80E-101", 101, 784.0, 196.0, 79.0, -26.0, 13.0, 2000.0),
    Model("RV-160E-145", 145, 1568.0, 392.0, 113.0, -53.0, 20.0, 4000.0),
)


def written(path: Path, document: Any) -> Path:
    with path.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(document, stream)
    return path


def run(model: Model, folder: Path, *more: str) -> Ran:
    words = ("--bench", str(model.bench(folder)), "--serial", "C", "--virtual-time", "--json", "--no-report")
    return here("run", str(model.recipe(folder)), *words, "--data", str(folder / "runs"), *more)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_a_model_of_no_table_gets_a_good_unit_and_says_so(model: Model, tmp_path: Path):
    ran = run(model, tmp_path)
    assert ran.exit_code == 0, ran
    result = ran.json
    assert result["verdict"] == "PASS", result["reasons"]
    assert result["unit"] == {"model": model.name, "virtual": "catalogue", "noise_seed": 1}
    values = {(row["id"], row["side"]): row["value"] for row in result["metrics"]}
    assert values["backlash_width_3pct", "+"] == pytest.approx(0.94, abs=0.03)
    assert values["spring_constant", "+"] == pytest.approx(1.156 * model.stiffness, rel=0.03)


@pytest.mark.parametrize(
    ("unit", "failed"), [("worn", "backlash_width_3pct"), ("soft", "spring_constant"), ("cracked", "spring_constant")]
)
def test_a_bad_unit_of_such_a_model_fails_for_its_defect(unit: str, failed: str, tmp_path: Path):
    ran = run(MODELS[1], tmp_path, "--unit", f"catalogue-{unit}")
    assert ran.exit_code == 1, ran
    assert {row["id"] for row in ran.json["metrics"] if row["verdict"] == "FAIL"} == {failed}


def test_a_repeat_is_a_repeat_and_a_seed_makes_the_same_run_again(tmp_path: Path):
    golden = str(ROOT / "tests" / "proofs" / "golden" / "golden.yaml")
    words = ("--serial", "S", "--virtual-time", "--json", "--no-report", "--data", str(tmp_path))
    found = [here("run", golden, *words, "--seed", seed).json for seed in ("7", "7", "8")]
    samples = [recorded(Path(result["record"])) for result in found]
    assert [result["unit"]["noise_seed"] for result in found] == [7, 7, 8]
    assert samples[0] == samples[1] != samples[2]
