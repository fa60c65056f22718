"""Models of a reducer identified from its loop: cubic, compliance + gap + Dahl, Bouc–Wen, Maxwell-slip."""

from analysis.models.identify import MOST_CORRELATION, Identified, Refusal, identify
from analysis.models.maxwell_slip_fit import identify_maxwell_slip
from analysis.models.path import PathState
from analysis.models.reducer_model import ReducerModel, model_from_json, model_to_json
from analysis.models.samples import LoopSamples, loop_samples, samples_of_branches
from analysis.models.table import MODELS, Model, Parameter

__all__ = [
    "MODELS",
    "MOST_CORRELATION",
    "Identified",
    "LoopSamples",
    "Model",
    "Parameter",
    "PathState",
    "ReducerModel",
    "Refusal",
    "identify",
    "identify_maxwell_slip",
    "loop_samples",
    "model_from_json",
    "model_to_json",
    "samples_of_branches",
]
