"""A run counts as tripped by the machine only where its record proves it."""

from __future__ import annotations

import numpy as np
import pytest
from machine_trips import tripped_by_the_machine

from definitions.image import AGE_NEVER
from station.records.samples.layout import CURRENT
from station.records.samples.table import Table

ALARM_AT = 2000


def records(**image: list[int]):
    """Records with a fault from ALARM_AT on; values of the image end at the alarm."""
    table = Table(np.zeros(ALARM_AT + 100, CURRENT.dtype))
    table["orders"]["fault"][ALARM_AT:] = 9
    for name, values in image.items():
        table["image"][name][ALARM_AT + 1 - len(values) : ALARM_AT + 1] = values
    return table


GROWS = list(range(501))
GROWS_TOO_LITTLE = list(range(401))


@pytest.mark.parametrize(
    ("cause", "image", "proven"),
    [
        ("missed_periods", {"missed_periods": [501]}, True),
        ("missed_periods", {}, False),
        ("drive_emergency", {"missed_periods": [620, *[0] * 900]}, True),
        ("drive_emergency", {"missed_periods": [620, *[0] * 1500]}, False),
        ("drive_fault", {"missed_periods": [6]}, False),
        ("sample_stale", {"drive_age_scans": GROWS, "sample_age_scans": GROWS}, True),
        ("sample_stale", {"sample_age_scans": GROWS}, False),
        ("drive_data_stale", {"drive_age_scans": GROWS}, False),
        ("drive_dropped_out", {"drive_age_scans": GROWS_TOO_LITTLE, "sample_age_scans": GROWS_TOO_LITTLE}, False),
        ("drive_dropped_out", {"drive_age_scans": GROWS, "sample_age_scans": GROWS}, True),
        ("sample_stale", {"drive_age_scans": [AGE_NEVER], "sample_age_scans": [AGE_NEVER]}, False),
        ("lock_slip", {"drive_age_scans": GROWS, "sample_age_scans": GROWS, "missed_periods": [600]}, False),
    ],
)
def test_a_hold_up_must_stand_in_the_record(cause, image, proven):
    assert bool(tripped_by_the_machine(records(**image), cause)) is proven


def test_a_run_without_an_alarm_was_tripped_by_nobody():
    assert not tripped_by_the_machine(Table(np.zeros(10, CURRENT.dtype)), "missed_periods")
