"""What the trace says: a torque-angle trace in, metrics with limits and a verdict out. Knows no machine."""

from analysis.branches import Branch
from analysis.errors import AnalysisError
from analysis.evaluate import COVERAGE_FACTOR, MetricResult, SideValue
from analysis.line import (
    analyse_average_range,
    analyse_gage_study,
    capability,
    master_part_trend,
    read_gage_study,
    unit_to_unit,
)
from analysis.method import Decision, Method, MetricWanted
from analysis.metrics import METRIC_UNITS, METRICS, Definition
from analysis.models import (
    MODELS,
    Identified,
    ReducerModel,
    identify,
    identify_maxwell_slip,
    loop_samples,
    model_from_json,
    model_to_json,
)
from analysis.pipeline import Curves, Result, analyse
from analysis.quadrants import Quadrants, TorqueLine, fit_quadrants
from analysis.runs import commanded_runs
from analysis.segment_fit import MeanCurve
from analysis.studies import (
    eccentricity_trend,
    fit_resonance,
    frequency_response,
    lock_angle_study,
    temperature_trend,
)
from analysis.torque_ratio import RatioFit, fit_torque_ratio
from analysis.trace import SegmentInfo, Trace
from analysis.trace_files import read_trace, segment_name
from analysis.verdict import Verdict

__all__ = [
    "COVERAGE_FACTOR",
    "METRICS",
    "METRIC_UNITS",
    "MODELS",
    "AnalysisError",
    "Branch",
    "Curves",
    "Decision",
    "Definition",
    "Identified",
    "MeanCurve",
    "Method",
    "MetricResult",
    "MetricWanted",
    "Quadrants",
    "RatioFit",
    "ReducerModel",
    "Result",
    "SegmentInfo",
    "SideValue",
    "TorqueLine",
    "Trace",
    "Verdict",
    "analyse",
    "analyse_average_range",
    "analyse_gage_study",
    "capability",
    "commanded_runs",
    "eccentricity_trend",
    "fit_quadrants",
    "fit_resonance",
    "fit_torque_ratio",
    "frequency_response",
    "identify",
    "identify_maxwell_slip",
    "lock_angle_study",
    "loop_samples",
    "master_part_trend",
    "model_from_json",
    "model_to_json",
    "read_gage_study",
    "read_trace",
    "segment_name",
    "temperature_trend",
    "unit_to_unit",
]
