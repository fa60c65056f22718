"""Statistics of a line: capability, gage study, master part, unit to unit."""

from analysis.line.average_range import AverageRange, analyse_average_range, range_constants
from analysis.line.capability import Capability, Indices, capability, indices
from analysis.line.gage_design import GageDesign, gage_design, read_gage_study
from analysis.line.gage_study import GageStudy, Interval, Source, analyse_gage_study
from analysis.line.master_part import MasterPart, Signal, master_part_trend
from analysis.line.unit_to_unit import UnitToUnit, unit_to_unit

__all__ = [
    "AverageRange",
    "Capability",
    "GageDesign",
    "GageStudy",
    "Indices",
    "Interval",
    "MasterPart",
    "Signal",
    "Source",
    "UnitToUnit",
    "analyse_average_range",
    "analyse_gage_study",
    "capability",
    "gage_design",
    "indices",
    "master_part_trend",
    "range_constants",
    "read_gage_study",
    "unit_to_unit",
]
