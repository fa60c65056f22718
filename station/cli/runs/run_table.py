"""`lostmotion runs`: a row for each run with its metrics, on the screen or as CSV for a spreadsheet."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path

from station.cli.out_file import refuse_records, writing
from station.cli.say import Grid, say
from station.counted import counted
from station.documents.manifest import VERDICTS
from station.errors import StationError
from station.reports.result_text import number
from station.results.csv_cells import MARK, text_cell
from station.results.export import LOCALES
from station.store.run_csv import csv_of
from station.store.run_table import RUN_COLUMNS, RunTableRow, run_table
from station.store.stored_runs import Wanted
from station.store.view import look_at

SHOWN = ("run", "serial", "attempt", "recipe", "verdict")
"""Columns on the screen; the CSV has all."""


def runs(data: Path, wanted: Wanted, out: Path | None, locale: str, *, as_csv: bool, as_json: bool) -> int:
    """Print the runs that are meant, oldest first; return 0.

    out: file for the CSV; None writes it to standard output. locale: one of `LOCALES`.

    Raises:
        StationError: no such folder, verdict, date or locale, or a file that cannot be written.

    """
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    if wanted.verdict is not None and wanted.verdict not in VERDICTS:
        raise StationError(f"--verdict: found {wanted.verdict!r}; allowed are {', '.join(VERDICTS)}")
    if locale not in LOCALES:
        raise StationError(f"--locale: found {locale!r}; allowed are {', '.join(LOCALES)}")
    if out is not None:
        refuse_records(out)
    wanted = wanted._replace(since=None if wanted.since is None else moment_of(wanted.since))
    with look_at(data) as view:
        rows = run_table(view, wanted)
    if out is not None:
        with writing(out):
            out.write_text(MARK + csv_of(rows, LOCALES[locale]), encoding="utf-8", newline="")
        if not as_csv and not as_json:
            sys.stdout.write(f"{counted(len(rows), 'run')} written to {out}\n")
            return 0
    if as_csv and out is None:
        sys.stdout.write(csv_of(rows, LOCALES[locale]))
        return 0
    if not rows and not as_csv and not as_json:
        none_meant = (
            f"{data}: none of {counted(len(view.runs), 'run')} is meant" if view.runs else f"{data}: holds no runs"
        )
        sys.stdout.write(f"{none_meant}\n")
        return 0
    runs = [
        {name: row.cell(name) for name in RUN_COLUMNS}
        | {"metrics": [column._asdict() | value._asdict() for column, value in row.values.items()]}
        for row in rows
    ]
    return 0 if as_csv else say({"runs": runs}, _blocks(rows), as_json=as_json)


def moment_of(text: str, option: str = "--since") -> str:
    """Return a date, or a date and time, as the runs have theirs: in UTC; StationError for what is none."""
    try:  # the first and the last day of the calendar may have no moment in UTC
        return datetime.fromisoformat(text).astimezone(UTC).isoformat(timespec="milliseconds")
    except (ValueError, OverflowError):
        raise StationError(
            f"{option}: found {text!r}; allowed is a date, as in 2026-01-31 or 2026-01-31T08:00"
        ) from None


def _blocks(rows: list[RunTableRow]) -> list[str | Grid]:
    shown = []
    for row in rows:
        bad = [(column, value) for column, value in row.values.items() if value.verdict == "FAIL"]
        why = ", ".join(f"{column.name} {number(value.value, value.uncertainty)}" for column, value in bad)
        said = (why or str(row.run.altered or row.run.objection), row.attempts.partition("; ")[2])
        shown.append([*(text_cell(row.cell(name)) for name in SHOWN), "; ".join(part for part in said if part)])
    return [Grid((*SHOWN, "problems, attempts before"), shown, right=(2,)), counted(len(rows), "run")]
