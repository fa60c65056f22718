"""Runs that the machine tripped: it gave the scan or the virtual bench no time, and the record of the run proves it.

A killed run is asked for its records, not for the time that a busy machine gave it. But a trip counts as the machine's
only where the records before the alarm show the hold-up itself: periods that the scan missed, or a bench whose drive
and amplifier, two devices on two wires, were silent together while the scan went on asking.
"""

from __future__ import annotations

import numpy as np

from definitions.image import AGE_NEVER
from station.records.samples.table import Table

LOOKED_AT = 1000
"""Records before the alarm that are looked at: a hold-up acts at once, or by a device's time-out of up to 500 ms."""

HELD_UP: dict[str, int] = {
    "missed_periods": 500,
    "drive_emergency": 490,
    "drive_fault": 490,
    "drive_dropped_out": 490,
    "drive_data_stale": 490,
}
"""What a scan that was held up leads to, and the least periods of 1 ms that it must have missed in one hold-up.

The recipe of the drills allows 500 in a row; the drive waits 500 ms for set-points.
"""

BENCH_STOOD: dict[str, int] = {
    "sample_stale": 490,
    "sample_frozen": 490,
    "drive_data_stale": 490,
    "drive_heartbeat_lost": 490,
    "remote_io_lost": 490,
    "brake_link_lost": 490,
    "drive_emergency": 490,
    "drive_fault": 490,
    "drive_dropped_out": 490,
}
"""What a virtual bench that stood still leads to, and the least scans of silence: its drive misses set-points too."""


def tripped_by_the_machine(table: Table, cause: str) -> str:
    """Return in words how the machine tripped a run, "" where its record does not prove it."""
    alarms = np.flatnonzero(table["orders"]["fault"])
    if not len(alarms):
        return ""
    before = table[max(int(alarms[0]) + 1 - LOOKED_AT, 0) : int(alarms[0]) + 1]["image"]
    missed = int(before["missed_periods"].max())
    if missed >= HELD_UP.get(cause, np.inf):
        return f"{cause}: the scan was held up for {missed} periods"
    ages = np.minimum(before["drive_age_scans"], before["sample_age_scans"]).astype(np.int64)
    silent = int(ages[ages < AGE_NEVER].max(initial=0))
    if silent >= BENCH_STOOD.get(cause, np.inf):
        return f"{cause}: the whole bench stood still for {silent} scans"
    return ""
