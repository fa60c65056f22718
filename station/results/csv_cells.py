"""Cells of a CSV file that a spreadsheet opens by a double click: texts that are no formula, figures in its way."""

from __future__ import annotations

from station.results.export import CsvStyle

MARK = "\ufeff"
"""By this, at its start, a spreadsheet knows the file for UTF-8."""


def text_cell(value: object) -> str:
    """Return an entry for a spreadsheet: one line, and nothing that it would take for a formula."""
    text = "" if value is None else str(value).replace("\n", "; ")
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def figure_cell(value: float | None, style: CsvStyle) -> str:
    """Return a figure with the decimal sign of the language; '' for none."""
    return "" if value is None else f"{value:.9g}".replace(".", style.decimal)
