"""The loading line T_out = C + m T_in, gathered while the calibrate state ramps up, for the target input torque.

Plain sums in floats, so that a replay gives the same bits on every processor. The full calibration with residuals and
covariance is the analysis' task, from the record.
"""

from __future__ import annotations

from definitions.program import Segment


class LoadingLine:
    """Least squares line of output torque on input torque over the loading parts of both directions."""

    MINIMUM_SAMPLES = 50
    LOWEST_SHARE_OF_TARGET = 0.1
    """Below this share of the target torque the friction has not fully reversed yet."""

    def __init__(self) -> None:
        self._n = 0
        self._sum_in = self._sum_out = self._sum_in_in = self._sum_in_out = 0.0

    def add(self, segment: Segment, torque_in_nm: float, torque_out_nm: float) -> None:
        """Take a sample of a calibrate segment that leads away from zero; both directions are folded to positive."""
        sign = float(segment.direction)
        torque_out_nm, torque_in_nm = torque_out_nm * sign, torque_in_nm * sign
        if torque_out_nm < self.LOWEST_SHARE_OF_TARGET * abs(segment.target_nm):
            return
        self._n += 1
        self._sum_in += torque_in_nm
        self._sum_out += torque_out_nm
        self._sum_in_in += torque_in_nm * torque_in_nm
        self._sum_in_out += torque_in_nm * torque_out_nm

    def fit(self) -> tuple[float, float] | None:
        """Slope m [N·m/N·m] and offset C [N·m], or None when the samples do not determine a rising line."""
        n = self._n
        if n < self.MINIMUM_SAMPLES:
            return None
        spread = n * self._sum_in_in - self._sum_in * self._sum_in
        if spread <= 1e-12 * n * n:
            return None
        slope = (n * self._sum_in_out - self._sum_in * self._sum_out) / spread
        if not slope > 0.0:
            return None
        return slope, (self._sum_out - slope * self._sum_in) / n
