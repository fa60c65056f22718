"""Sensors that are wrong in a way no interlock sees: the run comes to its end, and what it measured is not judged."""

from __future__ import annotations

from pathlib import Path

import pytest

BOTH_TORQUES = ("sensor.torque_out", "sensor.torque_in")
LATE = {"torque_lines", "drive_torque_gap", "late_torque", "noise_low"}
LATE_OUT = {"late_torque", "noise_low", "calibration_agreement"}
WRONG = {
    "torques late by 150 ms": ("worn", BOTH_TORQUES, "verb: lag, value: 0.15", LATE),
    "output torque late by 40 ms": ("worn", BOTH_TORQUES[:1], "verb: lag, value: 0.04", LATE_OUT),
    "torques a quarter too large": ("soft", BOTH_TORQUES, "verb: scale, value: 1.25", {"drive_torque_agreement"}),
    "locked encoder turned round": ("P1", ("sensor.angle_out",), "verb: flip", {"locked_compliance"}),
    "locked encoder stands": ("worn", ("sensor.angle_out",), "verb: stuck", {"locked_compliance"}),
}
"""What is wrong: unit, channels, deed, and the gates that must see it."""


@pytest.mark.parametrize("what", WRONG)
def test_what_no_interlock_sees_is_not_judged(lostmotion, quarter, tmp_path: Path, what: str) -> None:
    unit, targets, deed, gates = WRONG[what]
    lines = [f"  - {{target: {target}, {deed}, when: {{scan: 5}}}}" for target in targets]
    scenario = tmp_path / "wrong.yaml"
    scenario.write_text("\n".join(["scenario: {name: wrong}", "faults:", *lines, ""]), encoding="utf-8")
    words = ("--virtual-time", "--json", "--unit", unit, "--serial", "W", "--scenario", str(scenario))
    ran = lostmotion("run", quarter("rv-40e-121-quick"), *words)
    assert (ran.exit_code, ran.json["state"], ran.json["verdict"]) == (3, "complete", "NOT DECIDABLE")
    assert {gate["id"] for gate in ran.json["gates"] if gate["passed"] is False} == gates
