"""The torque ratio that a run measured, `calibration.json`: a line T_out = C + m·T_in for each quadrant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.documents.entries import Count, Number


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchHead:
    """The bench that measured."""

    name: str = ""
    revision: Count | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RatioLine:
    """One line: slope m, offset C [N·m], their uncertainties and correlation, residual, and how it was fitted."""

    slope: Number
    offset_nm: Number
    u_slope: Number
    u_offset_nm: Number
    correlation: Number
    residual_sd_nm: Number
    r_squared: Number | None = None
    points: Count | None = None
    flagged: Count | None = None
    theil_sen_slope: Number | None = None
    theil_sen_offset_nm: Number | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RatioRecord:
    """The lines of a run by quadrant; `transition_rad`: angle over which one line goes over into the next."""

    id: str
    bench: BenchHead = BenchHead()
    model: str
    made: str
    transition_rad: Number | None = None
    quadrants: Mapping[str, RatioLine]
