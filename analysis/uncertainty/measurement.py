"""What is known of the errors of one measurement, ready to be asked about any metric.

Without declared figures there is the scatter of the cycles and of the calibration line, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.errors import AnalysisError
from analysis.loop import Loop
from analysis.measured import Measured
from analysis.stages import StageRecord
from analysis.uncertainty.budget import Budget, of_scatter
from analysis.uncertainty.circumstances import Circumstances, circumstances_of
from analysis.uncertainty.figures import SensorFigures
from analysis.uncertainty.loop_uncertainty import LoopUncertainty
from analysis.uncertainty.ratio import ratio_budget

WITH_FIGURES = "uncertainty: from the declared figures of the bench, U = k·u with k = 2"
WITHOUT_FIGURES = (
    "uncertainty: repeatability only, for no figures of the sensors were given; "
    "what is wrong in all cycles alike is not in it"
)


WITHOUT_TIME = (
    "uncertainty: from the declared figures of the bench but for delay and drift, for the trace has no time to say "
    "what these make, U = k·u with k = 2"
)
TOO_LARGE = (
    "could not be computed: moved by the declared errors of its sensors, the loop no longer has this metric; check the "
    "figures of the bench (accuracy, tared_zero, reversibility, fixture.accuracy)"
)
ONE_CYCLE = "is not known from one cycle; measure two cycles or more"


class Measurement:
    """Errors of one measurement: how it was made, and what is declared of its sensors (None: nothing)."""

    def __init__(
        self, loop: Loop, circumstances: Circumstances, figures: SensorFigures | None, *,
        by_output: Sequence[Loop] = (), draws: int = 0,
    ) -> None:  # fmt: skip
        self._circumstances = circumstances
        self._draws = draws
        self._figures = figures
        self._loops = (
            None if figures is None else LoopUncertainty(loop, circumstances, figures, by_output=by_output, draws=draws)
        )

    def of_loops(self, estimate: Callable[[Loop], float], values: Sequence[float], unit: str) -> Budget | None:
        """Return the budget of the mean of a metric's values per cycle; None where nothing can be said."""
        if self._loops is None:
            return of_scatter(values, unit)
        try:
            found = self._loops.budget(estimate, values, unit)
            return found if self.timed else replace(found, kind="untimed")
        except (AnalysisError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return None  # a metric at the edge of what the loop carries: no uncertainty, so no guard band

    @property
    def timed(self) -> bool:
        """Say whether the trace has the time that delay and drift need to become an error."""
        return self._circumstances.forward.timed and self._circumstances.backward.timed

    @property
    def why_none(self) -> str:
        """Say why a metric that has a value has no uncertainty, and what to do."""
        return ONE_CYCLE if self._loops is None else TOO_LARGE

    def of_line(self, line: str, metric: str, unit: str, value: float) -> Budget | None:
        """Return the budget of slope or offset of a calibration line, and its draws about the value."""
        of_slope = metric == "torque_ratio_slope"
        return ratio_budget(
            line, unit, self._circumstances, self._figures, of_slope=of_slope, value=value, draws=self._draws
        )


def measurement_of(
    found: Measured, figures: SensorFigures | None, *, by_output: Sequence[Loop] = (), draws: int = 0
) -> tuple[Measurement, StageRecord]:
    """Return what is known of the errors of a measurement, and the record that says what its uncertainty contains.

    by_output: loops by the torque at the output, where it was measured beside one that is converted. draws: of Monte
    Carlo beside the budget; 0 for none.
    """
    measurement = Measurement(found.loops[0], circumstances_of(found), figures, by_output=by_output, draws=draws)
    text = WITHOUT_FIGURES if figures is None else WITH_FIGURES if measurement.timed else WITHOUT_TIME
    return measurement, StageRecord("uncertainty", text)
