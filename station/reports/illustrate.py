"""Pictures and reports of a run, made when its verdict is on disk already: they show it and decide nothing."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from analysis.evaluation.pipeline import Result as Found
from analysis.trace.errors import AnalysisError
from definitions.program import Program
from station.atomic_file import read_file
from station.bench.request import Job
from station.documents.events import EventRow
from station.documents.reading import document_in
from station.documents.result import Result
from station.documents.timing import Timing
from station.errors import RecordError
from station.records.run_record import BENCH_COPY, EVENTS, RECIPE_COPY, TIMING, RunRecord
from station.records.samples.history import conditions_of, history_of
from station.records.samples.samples import read_samples
from station.records.samples.table import Table
from station.reports.content import content_of
from station.reports.figures.loop_plot import loop_figure, png
from station.reports.figures.residual_plot import residual_figure
from station.reports.figures.stiffness_plot import stiffness_figure
from station.reports.figures.time_plot import time_figure
from station.reports.figures.timing_plot import timing_figure
from station.reports.headline import badges, headline
from station.reports.html_page import report_html
from station.results.evaluation import method_of

HTML, PDF = "report.html", "report.pdf"
TITLE_LETTERS = 90
"""Letters of a title that fit the width of a picture."""


@dataclass(frozen=True)
class Shown:
    """What there is of a run besides its record: its job, the result that is shown, and its evaluation, if any."""

    job: Job
    result: Result
    analysis: Found | None


def illustrate(record: RunRecord, shown: Shown, *, keep: bool = True) -> tuple[bytes, bytes]:
    """Return the report as HTML and as PDF; with `keep` the first pictures are also written to the run's folder.

    Raises:
        RecordError: a file of the record cannot be read, or a picture not be written.

    """
    # The layout library is needed here only.
    from station.reports.certificate import certificate_of  # noqa: PLC0415
    from station.reports.pdf_pages.document import report_pdf  # noqa: PLC0415

    table = read_samples(record)
    pictures = pictures_of(record, table, shown)
    for name in ("loop.png", "time.png"):
        if keep and name in pictures:
            record.write_bytes(name, pictures[name])
    try:
        lines = read_file(record.folder / EVENTS).splitlines()
        files = {name: read_file(record.folder / name).decode() for name in (RECIPE_COPY, BENCH_COPY)}
        events = [document_in(EventRow, line, record.folder / EVENTS) for line in lines]
    except RecordError as error:
        raise RecordError(f"{record.folder}: the report of this run cannot be made: {error}") from error
    except ValueError as error:
        raise RecordError(
            f"{record.folder}: the report of this run cannot be made: {error}. Restore the run from a backup"
        ) from error
    content = content_of(record, shown.result, shown.analysis, shown.job)
    conditions = conditions_of(table, shown.job.program)
    run, certificate = record.manifest(), certificate_of(record, shown.result)
    html = report_html(
        shown.result, run, events, files, pictures, conditions=conditions, content=content, certificate=certificate
    )
    return html, report_pdf(shown.result, run, content, pictures, conditions, certificate)


def pictures_of(record: RunRecord, table: Table, shown: Shown) -> dict[str, bytes]:
    """Return the pictures of a run by file name: what it came to is the first of them."""
    result, job = shown.result, shown.job
    program: Program = job.program
    history = history_of(
        table,
        program,
        angle_out=job.bench.sensors.angle_out is not None,
        alarm=result.first_cause,
    )
    pictures: dict[str, bytes] = {}
    if history is None:
        return pictures
    title = picture_title(result)
    method = method_of(job.recipe, job.bench)
    pictures["loop.png"] = png(loop_figure(history, shown.analysis, method, title))
    if result.state != "complete":
        pictures["time.png"] = png(time_figure(history, title))
    if shown.analysis is not None:
        stiffness = stiffness_figure(shown.analysis, method, result.metrics)
        residuals = residual_figure(shown.analysis, method)
        pictures |= {} if stiffness is None else {"stiffness.png": png(stiffness)}
        pictures |= {} if residuals is None else {"residuals.png": png(residuals)}
    try:
        timing = timing_figure(record.read(Timing, TIMING))
    except (RecordError, AnalysisError):
        timing = None
    return pictures | ({} if timing is None else {"timing.png": png(timing)})


def picture_title(result: Result) -> str:
    """Return what stands above a picture: what it came to, in lines that fit its width, then whose it is."""
    said = textwrap.fill(headline(result).text, TITLE_LETTERS)
    return "\n".join((said, "   ".join((result.serial or "", result.recipe.name, *badges(result)))))


def write_reports(record: RunRecord, shown: Shown) -> None:
    """Write report.html and report.pdf into the run's folder; raises as `illustrate`."""
    html, pdf = illustrate(record, shown)
    record.write_bytes(HTML, html)
    record.write_bytes(PDF, pdf)
