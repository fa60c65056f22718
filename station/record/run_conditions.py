"""Conditions of stored runs, read from a few of their records: housing temperature, position of the lock."""

from __future__ import annotations

import math

import numpy as np

from station.errors import StationError
from station.record.check import RECORD_DTYPE, Table
from station.record.run_record import RunRecord
from station.record.timing_proof import MEASURING_STATES

LOOKED_AT = 512
"""Records that a mean temperature is taken of: a housing warms within minutes, not within scans."""


def _table(run: RunRecord) -> Table:
    count = run.records()
    if not count:
        raise StationError(f"{run.id}: the run has no records")
    try:
        return np.memmap(run.samples, dtype=RECORD_DTYPE, mode="r", shape=(count,))
    except (OSError, ValueError) as error:
        raise StationError(f"{run.samples}: cannot be read: {error}") from error


def housing_temperature_c(run: RunRecord) -> float:
    """Return the mean temperature of the housing while the run measured [°C]; StationError when there is none."""
    table = _table(run)
    some = table[:: max(1, len(table) // LOOKED_AT)]
    kept = some[np.isin(some["orders"]["state"], MEASURING_STATES)]
    values = kept["image"]["housing_temp_c"]
    if not values.size or not np.isfinite(values).all():
        raise StationError(f"{run.id}: the run has no temperature of the housing while it measured")
    return float(values.mean())


def lock_position_deg(run: RunRecord) -> float:
    """Return where the locked shaft stood when the lock had closed [° of that shaft, by its encoder's reference]."""
    last = _table(run)[-1]
    locked_output = bool(run.read_json("program.json").get("loading_input", True))
    zero = last["orders"]["angle_out_zero_rad" if locked_output else "angle_in_zero_rad"]
    return math.degrees(float(zero))
