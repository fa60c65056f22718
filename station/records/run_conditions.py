"""Conditions of stored runs, read from a few of their channels: housing temperature, position of the lock."""

from __future__ import annotations

import math

import numpy as np

from definitions.states import LOADED
from station.errors import StationError
from station.records.program_file import StoredProgram
from station.records.run_record import RunRecord
from station.records.samples.samples import channel_values

LOOKED_AT = 512
"""Records that a mean temperature is taken of: a housing warms within minutes, not within scans."""


def housing_temperature_c(run: RunRecord) -> float:
    """Return the mean temperature of the housing while the run measured [°C]; StationError when there is none."""
    state, temperature = channel_values(run, [("orders", "state"), ("image", "housing_temp_c")])
    if not state.size:
        raise StationError(f"{run.id}: the run has no records")
    step = max(1, state.size // LOOKED_AT)
    values = temperature[::step][np.isin(state[::step], sorted(LOADED))]
    if not values.size or not np.isfinite(values).all():
        raise StationError(f"{run.id}: the run has no temperature of the housing while it measured")
    return float(values.mean())


def lock_position_deg(run: RunRecord) -> float:
    """Return where the locked shaft stood when the lock had closed [° of that shaft, by its encoder's reference]."""
    locked_output = StoredProgram.of(run).loading_input
    (zero,) = channel_values(run, [("orders", "angle_out_zero_rad" if locked_output else "angle_in_zero_rad")])
    if not zero.size:
        raise StationError(f"{run.id}: the run has no records")
    return math.degrees(float(zero[-1]))
