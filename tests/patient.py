"""Short recipes for runs over wires; and patient ones for the wall clock, on a machine that may hold any process up.

On a bench that waits for the scan a hold-up of 100 ms changes nothing, so the limits are the shipped ones
(`brisk_recipe`). By the wall clock, and on a cable, ages, time-outs of the devices and the validity gates are so wide
that it trips nothing; what a test then asserts is what happens and in which order.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from definitions.checks import CHECKS
from definitions.units import FRACTION

ROOT = Path(__file__).parents[1]
GOLDEN_RECIPE = ROOT / "tests" / "proofs" / "golden" / "golden.yaml"
QUICK_RECIPE = ROOT / "recipes" / "rv-40e-121-quick.yaml"
VIRTUAL_BENCH = ROOT / "recipes" / "benches" / "virtual.yaml"

PATIENCE_MS = 500
_AGE = f"{PATIENCE_MS} ms"

Changes = Mapping[str, Any]

PATIENT_INTERLOCKS: Changes = {
    "interlocks": {
        "sample_age": _AGE,
        "drive_age": _AGE,
        "io_age": _AGE,
        "brake_age": _AGE,
        "drive_heartbeat": _AGE,
        "internal_limit": _AGE,
        "missed_in_a_row": PATIENCE_MS,
    }
}
"""At 1 ms; a longer period only makes the last of them longer."""

NOT_ASKED = {"efficiency_high"} | {name for name, check in CHECKS.items() if check.at_least}
"""Gates that no hold-up moves; of a least value 100 % would be the strictest limit there is."""

OPEN_GATES: Changes = {
    "sampling": {"missed_periods": "100 %", "sample_age": _AGE},
    "validity": {"points_per_bin": 1}
    | {
        name: "100 %"
        for name, check in CHECKS.items()
        if check.settable and check.kind is FRACTION and name not in NOT_ASKED
    },
}
"""What a hold-up leaves of a loop that takes a second is not what these tests are about."""

TIMING_GATES = frozenset({"missed_periods", "sample_age"})
HELD_UP_GATES = TIMING_GATES | {"ramp_rate", "interrupted", "points_per_bin", "noise_low", "noise_high"}
"""Gates that a process which was held up makes fail: periods and samples are missing, and a ramp stood or jumped.

Where one of timing has failed, so much is missing that any other may as well.
"""

EVERY_STATE: Changes = {
    "recipe": {"name": "every-state"},
    "sampling": {"period": "1 ms"},
    "sequence": [
        {"home": {"tare_time": "100 ms", "torque_in_tare": "0.05 N·m", "torque_out_tare": "5 N·m"}},
        {
            "lock": {
                "holding_torque": "600 N·m",
                "proof_torque": "5 %",
                "proof_time": "50 ms",
                "max_motion": "0.2 arcmin",
            }
        },
        {"calibrate": {"peak_torque": "15 %", "torque_rate": "600 N·m/s", "dwell": "20 ms"}},
        {"torque_cycles": {"count": 1, "peak_torque": "15 %", "torque_rate": "600 N·m/s", "dwell": "20 ms"}},
        {"unload": {"torque_rate": "600 N·m/s"}},
        {"release": {"max_torque": "3 %"}},
    ],
    "metrics": [{"id": "torque_ratio_slope", "min": 50}, {"id": "torque_ratio_offset", "min": "-25 N·m"}],
}
"""Through every state in 9 s. It has limits and a P1 passes them: or no broken-off run could pass wrongly."""

ONE_RAMP: Changes = {
    "recipe": {"name": "one-ramp"},
    "sampling": {"period": "4 ms"},
    "measurement": {"output_torque": "reaction", "reference_torque": "60 %"},
    "sequence": [
        *EVERY_STATE["sequence"][:2],
        {"torque_cycles": {"count": 1, "peak_torque": "80 %", "torque_rate": "250 N·m/s", "dwell": "40 ms"}},
        {"unload": {"torque_rate": "400 N·m/s"}},
        {"release": {"max_torque": "1 %"}},
    ],
    "interlocks": {"torque_out_alarm": "110 %", "torque_out_trip": "120 %"},
    "metrics": [{"id": "windup"}],
}
"""Without a calibration, up to 330 N·m: for what happens in the first ramp, 3 s after the start.

Its torque is what the tests are about and not the number of its scans: at 4 ms they are a quarter of those at 1 ms.
"""


def write_changed(source: Path, target: Path, *changes: Changes) -> Path:
    """Write a recipe or bench file with sections changed: options of a section are replaced one by one, lists whole.

    None takes a section out.
    """
    document = YAML(typ="safe").load(source)
    for change in changes:
        for section, options in change.items():
            document[section] = {**document.get(section, {}), **options} if isinstance(options, Mapping) else options
    document = {section: options for section, options in document.items() if options is not None}
    with target.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(document, stream)
    return target


def brisk_recipe(folder: Path, *changes: Changes) -> Path:
    """Write a short recipe with the limits of a shipped one: through every state, unless `changes` say otherwise."""
    return write_changed(GOLDEN_RECIPE, folder / "brisk.yaml", EVERY_STATE, *changes)


def short_recipe(folder: Path, *changes: Changes) -> Path:
    """Write a short and patient recipe: through every state, unless `changes` say something else."""
    return write_changed(GOLDEN_RECIPE, folder / "short.yaml", EVERY_STATE, PATIENT_INTERLOCKS, OPEN_GATES, *changes)


def patient_bench(folder: Path, *changes: Changes) -> Path:
    """Write the shipped virtual bench with devices that wait; its name and its sensors are the same."""
    waiting: dict[str, Any] = {part: {"timeout": _AGE} for part in ("amplifier", "brake", "remote_io")}
    waiting |= {"drive": {"controller_heartbeat_timeout": _AGE, "setpoint_timeout": _AGE}}
    return write_changed(VIRTUAL_BENCH, folder / "patient-bench.yaml", waiting, *changes)


def wrong_verdict(result: Mapping[str, Any]) -> str:
    """What is wrong with the verdict of a good unit: neither PASS nor NOT DECIDABLE for exactly those gates."""
    failed = {gate["id"] for gate in result["gates"] if gate["passed"] is False}
    reasons = result["reasons"]
    named = len(reasons) == len(failed) and all(any(f" {gate}: " in reason for reason in reasons) for gate in failed)
    of_the_machine = failed <= HELD_UP_GATES or bool(failed & TIMING_GATES)
    if of_the_machine and named and result["verdict"] == ("NOT DECIDABLE" if failed else "PASS"):
        return ""
    return f"{result['verdict']}: {'; '.join(reasons)}"


def patient_scenario(source: Path, folder: Path) -> Path:
    """Write a shipped scenario with as much more time for every reaction as recipe and bench allow themselves.

    Its verdict is left to `wrong_verdict`.
    """
    document = YAML(typ="safe").load(source)
    document["expect"] = [clause for clause in document["expect"] if "verdict" not in clause]
    for clause in document["expect"]:
        if "within_s" in clause:
            clause["within_s"] += 2e-3 * PATIENCE_MS
        if clause.get("within_scans"):  # 0 means the very scan of the alarm: that stays
            clause["within_scans"] += 2 * PATIENCE_MS
    target = folder / source.name
    with target.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(document, stream)
    return target
