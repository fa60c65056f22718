"""What the trace says: a torque-angle trace in, metrics with limits and a verdict out. Knows no machine.

Beside this stand `analysis.models` (models of a reducer), `analysis.line` (statistics of a production line) and
`analysis.studies`; what they need is loaded with them.
"""

from analysis.branches import Branch
from analysis.conversions import compensated_stiffness, fixture_stiffness
from analysis.errors import AnalysisError
from analysis.fixture import blank_curve
from analysis.fixture_curve import FixtureCurve
from analysis.gates import GATES, GateResult, gate_reasons, is_loose, judge_gates
from analysis.measured import Evidence, RunFacts
from analysis.method import Decision, Method, MetricWanted
from analysis.metric_definition import Definition
from analysis.metric_result import MetricResult, SideValue
from analysis.metrics import METRIC_UNITS, METRICS
from analysis.pipeline import Curves, Result, analyse, measure
from analysis.quadrant_fit import fit_quadrants
from analysis.quadrants import Quadrants, TorqueLine
from analysis.runs import commanded_runs
from analysis.segment_fit import MeanCurve
from analysis.segment_names import UNUSED, segment_name, segment_names
from analysis.stages import STAGES, Figure, StageRecord
from analysis.torque_ratio import RatioFit, fit_torque_ratio
from analysis.trace import SegmentInfo, Trace
from analysis.trace_files import read_trace
from analysis.uncertainty.budget import COVERAGE_FACTOR
from analysis.uncertainty.figures import AngleFigures, LineCovariance, SensorFigures, TorqueFigures, UnitDeviation
from analysis.verdict import Verdict, judge

__all__ = [
    "COVERAGE_FACTOR",
    "GATES",
    "METRICS",
    "METRIC_UNITS",
    "STAGES",
    "UNUSED",
    "AnalysisError",
    "AngleFigures",
    "Branch",
    "Curves",
    "Decision",
    "Definition",
    "Evidence",
    "Figure",
    "FixtureCurve",
    "GateResult",
    "LineCovariance",
    "MeanCurve",
    "Method",
    "MetricResult",
    "MetricWanted",
    "Quadrants",
    "RatioFit",
    "Result",
    "RunFacts",
    "SegmentInfo",
    "SensorFigures",
    "SideValue",
    "StageRecord",
    "TorqueFigures",
    "TorqueLine",
    "Trace",
    "UnitDeviation",
    "Verdict",
    "analyse",
    "blank_curve",
    "commanded_runs",
    "compensated_stiffness",
    "fit_quadrants",
    "fit_torque_ratio",
    "fixture_stiffness",
    "gate_reasons",
    "is_loose",
    "judge",
    "judge_gates",
    "measure",
    "read_trace",
    "segment_name",
    "segment_names",
]
