"""`lostmotion torque-ratio`: the line T_out = C + m·T_in of a table of points, or of each quadrant of a run.

Beside the least squares stand the Theil–Sen line, which outliers cannot move, each flagged point, and the input torque
that a wanted output torque needs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.torque_ratio.line_begin import begin_text
from analysis.torque_ratio.line_fit import FLAG_STUDENTISED, LEAST_POINTS, RatioFit, fit_torque_ratio
from analysis.torque_ratio.points import doubts, fit_points
from analysis.torque_ratio.quadrant_fit import bounce_ends_nm, quadrant_points
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import commanded_runs
from analysis.trace.trace_files import read_rows
from analysis.trace.units import IntArray
from definitions.units import TORQUE
from recipes.text.quantity import QuantityError, read_quantity, show
from station.bench.request import trace_file
from station.cli.say import Grid, say
from station.documents.entries import plain
from station.documents.result import Result
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import RESULT
from station.reports.headline import objection
from station.reports.result_text import minus
from station.results.export_origin import origin_of
from station.results.run_analysis import complete_run

Block = str | Grid

FITTED = ("calibrate", "measure")
"""Roles of the segments that lines are fitted to, the first one that a file has."""


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


@dataclass(frozen=True)
class Lines:
    """Lines of a file or a run by quadrant (None: a table of points), and the row of each point where it has one."""

    source: str
    run: str | None
    fits: Mapping[str | None, RatioFit]
    rows: IntArray | None = None
    notes: Sequence[str] = ()


def torque_ratio(name: str, targets: Sequence[str], data: Path, *, as_json: bool) -> int:
    """Print the torque ratio of a table of points, or of a stored run; return 0.

    Args:
        name: CSV, Parquet or TDMS file with the columns torque_in_nm and torque_out_nm, or a stored run.
        targets: output torques whose input torque is wanted, as `412 N·m`.
        data: folder of the runs.
        as_json: one JSON object instead of text.

    Raises:
        StationError, AnalysisError: what cannot be read or fitted, or a target that no line reaches.

    """
    wanted = [_target(text) for text in targets]
    path = trace_file(name)
    found = _of_run(name, data) if path is None else _of_file(path)
    _refuse_unreached(wanted, found)
    lines = [_line(quadrant, fit, wanted, found.rows) for quadrant, fit in found.fits.items()]
    document = {"source": found.source, "run": found.run, "lines": plain(lines), "notes": list(found.notes)}
    blocks = [block for line in lines for block in _line_blocks(line, found.source)]
    return say(document, [*blocks, *found.notes], as_json=as_json)


def _target(text: str) -> float:
    try:
        torque_nm = read_quantity(text, TORQUE)
    except QuantityError as error:
        raise StationError(
            f"--target: found {error.found}; allowed is an output torque, as in '412 N·m'. {error.hint}"
        ) from None
    if not torque_nm:
        raise StationError(f"--target: found {text}; allowed is an output torque other than zero, such as '412 N·m'")
    return torque_nm


def _of_file(path: Path) -> Lines:
    trace, rows = read_rows(path)
    origin = origin_of(path, trace)
    if origin is not None:
        origin.check_complete()
        if origin.objections:
            raise StationError(f"file {path} was not evaluated: {origin.objections[0]}. Export the run again")
    runs = commanded_runs(trace)
    if not runs:
        fit = fit_points(trace, rows)
        return Lines(str(path), None, {None: fit}, rows, doubts(fit, rows))
    role = next((role for role in FITTED if any(run.role == role for run in runs)), None)
    if role is None:
        raise AnalysisError(
            f"file {path}, column segment: found {', '.join(sorted({run.role for run in runs}))}; expected "
            f"{' or '.join(FITTED)} in the rows in which both torques were measured. Correct the column"
        )
    chosen = [run for run in runs if run.role == role]
    begins = bounce_ends_nm(trace, chosen)
    points = quadrant_points(trace, chosen, begins_nm=begins)
    fits: dict[str | None, RatioFit] = {
        quadrant: fit_torque_ratio(x, y).of_branch() for quadrant, (x, y) in points.items() if x.size >= LEAST_POINTS
    }
    if not fits:
        raise AnalysisError(
            f"file {path}, rows with segment {role}: found fewer than {LEAST_POINTS} points in every quadrant; "
            "expected a loading or unloading branch over most of the torque range. Name another file"
        )
    missing = [quadrant for quadrant in points if quadrant not in fits]
    notes = (
        [f"no line for {', '.join(missing)}: fewer than {LEAST_POINTS} points of segments {role}"] if missing else []
    )
    return Lines(
        str(path), None, fits, notes=[*notes, *_begins({name: begins[name] for name in begins if name in fits})]
    )


def _of_run(name: str, data: Path) -> Lines:
    """Return the lines that a run measured, of the calibration segments as they were evaluated then."""
    run = Store(data).find(name)
    quadrants = complete_run(run).result.quadrants
    if quadrants is None or not quadrants.fits:
        raise StationError(
            f"{run.id}: the run measured no torque ratio; expected a complete run of a recipe with a step calibrate "
            "and a metric torque_ratio_slope or torque_ratio_offset"
        )
    result = run.read(Result, RESULT)
    said = [f"run {run.id}: {invalid}, so its torque ratio is not reliable"] if (invalid := objection(result)) else []
    if result.scenario:
        said.append(
            f"run {run.id}: faults were injected on purpose ({result.scenario}), so its torque ratio may be wrong"
        )
    return Lines(run.id, run.id, dict(quadrants.fits.items()), notes=[*said, *_begins(quadrants.begins_nm)])


def _begins(begins_nm: Mapping[str, float]) -> list[str]:
    """Say which lines begin later than others, and where."""
    return [minus(f"line {name}: fitted {begin_text(name, begin_nm)}") for name, begin_nm in begins_nm.items()]


def _refuse_unreached(wanted: Sequence[float], found: Lines) -> None:
    for torque_nm in wanted:
        if not any(_reaches(fit, torque_nm) for fit in found.fits.values()):
            raise StationError(
                f"--target: found {show(torque_nm, TORQUE)}; allowed is a torque of the same sign as the measured "
                f"points of {found.source}"
            )


def _reaches(fit: RatioFit, torque_out_nm: float) -> bool:
    """Whether a line is that of the sign of an output torque."""
    return bool(float(fit.outputs_nm.mean()) * torque_out_nm > 0.0 and fit.slope != 0.0)


def _line(quadrant: str | None, fit: RatioFit, wanted: Sequence[float], rows: IntArray | None) -> Line:
    without = fit.without_flagged()
    return Line(
        quadrant=quadrant,
        points=fit.points,
        offset_nm=fit.offset_nm,
        slope=fit.slope,
        residual_sd_nm=fit.residual_sd_nm,
        u_offset_nm=fit.u_offset_nm,
        u_slope=fit.u_slope,
        correlation=fit.correlation,
        r_squared=fit.r_squared,
        theil_sen=OtherLine(offset_nm=fit.theil_sen_offset_nm, slope=fit.theil_sen_slope),
        without_flagged=None if without is None else OtherLine(offset_nm=without.offset_nm, slope=without.slope),
        flagged=tuple(_point(fit, int(index), rows) for index in fit.flagged),
        targets=tuple(_needed(fit, torque_nm) for torque_nm in wanted if _reaches(fit, torque_nm)),
    )


def _point(fit: RatioFit, index: int, rows: IntArray | None) -> FlaggedPoint:
    return FlaggedPoint(
        row=None if rows is None else int(rows[index]),
        point=index + 1,
        torque_in_nm=float(fit.inputs_nm[index]),
        torque_out_nm=float(fit.outputs_nm[index]),
        studentised=float(fit.studentised[index]),
    )


def _needed(fit: RatioFit, torque_out_nm: float) -> Target:
    torque_in_nm = fit.torque_in_nm(torque_out_nm)
    return Target(
        torque_out_nm=torque_out_nm,
        torque_in_nm=torque_in_nm,
        u_torque_in_nm=fit.u_torque_in_nm(torque_out_nm),
        u_torque_out_nm=fit.u_torque_out_nm(torque_in_nm),
        beyond_points=not float(fit.outputs_nm.min()) <= torque_out_nm <= float(fit.outputs_nm.max()),
    )


def _line_blocks(line: Line, source: str) -> list[Block]:
    """Return what is printed of one line."""
    head = f"{source}, {line.quadrant}" if line.quadrant else source
    return [
        f"{head}: T_out = C + m·T_in, {line.points} points",
        Grid(("", "C [N·m]", "m"), _coefficients(line), right=(1, 2)),
        _scatter(line),
        *_flagged(line),
        *_targets(line),
        "",
    ]


def _coefficients(line: Line) -> list[tuple[str, str, str]]:
    rows = [
        ("least squares", _digits(line.offset_nm, 8), _digits(line.slope, 8)),
        ("standard uncertainty", _digits(line.u_offset_nm, 4), _digits(line.u_slope, 5)),
    ]
    for name, other in (("Theil–Sen", line.theil_sen), ("without flagged points", line.without_flagged)):
        if other is not None:
            rows.append((name, _digits(other.offset_nm, 5), _digits(other.slope, 5)))
    return rows


def _scatter(line: Line) -> str:
    correlation = minus(f"{line.correlation:.3f}")
    s = _digits(line.residual_sd_nm, 4)
    return f"scatter of the points s = {s} N·m, correlation of C and m {correlation}, R² = {line.r_squared:.5f}"


def _flagged(line: Line) -> list[Block]:
    if not line.flagged:
        return [f"no point flagged (|t| > {FLAG_STUDENTISED:g}, externally studentised)"]
    rows = [
        (
            f"point {one.point}" if one.row is None else f"row {one.row}",
            minus(f"{one.torque_in_nm:.6g}"),
            minus(f"{one.torque_out_nm:.6g}"),
            minus(f"{one.studentised:.2f}"),
        )
        for one in line.flagged
    ]
    return [
        f"flagged (|t| > {FLAG_STUDENTISED:g}, externally studentised): look at them before the line is used",
        Grid(("", "T_in [N·m]", "T_out [N·m]", "t"), rows, right=(1, 2, 3)),
    ]


def _targets(line: Line) -> list[Block]:
    if not line.targets:
        return []
    rows = [
        (
            minus(f"{one.torque_out_nm:g}"),
            _digits(one.torque_in_nm, 5),
            _digits(one.u_torque_in_nm, 3),
            _digits(one.u_torque_out_nm, 3),
            "beyond the points" if one.beyond_points else "",
        )
        for one in line.targets
    ]
    heads = ("target T_out [N·m]", "T_in [N·m]", "u(T_in) [N·m]", "u(T_out) of the line [N·m]", "")
    return [Grid(heads, rows, right=(0, 1, 2, 3))]


def _digits(value: float, count: int) -> str:
    """Return a number with all of its digits, zeroes at the end too."""
    return minus(f"{value:#.{count}g}".rstrip("."))
