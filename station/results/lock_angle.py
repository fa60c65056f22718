"""Where the shaft was locked that a run held: the angle that its values are of."""

from __future__ import annotations

import math

import numpy as np

from definitions.states import LOADED
from station.records.samples.table import Table

TURN_DEG = 360.0


def lock_angle_deg(table: Table, *, loading_input: bool) -> float | None:
    """Return where the locked shaft stood when it was loaded first, from 0 to 360 [° of that shaft, by its encoder].

    None where the run did not come to loading, or no encoder says it. loading_input: the output is locked.
    """
    orders = table["orders"]
    loaded = np.flatnonzero(np.isin(orders["state"], sorted(LOADED)))
    if not loaded.size:
        return None
    zero_rad = float(orders["angle_out_zero_rad" if loading_input else "angle_in_zero_rad"][loaded[0]])
    if not math.isfinite(zero_rad):
        return None
    angle = math.degrees(zero_rad) % TURN_DEG
    return 0.0 if angle == TURN_DEG else angle  # a little below zero is rounded to a whole turn
