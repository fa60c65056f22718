"""Two power cuts, one before and one in the load; many at random moments are `make power-cuts`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lostmotion_command import here
from power_cuts import Drill, wrong_end

from definitions.image import State
from station.records.samples.layout import CURRENT
from station.records.samples.table import Table


def asked_here(*args: str) -> tuple[int, Any]:
    ran = here(*args, "--json")
    return ran.exit_code, ran.json if ran.out else {}


LOADED, SILENT = int(State.RAMP_POS), list(range(500))


def cut_in(state: State, silent: list[int]) -> Table:
    """Records that end in a state; before, drive and amplifier were silent for so many scans."""
    table = Table(np.zeros(2000, CURRENT.dtype))
    table["orders"]["state"][:] = LOADED
    table["orders"]["state"][-100:] = int(state)
    table["orders"]["fault"][-100:] = state == State.FAULT
    for age in ("drive_age_scans", "sample_age_scans"):
        table["image"][age][1900 - len(silent) : 1900] = silent
    return table


@pytest.mark.parametrize(
    ("table", "state", "verdict", "finished", "sound"),
    [
        (None, "interrupted", None, False, True),
        (cut_in(State.RAMP_POS, []), "interrupted", None, False, True),
        (cut_in(State.RAMP_POS, []), "complete", None, False, False),
        (cut_in(State.STOPPED, []), "stopped", None, False, True),
        (cut_in(State.COMPLETE, []), "complete", None, False, True),
        (cut_in(State.COMPLETE, []), "interrupted", None, False, False),
        (cut_in(State.COMPLETE, []), "complete", "PASS", False, False),
        (cut_in(State.COMPLETE, []), "complete", "PASS", True, True),
        (cut_in(State.FAULT, SILENT), "fault", None, False, True),
        (cut_in(State.FAULT, []), "fault", None, False, False),
        (cut_in(State.RAMP_POS, SILENT), "fault", None, False, False),
    ],
)
def test_a_run_that_was_cut_off_has_the_state_of_its_last_record(table, state, verdict, finished, sound):
    shown = {"verdict": verdict, "alarms": [{"id": "sample_stale", "first": True}] if state == "fault" else []}
    wrong, machine = wrong_end(state, shown, table, finished=finished)
    assert (not wrong) is sound
    assert bool(machine) is (sound and state == "fault")


@pytest.mark.wires
def test_after_a_power_cut_the_run_is_found_and_what_it_left_is_said(tmp_path):
    drill = Drill(tmp_path, asked_here, "4 ms")  # where it is cut off counts, and not after how many scans
    found, wrong = drill.cut(4.0, ring_too=True, loaded=True)
    assert not wrong, wrong
    assert "interrupted" in found
    assert "N·m at the output" in found
    found, wrong = drill.cut(1.5, ring_too=False, loaded=False)
    assert not wrong, wrong
