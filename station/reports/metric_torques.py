"""Where on the loop a metric is read: torques at the output, by its definition and what was chosen of it."""

from __future__ import annotations

from analysis.loop.method import Method
from definitions.metrics import METRICS, SPRING_STEP_ENDS, Metric
from station.documents.result import MetricValue

SIGNS = {"+": (1.0,), "-": (-1.0,)}
"""Sides by the sign of their torque; a metric of the whole loop has both."""

Span = tuple[float, float]
"""Two torques [N·m], the lower one first; twice the same where a metric is read at one torque."""


def side_span(metric: MetricValue, method: Method) -> Span | None:
    """Return the magnitudes of torque that a metric is read between, on one side.

    None for a metric that is not read off the loop (the torque ratio), or that this version does not know.
    """
    row = METRICS.get(metric.id)
    if row is None or row.calibration:
        return None
    reference = method.reference_nm
    if row.segmented:
        borders = (0.0, *method.stiffness_breaks_nm, reference)
        place = int(row.id.removeprefix("k")) - 1
        return borders[place], borders[place + 1]
    if row.span is not None:
        return row.span[0] * reference, row.span[1] * reference
    if metric.torque_nm is not None or row.torque is not None:
        at = metric.torque_nm if metric.torque_nm is not None else (row.torque or 0.0) * reference
        return at, at
    if row.band is not None:
        at = (row.band if metric.band is None else metric.band) * reference
        return at, at
    return _step(row, metric, method)


def _step(row: Metric, metric: MetricValue, method: Method) -> Span:
    """Return the torque step of a spring constant."""
    variant = next((one for one in metric.choices if one in row.variants), row.variants[0])
    end = method.reference_nm + SPRING_STEP_ENDS[variant] * method.spring_step_nm
    return end - method.spring_step_nm, end


def torque_spans(metric: MetricValue, method: Method) -> tuple[Span, ...]:
    """Return the torques of the loop that a metric is read between, signs included: one pair for each of its sides."""
    span = side_span(metric, method)
    if span is None:
        return ()
    low, high = span
    signs = SIGNS.get(metric.side, (1.0, -1.0))
    if low == 0.0 and len(signs) > 1:
        return ((-high, high),)
    return tuple((low, high) if sign > 0 else (-high, -low) for sign in signs)
