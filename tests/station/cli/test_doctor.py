"""`lostmotion doctor`: every look at this machine, and the exit code that says whether something is in the way."""

from __future__ import annotations

import json

from lostmotion_command import here

from station.scan.machine import CHECKS, look


def test_every_look_is_told_with_its_mend() -> None:
    findings = look()
    assert len(findings) == len(CHECKS)
    said = here("doctor")
    assert said.exit_code == int(any(not one.in_order for one in findings))
    for one in findings:
        assert one.name in said.out
        assert one.in_order or f"{one.name}: " in said.out
    found = json.loads(here("doctor", "--json").out)
    assert [(one["name"], one["in_order"]) for one in found] == [(one.name, one.in_order) for one in findings]
