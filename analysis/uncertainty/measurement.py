"""What is known of the errors of one measurement, ready to be asked about any metric.

Without declared figures there is the scatter of the cycles and of the calibration line, and nothing else.

The torque ratio itself, which is no reading of a loop, has its own budget: its fit, and the sensors on both sides of
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np

from analysis.loop.loop import Loop
from analysis.loop.measured import Measured
from analysis.loop.stages import StageRecord
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.budget import Budget, Entry, combined, of_scatter, only
from analysis.uncertainty.chain import LineMove, components, covariance_of, line_moves
from analysis.uncertainty.conditions import MeasurementConditions, conditions_of
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.figures import SensorFigures, TorqueChannel
from analysis.uncertainty.left_open import OPEN_SOURCES, TRIAL
from analysis.uncertainty.loop_uncertainty import LoopUncertainty
from analysis.uncertainty.monte_carlo import SEED, interval
from analysis.uncertainty.sources import SOURCES, Declared, ErrorSource
from definitions.checks import CHECKS

WITH_FIGURES = "uncertainty: from the sensor specifications in the bench file, U = k·u with {k}"
WITHOUT_FIGURES = (
    "uncertainty: repeatability only, because no sensor specification was given; systematic errors are not included"
)


WITHOUT_TIME = (
    "uncertainty: from the sensor specifications in the bench file, without delay and drift (the trace has no time), "
    "U = k·u with {k}"
)
TOO_LARGE = (
    "The uncertainty could not be computed: the sensor errors in the bench file are too large for this metric; "
    "check them (accuracy, tared_zero, reversibility, fixture.accuracy)"
)
WITH_LEFT_OPEN = "; it includes the errors that the validity checks cannot exclude (left_open: budget)"
OPEN_WITHOUT_FIGURES = (
    "'left_open: budget' needs the sensor specification of a bench; give the bench file (--bench), or write "
    "'left_open: told' in the recipe"
)
OPEN_UNKNOWN = (
    "'left_open: budget' needs the limit of this error from the check {check}, which did not apply: {text}; record "
    "what the check needs, or write 'left_open: told' in the recipe"
)
ONE_CYCLE = (
    "The uncertainty is not known from one cycle without the sensor specification of a bench; give the bench file "
    "(--bench)"
)


class Measurement:
    """Errors of one measurement: how it was made, and what is declared of its sensors (None: nothing).

    unlimited: checks whose errors the budget shall have and nothing limits; None where it shall have none.
    """

    def __init__(
        self, loop: Loop, conditions: MeasurementConditions, figures: SensorFigures | None, *,
        by_output: Sequence[Loop] = (), draws: int = 0, unlimited: Sequence[str] | None = None,
    ) -> None:  # fmt: skip
        self._unlimited = unlimited
        self._circumstances = conditions
        self._draws = draws
        self._figures = figures
        self._loops = (
            None if figures is None else LoopUncertainty(loop, conditions, figures, by_output=by_output, draws=draws)
        )

    def of_loops(self, estimate: Callable[[Loop], float], values: Sequence[float], unit: str) -> Budget | None:
        """Return the budget of the mean of a metric's values per cycle; None where nothing can be said."""
        if self._loops is None:
            return of_scatter(values, unit, self._circumstances.coverage)
        try:
            found = self._loops.budget(estimate, values, unit)
            return found if self.timed else replace(found, kind="untimed")
        except (AnalysisError, ArithmeticError, ValueError, np.linalg.LinAlgError):
            return None  # a metric at the edge of what the loop carries: no uncertainty, so no guard band

    def trouble_of_loops(self, estimate: Callable[[Loop], float]) -> str:
        """Say why the budget of a metric lacks an error that the checks leave open and it shall have; '' if none."""
        if self._unlimited is None:
            return ""
        if self._loops is None:
            return OPEN_WITHOUT_FIGURES
        moved_by = self._loops.is_moved_by
        return _unlimited_text(next((check for check in self._unlimited if moved_by(check, estimate)), ""))

    def trouble_of_line(self, line: str) -> str:
        """Say the same of slope and offset of a calibration line."""
        if self._unlimited is None:
            return ""
        if self._figures is None:
            return OPEN_WITHOUT_FIGURES
        figures = self._figures
        for check in self._unlimited:
            trial = replace(self._circumstances, left_open={check: TRIAL})
            entering = [one for one in OPEN_SOURCES[check] if one.declared(figures, trial) is not None]
            for shape in chain.from_iterable(one.shapes for one in entering):
                if any(line_moves(shape, trial, figures).get(line, (0.0, 0.0))):
                    return _unlimited_text(check)
        return ""

    @property
    def timed(self) -> bool:
        """Say whether the trace has the time that delay and drift need to become an error."""
        return self._circumstances.forward.timed and self._circumstances.backward.timed

    @property
    def interruptions(self) -> str:
        """Say where ramps were interrupted, and what the record knows of it; '' where none was."""
        return self._circumstances.coverage.found

    @property
    def why_none(self) -> str:
        """Say why a metric that has a value has no uncertainty, and what to do."""
        return ONE_CYCLE if self._loops is None else TOO_LARGE

    def of_line(self, line: str, metric: str, unit: str, value: float) -> Budget | None:
        """Return the budget of slope or offset of a calibration line, and its draws about the value."""
        of_slope = metric == "torque_ratio_slope"
        return ratio_budget(
            line, unit, self._circumstances, self._figures, self._line_sources,
            of_slope=of_slope, value=value, draws=self._draws,
        )  # fmt: skip

    @cached_property
    def _line_sources(self) -> tuple[LineSource, ...]:
        """What may bend the calibration lines of this run; each line is fitted again once, for slope and offset."""
        return () if self._figures is None else line_sources(self._circumstances, self._figures)


def _unlimited_text(check: str) -> str:
    """Say of a check that nothing limits its error; '' of none."""
    row = CHECKS[check].leaves_open if check else None
    return "" if row is None else OPEN_UNKNOWN.format(text=row.text, check=check)


def measurement_of(
    found: Measured, figures: SensorFigures | None, *,
    by_output: Sequence[Loop] = (), draws: int = 0, late_s: float = 0.0,
    zero_shifts_nm: Mapping[TorqueChannel, float] | None = None,
    zeroes_shown_nm: Mapping[TorqueChannel, float] | None = None, left_open: Mapping[str, float | None] | None = None,
    holds: int | None = None,
) -> tuple[Measurement, StageRecord]:  # fmt: skip
    """Return what is known of the errors of a measurement, and the record that says what its uncertainty contains.

    by_output: loops by the torque at the output, where it was measured beside one that is converted. draws: of Monte
    Carlo beside the budget; 0 for none. late_s: delay of the torque behind the wind-up that the measurement shows.
    zero_shifts_nm: moves of the torque zeroes that were read again after the run. zeroes_shown_nm: how far off those
    can be whose torque lines show more than is declared. left_open: sizes of the errors that the checks leave open and
    the budget shall have, by check, None where nothing limits one; None for no such rows.
    holds: how often a ramp of the run was held; None where nobody has asked.
    """
    sizes = {check: size for check, size in (left_open or {}).items() if size is not None}
    unlimited = None if left_open is None else [check for check, size in left_open.items() if size is None]
    conditions = conditions_of(
        found, late_s=late_s, zero_shifts_nm=zero_shifts_nm, zeroes_shown_nm=zeroes_shown_nm, left_open=sizes,
        holds=holds,
    )  # fmt: skip
    measurement = Measurement(
        found.loops[0], conditions, figures, by_output=by_output, draws=draws, unlimited=unlimited
    )
    text = WITHOUT_FIGURES if figures is None else WITH_FIGURES if measurement.timed else WITHOUT_TIME
    text = text.format(k=conditions.coverage.text)
    text += WITH_LEFT_OPEN if figures is not None and left_open is not None else ""
    return measurement, StageRecord("uncertainty", text)


class LineSource(NamedTuple):
    """A source, what is declared of it, and what one unit of each of its components does to the lines, by name."""

    source: ErrorSource
    declared: Declared
    moves: tuple[dict[str, LineMove], ...]


def line_sources(conditions: MeasurementConditions, figures: SensorFigures) -> tuple[LineSource, ...]:
    """Return the sources that are declared, in the order of their tables; none for lines of another run."""
    if not conditions.lines_of_this_run:
        return ()
    return tuple(
        LineSource(source, declared, tuple(line_moves(shape, conditions, figures) for shape in source.shapes))
        for source in (*SOURCES, *chain.from_iterable(OPEN_SOURCES.values()))
        if (declared := source.declared(figures, conditions)) is not None
    )


FIT = ("line_fit", "scatter of the points about the fitted line", "normal")


def ratio_budget(
    name: str, unit: str, conditions: MeasurementConditions, figures: SensorFigures | None,
    sources: Sequence[LineSource], *, of_slope: bool, value: float = 0.0, draws: int = 0,
) -> Budget | None:  # fmt: skip
    """Return the budget of offset or slope of a calibration line, by the line's name; None for one of no known origin.

    sources: `line_sources` of these figures. Without figures it is the scatter about the line alone. draws: of Monte
    Carlo about the value, 0 for none.
    """
    covariance = covariance_of(name, conditions, SensorFigures() if figures is None else figures)
    if covariance is None:
        return None
    fit = _Drawn("normal", 1.0, tuple(move.slope if of_slope else move.offset_nm for move in components(covariance)))
    u_fit = covariance.u_slope if of_slope else covariance.u_offset_nm
    fitted = Entry(*FIT, u_fit, unit, u_fit)
    if figures is None or not conditions.lines_of_this_run:
        return _with_draws(only(fitted, conditions.coverage), [fit], value, draws)
    entries, drawn = [fitted], [fit]
    for source, declared, moves in sources:
        parts = [move[name].slope if of_slope else move[name].offset_nm for move in moves]
        if any(parts):
            part = declared.u * (parts[0] if len(parts) == 1 else math.hypot(*parts))
            entries.append(Entry(source.id, source.text, declared.distribution, declared.u, source.unit, part))
            drawn.append(_Drawn(declared.distribution, declared.figure, tuple(parts)))
    return _with_draws(combined(entries, 0.0, (), unit, conditions.coverage), drawn, value, draws)


class _Drawn(NamedTuple):
    """What is drawn of one source: distribution, limit, and what one unit of each component does to the value."""

    distribution: str
    limit: float
    parts: tuple[float, ...]


def _with_draws(budget: Budget, sources: Sequence[_Drawn], value: float, draws: int) -> Budget:
    """Return a budget with the distribution of the value when every source is drawn at once."""
    if not draws:
        return budget
    random = np.random.default_rng(SEED)
    errors = np.zeros(draws)
    for one in sources:
        errors += DISTRIBUTIONS[one.distribution].draw(random, one.limit, draws, len(one.parts)) @ np.array(one.parts)
    u = float(errors.std(ddof=1)) if draws > 1 else math.nan
    return replace(budget, monte_carlo=interval(errors, value, u))
