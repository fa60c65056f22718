"""Units of the field beside SI, and the array type of this package."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

RAD_PER_ARCMIN = math.pi / 10_800.0
"""1 arcmin in rad; also 1 N·m·arcmin in J."""

ARCMIN_PER_RAD = 1.0 / RAD_PER_ARCMIN
"""1 rad in arcmin: 3437.747."""
