"""Two power cuts, one before and one in the load; many at random moments are `make power-cuts`."""

from __future__ import annotations

from typing import Any

import pytest
from lostmotion_command import here
from power_cuts import Drill

pytestmark = pytest.mark.wires


def asked_here(*args: str) -> tuple[int, Any]:
    ran = here(*args, "--json")
    return ran.exit_code, ran.json if ran.out else {}


def test_after_a_power_cut_the_run_is_found_and_what_it_left_is_said(tmp_path):
    drill = Drill(tmp_path, asked_here)
    found, wrong = drill.cut(4.0, ring_too=True, loaded=True)
    assert not wrong, wrong
    assert "interrupted" in found
    assert "N·m at the output" in found
    found, wrong = drill.cut(1.5, ring_too=False, loaded=False)
    assert not wrong, wrong
