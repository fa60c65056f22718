"""What the trace says: a torque-angle trace in, metrics with limits and a verdict out. Knows no machine.

Beside this stand `analysis.models` (models of a reducer), `analysis.line` (statistics of a production line) and
`analysis.studies`; what they need is loaded with them.
"""

from analysis.branches import Branch
from analysis.errors import AnalysisError
from analysis.evaluate import COVERAGE_FACTOR, MetricResult, SideValue
from analysis.method import Decision, Method, MetricWanted
from analysis.metrics import METRIC_UNITS, METRICS, Definition
from analysis.pipeline import Curves, Result, analyse
from analysis.quadrants import Quadrants, TorqueLine, fit_quadrants
from analysis.runs import commanded_runs
from analysis.segment_fit import MeanCurve
from analysis.torque_ratio import RatioFit, fit_torque_ratio
from analysis.trace import SegmentInfo, Trace
from analysis.trace_files import read_trace, segment_name
from analysis.uncertainty.figures import AngleFigures, LineCovariance, SensorFigures, TorqueFigures
from analysis.verdict import Verdict

__all__ = [
    "COVERAGE_FACTOR",
    "METRICS",
    "METRIC_UNITS",
    "AnalysisError",
    "AngleFigures",
    "Branch",
    "Curves",
    "Decision",
    "Definition",
    "LineCovariance",
    "MeanCurve",
    "Method",
    "MetricResult",
    "MetricWanted",
    "Quadrants",
    "RatioFit",
    "Result",
    "SegmentInfo",
    "SensorFigures",
    "SideValue",
    "TorqueFigures",
    "TorqueLine",
    "Trace",
    "Verdict",
    "analyse",
    "commanded_runs",
    "fit_quadrants",
    "fit_torque_ratio",
    "read_trace",
    "segment_name",
]
