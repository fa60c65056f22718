"""The certificate of a run: what stands on the first page of its report, for whoever gets the unit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field
from reportlab.graphics.barcode.qr import QrCodeWidget
from reportlab.graphics.shapes import Drawing

from recipes import RecipeError, load_document
from station.documents.manifest import Manifest, attempt_text
from station.documents.result import MetricValue, Result
from station.errors import RecordError
from station.records.certificate_code import CERTIFICATE, code_of
from station.records.run_record import RunRecord
from station.records.seal import is_sealed
from station.reports.content import checks_line, shown_checks
from station.reports.headline import badges
from station.reports.metric_sides import side_rows
from station.reports.result_text import coverage_text, guarded_text, limits_text, minus, number, plus_minus, unit_text

CODE_MM = 30.0
"""Side of the square: its modules are then above half a millimetre, which every scanner reads."""

Line = Annotated[str, Field(min_length=1, max_length=100)]


class CertificateFile(BaseModel):
    """The file `certificate.yaml` in the data folder: title, and the heads of the maker and of the customer.

    `order`: where all units of a data folder are of one order; otherwise the field is left for a pen.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: Line = "Test certificate"
    maker: Annotated[tuple[Line, ...], Field(max_length=6)] = ()
    customer: Annotated[tuple[Line, ...], Field(max_length=6)] = ()
    order: Annotated[str, Field(max_length=100)] = ""


@dataclass(frozen=True)
class JudgedRow:
    """A side of a metric that has limits, as texts; `verdict`: PASS, FAIL or NOT DECIDABLE."""

    title: str
    side: str
    value: str
    uncertainty: str
    unit: str
    limits: str
    verdict: str


@dataclass(frozen=True)
class Certificate:
    """What the page says. facts: name and text. uncertainty: U with its k, as heads of columns say it.

    checks: how many validity checks failed, passed and do not apply.

    code: of the run, as the square has it.
    """

    title: str
    maker: tuple[str, ...]
    verdict: str
    badges: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    rows: tuple[JudgedRow, ...]
    uncertainty: str
    checks: str
    code: str


def certificate_of(run: RunRecord, result: Result) -> Certificate | None:
    """Return the certificate of a run; None of one that was not measured to its end, or was altered since.

    Raises:
        RecordError: `certificate.yaml` is wrong: one with another head than was asked for would be no certificate.

    """
    manifest = run.manifest()
    if result.state != "complete" or result.altered or not is_sealed(manifest):
        return None
    heads = _heads(run.folder.parent)
    return Certificate(
        title=heads.title,
        maker=heads.maker,
        verdict=result.verdict,
        badges=tuple(badges(result)),
        facts=_facts(heads, manifest, result),
        rows=tuple(_row(side, result) for one in result.metrics if one.limits for side in side_rows(one)),
        uncertainty=coverage_text(result.metrics),
        checks=f"Validity of the measurement: {checks_line(shown_checks(result)) or 'no checks'}.",
        code=code_of(run),
    )


def _heads(data: Path) -> CertificateFile:
    file = data / CERTIFICATE
    try:
        return load_document(file, CertificateFile) if file.is_file() else CertificateFile()
    except RecipeError as error:
        raise RecordError(f"the certificate cannot be made: {error}") from error


def _facts(heads: CertificateFile, manifest: Manifest, result: Result) -> tuple[tuple[str, str], ...]:
    again = f", {attempt_text(manifest.attempt, manifest.before, None)}" if manifest.attempt > 1 else ""
    return (
        ("Customer", "\n".join(heads.customer)),
        ("Order", heads.order),
        ("Serial number", manifest.serial),
        ("Model", manifest.unit.model),
        ("Tested", f"{manifest.started[:16].replace('T', ' ')} UTC{again}"),
        ("Operator", manifest.operator or ""),
        ("Test recipe", f"{result.recipe.name} revision {result.recipe.revision}"),
        ("Test bench", f"{manifest.bench.name} revision {manifest.bench.revision}"),
    )


def _row(side: MetricValue, result: Result) -> JudgedRow:
    limits = "; ".join(text for text in (limits_text(side.limits), guarded_text(side, result.decision)) if text)
    return JudgedRow(
        title=side.title or side.id,
        side=minus(side.side) if side.side in ("+", "-") else "",
        value=number(side.value, side.uncertainty),
        uncertainty="no U" if side.uncertainty is None else plus_minus(side.uncertainty),
        unit=unit_text(side.unit),
        limits=limits,
        verdict=side.verdict or "",
    )


def code_widget(code: str, side_pt: float) -> Any:
    """Return a code as a QR square of this side [pt], with the white border that scanners need."""
    return QrCodeWidget(code, barLevel="M", barWidth=side_pt, barHeight=side_pt)


def code_drawing(code: str, side_pt: float) -> Any:
    """Return a code to be put on a page."""
    return Drawing(side_pt, side_pt, code_widget(code, side_pt))


def code_svg(code: str) -> bytes:
    """Return a code as an SVG picture: a rectangle for each run of dark modules in a row, and the white border."""
    widget = code_widget(code, 0.0)
    widget.qr.make()
    side = widget.qr.getModuleCount() + 2 * widget.barBorder
    runs = []
    for y, row in enumerate(widget.qr.modules, start=widget.barBorder):
        x = widget.barBorder
        for dark, modules in groupby(row, key=bool):
            width = len(list(modules))
            if dark:
                runs.append(f'<rect x="{x}" y="{y}" width="{width}" height="1"/>')
            x += width
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {side} {side}" shape-rendering="crispEdges">'
    return "".join((head, *runs, "</svg>")).encode()
