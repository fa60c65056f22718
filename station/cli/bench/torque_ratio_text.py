"""The lines of a torque ratio for a person: coefficients, what stands beside them, flagged points, targets."""

from __future__ import annotations

from analysis.torque_ratio.line_fit import FLAG_STUDENTISED
from station.cli.bench.torque_ratio_lines import Line
from station.cli.say import Grid
from station.reports.result_text import minus

Block = str | Grid


def line_blocks(line: Line, source: str) -> list[Block]:
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
    return f"s = {s} N·m, correlation of C and m {correlation}, R² = {line.r_squared:.5f}"


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
