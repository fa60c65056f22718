"""The first page of a report as PDF: the certificate, on one page of A4 whatever it holds."""

from __future__ import annotations

from typing import Any

from reportlab.lib.colors import white
from reportlab.lib.units import mm
from reportlab.platypus import HRFlowable, KeepInFrame, PageBreak, Spacer, Table

from station.reports.certificate import CODE_MM, Certificate, code_drawing
from station.reports.pdf_pages.layout import (
    BADGE_COLOUR,
    INK,
    SOFT,
    VERDICT_COLOURS,
    WIDTH_PT,
    grid,
    paragraph,
    picture,
)

HEIGHT_PT = 258 * mm
"""Of what stands on the page; what needs more is made smaller."""

LOOP_SHARE = 0.62
WIDTHS = (68, 9, 18, 20, 24, 40, 22)
SIGNED_BY = ("Tested by", "Released by")
PEN = "\u2009" + "." * 44
"""A line to write on."""


def certificate_parts(one: Certificate, loop: bytes | None, rule: str) -> list[Any]:
    """Return the page; loop: its picture as PNG. rule: the rule of decision in a sentence."""
    square = code_drawing(one.code, CODE_MM * mm)
    head = [paragraph("\n".join(one.maker), "text")] if one.maker else []
    head += [Spacer(1, 4), paragraph(one.title, "title")]
    top = Table([[head, square]], colWidths=[WIDTH_PT - CODE_MM * mm, CODE_MM * mm])
    _flush(top).setStyle([("VALIGN", (0, 0), (-1, -1), "TOP"), ("LEFTPADDING", (0, 0), (-1, -1), 0),
                  ("RIGHTPADDING", (0, 0), (-1, -1), 0), ("ALIGN", (1, 0), (1, 0), "RIGHT")])  # fmt: skip
    story: list[Any] = [
        top,
        HRFlowable(width="100%", thickness=1.2, color=INK, spaceBefore=2, spaceAfter=6),
        _flush(_verdict(one)),
        Spacer(1, 6),
        *([picture(loop, LOOP_SHARE)] if loop is not None else []),
        Spacer(1, 4),
        _flush(_metrics(one)),
        Spacer(1, 3),
        paragraph(f"{one.checks} {rule}", "soft"),
        Spacer(1, 16),
        _flush(_signatures()),
        Spacer(1, 8),
        paragraph(f"To check this certificate: lostmotion verify --code {one.code}", "mono"),
    ]
    return [KeepInFrame(WIDTH_PT, HEIGHT_PT, story, mode="shrink"), PageBreak()]


def _flush(table: Any) -> Any:
    """Return a table at the left margin, as the text is, also where the page was made smaller."""
    table.hAlign = "LEFT"
    return table


def _verdict(one: Certificate) -> Any:
    colour = VERDICT_COLOURS[one.verdict]
    facts = [(paragraph(name, "soft"), paragraph(text or PEN, "text", bold=name == "Serial number"))
             for name, text in one.facts]  # fmt: skip
    half = (len(facts) + 1) // 2
    rows = [(*facts[place], *(facts[place + half] if place + half < len(facts) else ("", ""))) for place in range(half)]
    table = grid(("", "", "", ""), rows, (20, 60, 20, 60))
    box = Table([[paragraph(one.verdict, "verdict")]], colWidths=[WIDTH_PT])
    box.setStyle([("BACKGROUND", (0, 0), (-1, -1), colour), ("LEFTPADDING", (0, 0), (-1, -1), 10),
                  ("TOPPADDING", (0, 0), (-1, -1), 4), ("BOTTOMPADDING", (0, 0), (-1, -1), 8)])  # fmt: skip
    marks = [paragraph(badge, "text", bold=True, colour=BADGE_COLOUR) for badge in one.badges]
    whole = Table([[box], *([mark] for mark in marks), [table]], colWidths=[WIDTH_PT])
    whole.setStyle([("LEFTPADDING", (0, 0), (-1, -1), 0), ("RIGHTPADDING", (0, 0), (-1, -1), 0)])
    return whole


def _metrics(one: Certificate) -> Any:
    rows = []
    for row in one.rows:
        colour = VERDICT_COLOURS.get(row.verdict, SOFT)
        verdict = paragraph(row.verdict or "reported", bold=bool(row.verdict), colour=colour)
        rows.append((paragraph(row.title, bold=True), row.side, paragraph(row.value, "right", bold=True),
                     paragraph(row.uncertainty, "right"), row.unit, row.limits, verdict))  # fmt: skip
    heads = ("Metric", "Side", "Value", one.uncertainty, "Unit", "Limits", "Verdict")
    return grid(heads, rows, WIDTHS, right=(2, 3))


def _signatures() -> Any:
    rows = [[paragraph("\u00a0", "text") for _ in SIGNED_BY],
            [paragraph(f"{name}: name, date, signature", "soft") for name in SIGNED_BY]]  # fmt: skip
    width = WIDTH_PT / len(SIGNED_BY)
    table = Table(rows, colWidths=[width] * len(SIGNED_BY))
    style = [("LINEABOVE", (place, 1), (place, 1), 0.8, INK) for place in range(len(SIGNED_BY))]
    table.setStyle([*style, ("BACKGROUND", (0, 0), (-1, 0), white), ("TOPPADDING", (0, 0), (-1, 0), 10)])
    return table
