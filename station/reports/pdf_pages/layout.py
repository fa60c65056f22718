"""The look of PDF reports: fonts, styles, tables and pictures, as one place for all of them.

DejaVu is the font because it has every sign of the field and comes with matplotlib: nothing need be installed.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import matplotlib as mpl
from reportlab import rl_config
from reportlab.lib.colors import HexColor, white
from reportlab.lib.enums import TA_RIGHT
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase.pdfmetrics import registerFont, registerFontFamily
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import CondPageBreak, HRFlowable, Image, KeepTogether, Paragraph, Table

MARGIN_PT = 15 * mm
FRAME_PT = 6.0
"""What the page's frame keeps free inside the margin; the margin is less by it, so that tables and text are flush."""

rl_config.useA85 = 0
"""Pictures as bytes, not as text: half of the time that a report takes went into their encoding."""

WIDTH_PT = A4[0] - 2 * MARGIN_PT
"""Width of the text on the page."""

LEAST_BELOW_HEADING = 35 * mm
"""A heading with less room than this below it goes to the next page."""

MOST_BELOW_HEADING = 180 * mm
"""What is higher than this is divided: no page has much more room."""

SPACES_PT = 24.0
"""Spaces before and after a heading and what follows it, at most."""

INK, SOFT, LINE, WASH, RED = (HexColor(one) for one in ("#1f2933", "#66727f", "#d9dee4", "#f5f7f9", "#fdecea"))
VERDICT_COLOURS = {
    "PASS": HexColor("#1b7f3b"),
    "FAIL": HexColor("#b3261e"),
    "fault": HexColor("#b3261e"),
    "NOT DECIDABLE": HexColor("#9c5a00"),
    "stopped": HexColor("#9c5a00"),
}
BADGE_COLOUR = HexColor("#7b1fa2")
BODY, BOLD, MONO = "LM", "LM-Bold", "LM-Mono"


@functools.cache
def styles() -> dict[str, ParagraphStyle]:
    """Register the fonts once and return the paragraph styles by name."""
    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    for name, file in ((BODY, "DejaVuSans"), (BOLD, "DejaVuSans-Bold"), (MONO, "DejaVuSansMono")):
        registerFont(TTFont(name, str(folder / f"{file}.ttf")))
    registerFontFamily(BODY, normal=BODY, bold=BOLD, italic=BODY, boldItalic=BOLD)
    text = ParagraphStyle("text", fontName=BODY, fontSize=8.2, leading=11, textColor=INK)
    small = ParagraphStyle("small", parent=text, fontSize=7.2, leading=9.4)
    return {
        "text": text,
        "small": small,
        "soft": ParagraphStyle("soft", parent=small, textColor=SOFT),
        "soft_right": ParagraphStyle("soft_right", parent=small, textColor=SOFT, alignment=TA_RIGHT),
        "right": ParagraphStyle("right", parent=small, alignment=TA_RIGHT),
        "mono": ParagraphStyle("mono", parent=small, fontName=MONO, fontSize=6.2),
        "code": ParagraphStyle("code", parent=small, fontName=MONO, fontSize=6.6, leading=8.6, backColor=WASH),
        "title": ParagraphStyle("title", parent=text, fontName=BOLD, fontSize=15, leading=19),
        "verdict": ParagraphStyle("verdict", parent=text, fontName=BOLD, fontSize=17, leading=21, textColor=white),
        "head": ParagraphStyle("head", parent=text, fontName=BOLD, fontSize=11, leading=14, spaceBefore=11),
        "subhead": ParagraphStyle("subhead", parent=text, fontName=BOLD, spaceBefore=6, spaceAfter=2, keepWithNext=1),
    }  # fmt: skip


def paragraph(text: str, style: str = "small", *, bold: bool = False, colour: Any = None) -> Any:
    """Return plain text as a paragraph; signs that mean something in markup are escaped, line ends kept."""
    marked = escape(text).replace("\n", "<br/>")
    if colour is not None:
        marked = f'<font color="{colour.hexval().replace("0x", "#")}">{marked}</font>'
    return Paragraph(f"<b>{marked}</b>" if bold else marked, styles()[style])


def section(title: str, *parts: Any) -> list[Any]:
    """Return a heading that stays with what follows it."""
    rule = HRFlowable(width="100%", thickness=1.2, color=INK, spaceBefore=0, spaceAfter=4)
    return [KeepTogether([paragraph(title, "head"), rule, *parts[:1]]), *parts[1:]]


def heading(title: str, *first: Any, whole: bool = False) -> list[Any]:
    """Return a heading for what may be longer than a page; it stays with `first`.

    whole: `first` is kept together; otherwise the heading stays with the first row of a table.
    """
    rule = HRFlowable(width="100%", thickness=1.2, color=INK, spaceBefore=0, spaceAfter=4)
    head = [paragraph(title, "head"), rule]
    needed = SPACES_PT + sum(_height(part, whole=whole) for part in (*head, *first))
    return [CondPageBreak(min(max(LEAST_BELOW_HEADING, needed), MOST_BELOW_HEADING)), KeepTogether(head)]


def _height(part: Any, *, whole: bool) -> float:
    """Return what a part needs to begin on a page: all of it, or of a table its heads and first row."""
    height: float = part.wrap(WIDTH_PT, A4[1])[1]
    if whole or not isinstance(part, Table):
        return height
    rows: list[float] = part._rowHeights[: part.repeatRows + 1]  # noqa: SLF001 - the library tells heights nowhere else
    return sum(rows)


def grid(
    heads: Sequence[str],
    rows: Sequence[Sequence[Any]],
    widths: Sequence[float],
    extra: Sequence[Any] = (),
    right: Container[int] = (),
) -> Any:
    """Return a table over the width of the page; cells are text or flowables, `widths` are shares of it.

    The heads of the columns `right` stand at the right, as the numbers below them do.

    The heads stand again on every page that the table goes on to.
    """
    places = [paragraph(head, "soft_right" if place in right else "soft") for place, head in enumerate(heads)]
    shown = [places] if any(heads) else []
    shown += [[paragraph(cell) if isinstance(cell, str) else cell for cell in row] for row in rows]
    total = sum(widths)
    table = Table(shown, colWidths=[WIDTH_PT * share / total for share in widths], repeatRows=1 if any(heads) else 0)
    table.setStyle(
        [
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, LINE),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
            ("LEFTPADDING", (0, 0), (-1, -1), 0),
            ("RIGHTPADDING", (0, 0), (-1, -1), 5),
            ("TOPPADDING", (0, 0), (-1, -1), 2),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 2.5),
            *extra,
        ]
    )
    return table


def picture(content: bytes, share: float = 1.0) -> Any:
    """Return a PNG picture over the width of the page, or a share of it."""
    width, height = ImageReader(io.BytesIO(content)).getSize()
    return Image(io.BytesIO(content), width=share * WIDTH_PT, height=share * WIDTH_PT * height / width)
