"""The files of a batch report: a page that stands alone, a PDF, and every table and the loops as CSV."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterable
from pathlib import Path

import jinja2
import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from station.atomic_file import write_atomic
from station.quality.batch.content import Batch, BatchTable, Cell
from station.quality.batch.names import column_of
from station.reports.figures.loop_plot import GRID, LOADING, STYLE, png
from station.reports.result_text import minus, unit_text
from station.results.csv_cells import MARK, figure_cell, text_cell
from station.results.export import CsvStyle

TEMPLATE = "batch.html.j2"
HTML, PDF = "batch.html", "batch.pdf"
LOOPS = "loops"
MOST_HISTOGRAMS = 6
PADDING = 7
"""Characters that the margins of a cell take: without them figures in many narrow columns break in two."""

PICTURES = {
    LOOPS: "Torque and angle of every unit of the batch, its first cycle",
    "values": "Values of the metrics that have a limit",
}


def write_batch(batch: Batch, folder: Path, style: CsvStyle) -> list[Path]:
    """Write all files of the report into a folder; return them. OSError where they cannot be written."""
    pictures = pictures_of(batch)
    content = {HTML: page_of(batch, pictures), PDF: pdf_of(batch, pictures)}
    for table in (*batch.tables, batch.values, loop_table(batch)):
        content[f"{table.name}.csv"] = (MARK + csv_of(table, style)).encode()
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in content.items():
        write_atomic(folder / name, text)
    return [folder / name for name in content]


def csv_of(table: BatchTable, style: CsvStyle) -> str:
    """Return a table as CSV in the language of a spreadsheet."""
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=style.separator, lineterminator="\n")
    remarks = [(text or None,) for text in table.remarks] if any(table.remarks) else [()] * len(table.rows)
    writer.writerow([text_cell(head) for head in (*table.heads, *(("remark",) if any(table.remarks) else ()))])
    for row in (row + remark for row, remark in zip(table.rows, remarks, strict=True)):
        writer.writerow([figure_cell(one, style) if isinstance(one, float) else text_cell(one) for one in row])
    return stream.getvalue()


def loop_table(batch: Batch) -> BatchTable:
    """Return the loops as a table: a row for each point of each branch."""
    rows: list[tuple[Cell, ...]] = [
        (loop.run, loop.serial, line.name, torque, windup)
        for loop in batch.loops
        for line in loop.branches
        for torque, windup in zip(line.torque_nm, line.values, strict=True)
    ]
    return BatchTable(LOOPS, "Loops", ("run", "serial", "branch", "torque [N·m]", "wind-up [arcmin]"), tuple(rows))


def pictures_of(batch: Batch) -> dict[str, bytes]:
    """Return the pictures by name, without those that there is nothing for."""
    found = {LOOPS: _loop_figure(batch)} if batch.loops else {}
    judged = [row for row in batch.capability if row.found is not None][:MOST_HISTOGRAMS]
    return {name: png(figure) for name, figure in (found | ({"values": _histograms(batch)} if judged else {})).items()}


def _loop_figure(batch: Batch) -> Figure:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.4, 4.8), dpi=150, layout="constrained")
        axes = figure.subplots()
        for loop in batch.loops:
            for line in loop.branches:
                axes.plot(line.torque_nm, line.values, color=LOADING, alpha=0.35, linewidth=0.9)  # type: ignore[arg-type]
        axes.set_xlabel("torque at the output  [N·m]")
        axes.set_ylabel("wind-up at the output  [arcmin]")
        many = len(batch.loops)
        axes.set_title(f"{many} {'loop' if many == 1 else 'loops'}", loc="left", fontsize=11, fontweight="bold")
        axes.grid(color=GRID, linewidth=0.6)
    return figure


def _histograms(batch: Batch) -> Figure:
    """Return the values of each metric with a limit, on the side that judges, with its limits."""
    judged = [row for row in batch.capability if row.found is not None][:MOST_HISTOGRAMS]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.4, 2.3 * ((len(judged) + 1) // 2)), dpi=150, layout="constrained")
        grid = figure.subplots((len(judged) + 1) // 2, 2, squeeze=False).ravel()
        for axes, row in zip(grid, judged, strict=False):
            axes.hist(batch.numbers.get((row.metric, row.side), ()), bins=30, color=LOADING, alpha=0.8)
            for limit in (row.metric.limit_min, row.metric.limit_max):
                if limit is not None:
                    axes.axvline(limit, color="#b00020", linewidth=1.4)
            unit = unit_text(row.metric.unit)
            name = column_of(batch.names[row.metric], row.side)
            axes.set_xlabel(f"{name}  [{unit}]" if unit else name, fontsize=9)
            axes.set_ylabel("units", fontsize=9)
            axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.tick_params(labelsize=8)
        for axes in grid[len(judged) :]:
            axes.set_visible(False)
    return figure


def shown(cell: Cell) -> str:
    """Return a cell as people read it."""
    if cell is None:
        return "–"
    return minus(f"{cell:.4g}") if isinstance(cell, float) else str(cell)


def page_of(batch: Batch, pictures: dict[str, bytes]) -> bytes:
    """Return the report as one page that needs nothing else."""
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
    images = {name: base64.b64encode(content).decode() for name, content in pictures.items()}
    text = environment.get_template(TEMPLATE).render(batch=batch, images=images, pictures=PICTURES, shown=shown)
    return text.encode()


def pdf_of(batch: Batch, pictures: dict[str, bytes]) -> bytes:
    """Return the report as PDF."""
    from reportlab.lib.pagesizes import A4, landscape  # noqa: PLC0415 - the layout library is needed here only
    from reportlab.platypus import SimpleDocTemplate, Spacer  # noqa: PLC0415

    from station.reports.pdf_pages.layout import (  # noqa: PLC0415
        FRAME_PT,
        MARGIN_PT,
        grid,
        paragraph,
        picture,
        section,
        styles,
    )

    styles()
    margin = MARGIN_PT - FRAME_PT
    width = A4[1] - 2 * MARGIN_PT
    stream = io.BytesIO()
    document = SimpleDocTemplate(
        stream, pagesize=landscape(A4), leftMargin=margin, rightMargin=margin, topMargin=margin, bottomMargin=margin,
        title=batch.title, author="lostmotion",
    )  # fmt: skip
    story = [paragraph(batch.title, "title"), Spacer(1, 6)]
    story += [paragraph(note, bold=True) for note in batch.notes]
    story.append(grid(("", ""), [list(row) for row in batch.facts], [0.3 * width, 0.7 * width]))
    for table in batch.tables:
        widths = _widths(table, width)
        rows = [[shown(cell) for cell in row] for row in table.rows] or [["none", *[""] * (len(table.heads) - 1)]]
        story += section(table.title, grid(table.heads, rows, widths))
    for name, content in pictures.items():
        story += section(PICTURES[name], picture(content))
    document.build(story)
    return stream.getvalue()


def _widths(table: BatchTable, whole: float) -> list[float]:
    """Return the widths of columns by their longest words, so that figures stay in one line."""
    longest = [_longest(table, place) + PADDING for place in range(len(table.heads))]
    return [whole * one / sum(longest) for one in longest]


def _longest(table: BatchTable, place: int) -> int:
    texts: Iterable[str] = (table.heads[place], *(shown(row[place]) for row in table.rows))
    return max(5, *(min(len(text), 14) for text in texts))
