"""No heading of a PDF report stands alone at the foot of a page."""

from __future__ import annotations

import io
from typing import Any

import pytest
from reportlab.lib.pagesizes import A4
from reportlab.platypus import Flowable, KeepTogether, SimpleDocTemplate, Spacer

from station.reports.pdf_pages.layout import grid, heading, paragraph


class Mark(Flowable):  # type: ignore[misc]
    """Nothing to see: notes the page that it is drawn on."""

    def __init__(self, pages: list[int]) -> None:
        super().__init__()
        self.pages = pages

    def wrap(self, *_: float) -> tuple[float, float]:
        return 0.0, 0.0

    def draw(self) -> None:
        self.pages.append(self.canv.getPageNumber())


@pytest.mark.parametrize("above", range(300, 690, 15))
@pytest.mark.parametrize("lines", [1, 14, 30])
@pytest.mark.parametrize("names", [[], ["of one side"]])
def test_a_heading_is_on_the_page_of_what_it_heads(above: int, lines: int, names: list[str]) -> None:
    head_page: list[int] = []
    row_page: list[int] = []
    tall = paragraph("\n".join(["line"] * lines))
    table = grid(("a", "b"), [([Mark(row_page), tall], "x"), *[("more", "y")] * 20], (1, 1))
    first: list[Any] = [*(paragraph(name, "subhead") for name in names), table]
    below = [KeepTogether(first)] if names else first
    start, end = heading("Title", *first, whole=bool(names))
    story = [Spacer(1, above), start, Mark(head_page), end, *below]
    SimpleDocTemplate(io.BytesIO(), pagesize=A4).build(story)
    assert head_page == row_page[:1]
