"""Three straight lines through a branch that meet at two break torques: what K1, K2 and K3 are the slopes of.

Source: catalogues of strain wave gears (Harmonic Drive), which divide the torque-torsion curve at T1 and T2.
"""

from __future__ import annotations

import numpy as np

from analysis.units import FloatArray


def three_segments(torque_nm: FloatArray, windup_arcmin: FloatArray, breaks_nm: tuple[float, float]) -> FloatArray:
    """Return the slopes [arcmin per N·m] of the three lines, by least squares of the wind-up over torques from 0 up."""
    first, second = breaks_nm
    columns = (
        np.ones_like(torque_nm),
        np.minimum(torque_nm, first),
        np.clip(torque_nm - first, 0.0, second - first),
        np.maximum(torque_nm - second, 0.0),
    )
    slopes = np.linalg.lstsq(np.column_stack(columns), windup_arcmin, rcond=None)[0][1:]
    return np.asarray(slopes, dtype=np.float64)
