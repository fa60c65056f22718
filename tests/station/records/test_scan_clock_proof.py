"""By the clock that waits for the scan a verdict is for virtual units only, and the proof of timing has to show it."""

from __future__ import annotations

from typing import Any

import pytest
from made_documents import timing

from station.records.timing_proof import FRAMES_ON_THEIR_WAY, objections_to_clock

WHOLE = {"unit": "P1", "frames_received": 1000, "frames_sent_by_bench": 1000}


@pytest.mark.parametrize(
    ("clock", "pace", "objections"),
    [
        ("scan", WHOLE, 0),
        ("scan", WHOLE | {"frames_received": 1000 + FRAMES_ON_THEIR_WAY}, 0),
        ("scan", WHOLE | {"frames_received": 400}, 0),
        ("scan", WHOLE | {"unit": ""}, 1),
        ("scan", {}, 1),
        ("scan", WHOLE | {"frames_sent_by_bench": 10}, 1),
        ("wall", {}, 0),
        ("real", {}, 0),
        ("virtual", {}, 0),
    ],
)
def test_only_a_virtual_unit_is_judged_by_the_scan_clock(clock: str, pace: dict[str, Any], objections: int) -> None:
    assert len(objections_to_clock(timing(clock=clock, pace=pace))) == objections
    assert len(objections_to_clock(timing(clock=clock))) == (clock == "scan")
