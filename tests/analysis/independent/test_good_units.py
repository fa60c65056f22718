"""Good units are not refused, whatever their trace has or lacks; the table counts what is."""

from __future__ import annotations

from collections import Counter

from benchmarks.good_units import PASSED, Case, study, table
from benchmarks.simulated.kinds import KINDS

ALONE = Case(segments=False, dwells=False, calibration=False, torque_in=False)


def test_a_good_unit_of_each_type_passes_by_torque_and_angles_alone() -> None:
    found = study(len(KINDS))
    assert found[ALONE] == Counter({PASSED: len(KINDS)})


def test_what_was_refused_is_counted_by_its_reason() -> None:
    text = table({ALONE: Counter({PASSED: 3, "noise_high": 2})})
    assert "| torque and angles alone | 5 | 3 | 2 × noise_high |" in text
    assert "5 good units of six types: 3 PASS." in text
