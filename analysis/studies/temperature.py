"""A metric over temperature: slope per °C over runs, with its uncertainty, and the value at a reference temperature."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads special where it is used

from analysis.line.samples import checked_level, checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

LEAST_RUNS = 4
LEAST_SPAN_C = 2.0
"""Over less than this, the slope is the noise of the thermometer."""

REFERENCE_C = 20.0
"""Reference temperature of dimensional metrology (ISO 1)."""


@dataclass(frozen=True)
class TemperatureTrend:
    """Straight line of a metric over temperature.

    at_reference and its standard uncertainty at reference_c; slope_per_c with standard uncertainty and interval;
    p_none: probability of such a slope if temperature did nothing; residual_sd of runs about the line; low_c, high_c:
    temperatures that were measured.
    """

    slope_per_c: float
    u_slope_per_c: float
    slope_low: float
    slope_high: float
    p_none: float
    at_reference: float
    u_at_reference: float
    reference_c: float
    residual_sd: float
    low_c: float
    high_c: float
    runs: int

    def corrected(self, value: float, temperature_c: float) -> float:
        """Value of a run at the reference temperature; AnalysisError more than the measured span outside of it."""
        span = self.high_c - self.low_c
        if not self.low_c - span <= temperature_c <= self.high_c + span:
            raise AnalysisError(
                f"temperature: {temperature_c:g} °C is too far outside the temperatures of the slope, {self.low_c:g} "
                "to "
                f"{self.high_c:g} °C; measure runs near this temperature"
            )
        return value - self.slope_per_c * (temperature_c - self.reference_c)


def temperature_trend(
    temperature_c: Sequence[float] | FloatArray,
    values: Sequence[float] | FloatArray,
    reference_c: float = REFERENCE_C,
    level: float = 0.95,
) -> TemperatureTrend:
    """Fit a metric of several runs over their temperatures [°C] by ordinary least squares.

    Raises AnalysisError for fewer than 4 runs, lengths that differ, or temperatures within 2 °C.
    """
    checked_level(level)
    x = checked_row(temperature_c, "temperature: °C", LEAST_RUNS)
    y = checked_row(values, "temperature: values", LEAST_RUNS)
    if x.size != y.size:
        raise AnalysisError(f"temperature: {x.size} temperatures for {y.size} values; expected one of each per run")
    if float(np.ptp(x)) < LEAST_SPAN_C:
        raise AnalysisError(
            f"temperature: runs from {x.min():g} to {x.max():g} °C; expected {LEAST_SPAN_C:g} °C or more between "
            "them; measure warmer or colder"
        )
    centre = float(x.mean())
    spread = float(np.square(x - centre).sum())
    slope = float(((x - centre) * (y - y.mean())).sum()) / spread
    residual = y - y.mean() - slope * (x - centre)
    sd = math.sqrt(float(np.square(residual).sum()) / (x.size - 2))
    u_slope = sd / math.sqrt(spread)
    half = float(scipy.special.stdtrit(x.size - 2, 0.5 + 0.5 * level)) * u_slope
    p = 2.0 * float(scipy.special.stdtr(x.size - 2, -abs(slope) / u_slope)) if u_slope > 0.0 else float(slope == 0.0)
    return TemperatureTrend(
        slope_per_c=slope,
        u_slope_per_c=u_slope,
        slope_low=slope - half,
        slope_high=slope + half,
        p_none=p,
        at_reference=float(y.mean()) + slope * (reference_c - centre),
        u_at_reference=math.hypot(sd / math.sqrt(x.size), u_slope * (reference_c - centre)),
        reference_c=reference_c,
        residual_sd=sd,
        low_c=float(x.min()),
        high_c=float(x.max()),
        runs=x.size,
    )
