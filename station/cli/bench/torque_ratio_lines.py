"""The lines of a torque ratio as `torque-ratio --json` prints them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherLine:
    """Offset and slope of a line that was fitted otherwise."""

    offset_nm: float
    slope: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FlaggedPoint:
    """A point far from its line: `row` of the file, None in a run, where a point is an average; counted from 1."""

    row: int | None
    point: int
    torque_in_nm: float
    torque_out_nm: float
    studentised: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """The input torque that a wanted output torque needs; `beyond_points`: no point was measured so far out."""

    torque_out_nm: float
    torque_in_nm: float
    u_torque_in_nm: float
    u_torque_out_nm: float
    beyond_points: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One line with what stands beside it; `quadrant` is None for a table of points."""

    quadrant: str | None
    points: int
    offset_nm: float
    slope: float
    residual_sd_nm: float
    u_offset_nm: float
    u_slope: float
    correlation: float
    r_squared: float
    theil_sen: OtherLine
    without_flagged: OtherLine | None
    flagged: tuple[FlaggedPoint, ...]
    targets: tuple[Target, ...]
