"""`lostmotion calibration`: the torque ratio that runs measured, as an entry of `calibrations` in a bench file.

One run gives the lines of its unit. Runs of three units or more give their mean, and how the units differ: that is how
wrong the lines may be for a unit that was not calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.torque_ratio.quadrants import QUADRANTS
from recipes.text.section import LONGEST_NAME
from station.cli.bench.blocks import DIGITS, day_of, due_day, flow, print_block, rounded, scalar
from station.cli.bench.calibration_runs import check_together, measured_ratio
from station.documents.entries import alongside, left_out, plain
from station.documents.ratio import RatioLine, RatioRecord
from station.records.data_folder import Store

ONE_UNIT = "# Measured on one unit only: name runs of several units to include the spread between units"


@dataclass(frozen=True)
class UnitLine:
    """The line of a quadrant of one unit: slope, and offset with its unit."""

    slope: float
    offset: str


@dataclass(frozen=True)
class MeanLine:
    """The mean line of a quadrant: slope, offset, their standard uncertainties and correlation, scatter about it."""

    slope: float
    offset: str
    u_slope: float
    u_offset: str
    correlation: float
    residual_sd: str


@dataclass(frozen=True, kw_only=True)
class UnitLines:
    """The lines of one of several units, by quadrant."""

    serial: str
    transition: str | None = left_out()
    quadrants: Mapping[str, UnitLine] = alongside()


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """An entry of `calibrations` in a bench file: the mean lines by quadrant, and those of each of several units."""

    id: str
    model: str
    made: str
    due: str
    transition: str | None = left_out()
    quadrants: Mapping[str, MeanLine] = alongside()
    units: tuple[UnitLines, ...] | None = left_out()


@dataclass(frozen=True)
class RobustLine:
    """The mean Theil–Sen line of a quadrant, offset in N·m."""

    slope: float
    offset_nm: float


@dataclass(frozen=True)
class LineCheck:
    """What stands beside the least squares of a quadrant: points, flagged ones, and the mean Theil–Sen line.

    None for what a record of an earlier version does not have.
    """

    points: float | None
    flagged: float | None
    theil_sen: RobustLine | None


@dataclass(frozen=True)
class PrintedCalibration:
    """What is printed: the entry as a bench file lists it, and what speaks for each of its lines."""

    calibrations: tuple[Calibration]
    checks: Mapping[str, LineCheck]


def calibration(runs: Sequence[str], data: Path, *, due: str | None, as_json: bool) -> int:
    """Print the torque ratio that runs measured as an entry of `calibrations` in a bench file; return 0.

    Raises:
        StationError: a run has measured none, was altered or is invalid, its unit failed, a unit stands twice, or
            benches, models or recipes differ.

    """
    found = [measured_ratio(Store(data).find(run)) for run in runs]
    check_together(found)
    stored = [one.stored for one in found]
    made = max(day_of(one.made) for one in stored)
    lengths = [float(one.transition_rad) for one in stored if one.transition_rad is not None]
    entry = Calibration(
        id=_id([one.run for one in found]),
        model=stored[0].model,
        made=made.isoformat(),
        due=due_day(due, made).isoformat(),
        transition=_length(sum(lengths) / len(lengths)) if len(lengths) == len(found) else None,
        quadrants={quadrant: _mean_line([one.quadrants[quadrant] for one in stored]) for quadrant in QUADRANTS},
        units=tuple(_unit(one.serial, one.stored) for one in found) if len(found) > 1 else None,
    )
    checks = {quadrant: _check([one.quadrants[quadrant] for one in stored]) for quadrant in QUADRANTS}
    print_block(PrintedCalibration((entry,), checks), _calibration_yaml(entry, checks), as_json=as_json)
    return 0


def _id(runs: Sequence[str]) -> str:
    """Return a name for a bench file: of the run, or of the moment of the last one where its serial is too long."""
    ending = f"-ratio-{len(runs)}-units" if len(runs) > 1 else "-ratio"
    last = max(runs)
    return (last if len(last + ending) <= LONGEST_NAME else last.partition("-")[0]) + ending


def _mean_line(lines: Sequence[RatioLine]) -> MeanLine:
    """Return the mean of lines, with the covariance of a mean."""
    count = len(lines)
    u_slope = math.hypot(*(line.u_slope for line in lines)) / count
    u_offset = math.hypot(*(line.u_offset_nm for line in lines)) / count
    together = sum(line.correlation * line.u_slope * line.u_offset_nm for line in lines) / count**2
    residual = math.hypot(*(line.residual_sd_nm for line in lines)) / math.sqrt(count)
    return MeanLine(
        slope=rounded(sum(line.slope for line in lines) / count),
        offset=_torque(sum(line.offset_nm for line in lines) / count),
        u_slope=rounded(u_slope),
        u_offset=_torque(u_offset),
        correlation=rounded(together / (u_slope * u_offset) if u_slope * u_offset else 0.0),
        residual_sd=_torque(residual),
    )


def _check(lines: Sequence[RatioLine]) -> LineCheck:
    slope = _sum([line.theil_sen_slope for line in lines])
    offset = _sum([line.theil_sen_offset_nm for line in lines])
    return LineCheck(
        points=_sum([line.points for line in lines]),
        flagged=_sum([line.flagged for line in lines]),
        theil_sen=None
        if slope is None or offset is None
        else RobustLine(rounded(slope / len(lines)), rounded(offset / len(lines))),
    )


def _sum(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def _unit(serial: str, stored: RatioRecord) -> UnitLines:
    lines = {quadrant: stored.quadrants[quadrant] for quadrant in QUADRANTS}
    return UnitLines(
        serial=serial,
        transition=None if stored.transition_rad is None else _length(stored.transition_rad),
        quadrants={name: UnitLine(rounded(one.slope), _torque(one.offset_nm)) for name, one in lines.items()},
    )


def _torque(torque_nm: float) -> str:
    return f"{torque_nm:.{DIGITS}g} N·m"


def _length(angle_rad: float) -> str:
    return f"{angle_rad:.{DIGITS}g} rad"


def _calibration_yaml(entry: Calibration, checks: Mapping[str, LineCheck]) -> str:
    lines = [line for key, value in plain(entry).items() for line in _option(key, value)]
    text = "\n".join(["calibrations:", f"  - {lines[0]}", *(f"    {line}" for line in lines[1:])])
    said = [_check_text(quadrant, check) for quadrant, check in checks.items()]
    comments = [*said, ONE_UNIT if entry.units is None else ""]
    return "\n".join([text, *(f"    {comment}" for comment in comments if comment)]) + "\n"


def _check_text(quadrant: str, check: LineCheck) -> str:
    """Return what stands beside a line as a comment; '' where a record of an earlier version has none of it."""
    said = []
    if check.theil_sen is not None:
        said.append(
            f"line that outliers do not affect (Theil–Sen): slope {check.theil_sen.slope}, offset "
            f"{_torque(check.theil_sen.offset_nm)}"
        )
    if None not in (check.points, check.flagged):
        said.append(f"{check.flagged} of {check.points} points marked as outliers")
    return f"# {quadrant}: {'; '.join(said)}" if said else ""


def _option(key: str, value: object) -> list[str]:
    """Return the lines of one option: a list has an entry per unit, everything else is one line."""
    if not isinstance(value, list):
        return [f"{key}: {flow(value) if isinstance(value, dict) else scalar(value)}"]
    lines = [f"{key}:"]
    for unit in value:
        options = [line for name, own in unit.items() for line in _option(name, own)]
        lines += [f"  - {options[0]}", *(f"    {line}" for line in options[1:])]
    return lines
