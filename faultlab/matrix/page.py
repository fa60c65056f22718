"""The matrix as a page: HTML with small torque traces for people, Markdown with the figures for the documentation."""

from __future__ import annotations

from html import escape
from pathlib import Path

from faultlab.matrix.matrix import LOW_SHARE_OF_RATED, Cell
from faultlab.rows import REST_SHARE_OF_RATED, ROWS, RUN, STATES, Row

WIDTH, HEIGHT = 90, 26
LEGEND = (
    "Every cell is a simulated run in virtual time. It shows three figures: scans from the first effect of the fault "
    "to its alarm / scans from the alarm to the reaction / time from the alarm until the torque in the reducer stays "
    f"below {LOW_SHARE_OF_RATED:.0%} of rated torque. Where the drive lost its power, friction holds a residual "
    f"torque of up to {REST_SHARE_OF_RATED:.0%} of rated torque in the unit while the lock is closed. The third "
    "figure is then this torque in N·m (rest). The recovery removes it before the lock opens."
)
STYLE = (
    "body{font:14px sans-serif;margin:2em}table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:3px 6px;"
    "vertical-align:top;font-size:12px}td.bad{background:#fbb}td.none{background:#eee}svg{display:block}"
)


def figures(cell: Cell) -> str:
    """The three figures of a cell."""
    if not cell.alarm:
        return "goes on"
    low = f"{cell.torque_s:.3f} s" if cell.torque_s is not None else f"rest {cell.rest_nm:.0f} N·m"
    return f"{cell.detect_scans} / {cell.order_scans} / {low}"


def bound(row: Row) -> str:
    """What a row allows."""
    if not row.causes:
        return row.note or "must go on"
    scans = f"{row.detect_scans} scans" if row.detect_scans < RUN else "when the run needs it"
    rest = "" if row.rest == REST_SHARE_OF_RATED else f"; rest up to {row.rest:.0%}"
    return f"{scans}; {row.torque_s:g} s{rest}"


def trace(cell: Cell) -> str:
    """A small picture of the torque in the reducer around the alarm, as SVG."""
    if not cell.trace_nm:
        return ""
    top = max(1.0, *map(abs, cell.trace_nm))
    last = max(len(cell.trace_nm) - 1, 1)
    points = " ".join(
        f"{index * WIDTH / last:.1f},{HEIGHT / 2 - value / top * (HEIGHT / 2 - 1):.1f}"
        for index, value in enumerate(cell.trace_nm)
    )
    zero = f'<line x1="0" y1="{HEIGHT / 2}" x2="{WIDTH}" y2="{HEIGHT / 2}" stroke="#bbb"/>'
    line = f'<polyline points="{points}" fill="none" stroke="#06c"/>'
    return f'<svg width="{WIDTH}" height="{HEIGHT}"><title>±{top:.0f} N·m</title>{zero}{line}</svg>'


def write_page(path: Path, cells: list[Cell], took_s: float) -> None:
    """Write the matrix as one HTML file that needs nothing else."""
    by_place = {(cell.row, cell.state): cell for cell in cells}
    head = "".join(f"<th>{state}</th>" for state in STATES)
    body = []
    for number in sorted({cell.row for cell in cells}):
        row = ROWS[number]
        boxes = [_box(by_place.get((number, state))) for state in STATES]
        body.append(f"<tr><th>{escape(row.name)}<br><small>{bound(row)}</small></th>{''.join(boxes)}</tr>")
    bad = sum(bool(cell.wrong) for cell in cells)
    path.write_text(
        f'<!doctype html><meta charset="utf-8"><title>Fault matrix</title><style>{STYLE}</style>'
        f"<h1>Fault matrix</h1><p>{len(body)} faults, {len(cells)} cells, {took_s:.0f} s; outside their limits: {bad}."
        f"</p><p>{LEGEND}</p><table><tr><th>fault, bound</th>{head}</tr>{''.join(body)}</table>\n",
        encoding="utf-8",
    )


def _box(cell: Cell | None) -> str:
    if cell is None:
        return '<td class="none"></td>'
    kind = "bad" if cell.wrong else "good"
    wrong = f"<br>{escape('; '.join(cell.wrong))}" if cell.wrong else ""
    what = f"{escape(cell.alarm)} → {cell.reaction}<br>" if cell.alarm else ""
    return f'<td class="{kind}">{what}{figures(cell)}{trace(cell)}{wrong}</td>'


WIRES_HEAD = """# Faults over wires

This page is written by `lostmotion faults matrix --wires --page docs/wire-faults.md`.

Every row is a run over CAN (socketcand) and Modbus TCP on loopback, judged from the record of the run. The virtual
bench is a process of its own and waits for each scan. It notes on the monotonic clock when the fault acted; scans are
counted from the last scan before that. The limit is that of the run in virtual time plus four scans: rounding, the 2 ms
until the bench checks its faults again, and the way of the answer back. The figures are those of the
[matrix in virtual time](fault-matrix.md).

"""


def wires_markdown(cells: list[Cell]) -> str:
    """The figures of the matrix over wires for the documentation."""
    return WIRES_HEAD + "\n".join(_table(cells)) + "\n"


def markdown(cells: list[Cell]) -> str:
    """The figures of the matrix for the documentation."""
    lines = [
        "# Fault matrix\n",
        "This page is written by `lostmotion faults matrix --page docs/fault-matrix.md`.\n",
        LEGEND + "\n",
        *_table(cells),
    ]
    return "\n".join(lines) + "\n"


def _table(cells: list[Cell]) -> list[str]:
    lines = [
        "| fault | state | alarm | reaction | scans to detection | scans to order | torque low | bound |",
        "|" + " --- |" * 8,
    ]
    for cell in cells:
        row = ROWS[cell.row]
        low = "" if not cell.alarm else figures(cell).rsplit(" / ", 1)[-1]
        detect = "" if cell.detect_scans is None else cell.detect_scans
        order = "" if cell.order_scans is None else cell.order_scans
        lines.append(
            f"| `{row.name}` | {cell.state} | {cell.alarm or 'none'} | {cell.reaction or 'goes on'} | {detect} "
            f"| {order} | {low} | {bound(row)} |"
        )
    return lines
