"""Stiffness over the eccentricity of the cycloidal disc: K = k·a^p, by a straight line through the logarithms.

Source: "static testing system", table 2 (finite elements). Its printed law K ∝ 1/a² has the wrong sign: its own figures
rise with a, and K ∝ a² gives the printed deflections back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from analysis.trace.errors import AnalysisError

SQUARE_LAW = 2.0


class EccentricityRow(NamedTuple):
    """Eccentricity [mm], torque [N·m] and the deflection it gives [rad]."""

    eccentricity_mm: float
    torque_nm: float
    deflection_rad: float


PUBLISHED = (
    EccentricityRow(1.2, 100.0, 0.0012),
    EccentricityRow(1.3, 100.0, 0.0010),
    EccentricityRow(1.4, 100.0, 0.0008),
)
"""Table 2 of the "static testing system"."""


@dataclass(frozen=True)
class EccentricityTrend:
    """K = coefficient · a^exponent, K in N·m/rad and a in mm; u_exponent 0 when the exponent was given.

    residual: standard deviation of ln K about the line (0 when nothing is left to estimate it from).
    """

    coefficient: float
    exponent: float
    u_exponent: float
    residual: float

    def stiffness_nm_per_rad(self, eccentricity_mm: float) -> float:
        """Stiffness [N·m/rad] at an eccentricity [mm]."""
        return self.coefficient * math.pow(eccentricity_mm, self.exponent)

    def deflection_rad(self, eccentricity_mm: float, torque_nm: float) -> float:
        """Deflection [rad] under a torque [N·m]."""
        return torque_nm / self.stiffness_nm_per_rad(eccentricity_mm)


def eccentricity_trend(rows: Sequence[EccentricityRow], exponent: float | None = SQUARE_LAW) -> EccentricityTrend:
    """Fit the trend; exponent None estimates it too, with its standard uncertainty.

    Raises AnalysisError for fewer than 2 rows (3 with a free exponent), numbers that are not above zero, or a free
    exponent with one eccentricity only.
    """
    least = 3 if exponent is None else 2
    if len(rows) < least:
        raise AnalysisError(f"eccentricity: found {len(rows)} rows; expected {least} or more. Add rows")
    for number, row in enumerate(rows, start=1):
        if not all(math.isfinite(value) and value > 0.0 for value in row):
            raise AnalysisError(f"eccentricity: row {number} is {tuple(row)}; expected numbers above zero")
    x = np.log([row.eccentricity_mm for row in rows])
    y = np.log([row.torque_nm / row.deflection_rad for row in rows])
    if exponent is not None:
        level = float((y - exponent * x).mean())
        residual = float(np.sqrt(np.square(y - level - exponent * x).sum() / (x.size - 1)))
        return EccentricityTrend(math.exp(level), exponent, 0.0, residual)
    spread = float(np.square(x - x.mean()).sum())
    if spread <= 1e-12:
        raise AnalysisError("eccentricity: every row has the same eccentricity; expected different ones. Add a row")
    slope = float(((x - x.mean()) * y).sum()) / spread
    level = float(y.mean()) - slope * float(x.mean())
    residual = float(np.sqrt(np.square(y - level - slope * x).sum() / (x.size - 2)))
    return EccentricityTrend(math.exp(level), slope, residual / math.sqrt(spread), residual)
