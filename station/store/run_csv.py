"""The table of all runs as CSV for a spreadsheet: a row a run, with its metrics."""

from __future__ import annotations

import csv
import io

from station.results.csv_cells import figure_cell, text_cell
from station.results.export import CsvStyle
from station.store.run_table import RUN_COLUMNS, RunTableRow, columns_of


def csv_of(rows: list[RunTableRow], style: CsvStyle) -> str:
    """Return the runs as CSV: what is known of each, then value and expanded uncertainty U of every metric."""
    columns = columns_of(rows)
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=style.separator, lineterminator="\n")
    heads = list(RUN_COLUMNS)
    for column in columns:
        unit = "" if column.unit in ("", "1") else f" [{column.unit}]"
        heads += [f"{column.name}{unit}", f"U({column.name}){unit}"]
    writer.writerow(heads)
    for row in rows:
        said = (row.cell(name) for name in RUN_COLUMNS)
        cells = [figure_cell(one, style) if isinstance(one, float) else text_cell(one) for one in said]
        for column in columns:
            found = row.values.get(column)
            cells += [figure_cell(part, style) for part in ((None, None) if found is None else found[:2])]
        writer.writerow(cells)
    return stream.getvalue()
