"""The elastic wind-up of a unit. Apart from the plant's numbers: who only looks a unit up needs no compiler."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from virtual_bench.physics.decay import decay
from virtual_bench.physics.units import Unit

FloatArray = npt.NDArray[np.float64]


def elastic_windup_arcmin(unit: Unit, torque_nm: FloatArray) -> FloatArray:
    """Return the elastic wind-up over torque: linear part, soft contact at low torque, gap."""
    magnitude, sign = np.abs(torque_nm), np.sign(torque_nm)
    stiffness = np.where(torque_nm >= 0.0, unit.stiffness_positive_nm_per_arcmin, unit.stiffness_negative_nm_per_arcmin)
    soft = unit.soft_arcmin * sign * (1.0 - decay(magnitude / unit.soft_torque_nm))
    closing = decay(2.0 * magnitude / unit.gap_torque_nm)  # tanh x = (1 − exp(−2x)) / (1 + exp(−2x))
    gap = unit.gap_arcmin / 2.0 * sign * (1.0 - closing) / (1.0 + closing)
    windup: FloatArray = torque_nm / stiffness + soft + gap
    return windup
