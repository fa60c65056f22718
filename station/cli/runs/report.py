"""`lostmotion report`: HTML and PDF of a stored run, made anew from its record."""

from __future__ import annotations

import json
import sys
import tempfile
import webbrowser
from pathlib import Path

from station.atomic_file import write_atomic
from station.cli.out_file import refuse_records, writing
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import NOT_CONCLUDED
from station.records.seal import EXIT_ALTERED, alteration_lines, alterations
from station.records.to_paste import to_its_result
from station.reports.illustrate import HTML, PDF
from station.reports.report_of_run import made_report


def report(name: str, data: Path, out: Path | None, *, open_it: bool, as_json: bool) -> int:
    """Write report.html and report.pdf into the run's folder, or another one, and say where.

    Returns 0, and 3 for an altered record: report and command say so. The verdict is the stored one; a run without an
    end has no metrics.

    Raises:
        StationError, RecipeError: there is no such run, its record cannot be read, or the folder not be written.

    """
    run = Store(data).find(name)
    if run.state() == NOT_CONCLUDED:
        raise StationError(f"{run.id}: not concluded yet, so there is no result to report. Run '{to_its_result(run)}'")
    folder = run.folder if out is None else out
    if folder.resolve() != run.folder.resolve():
        refuse_records(folder / HTML)
    _refuse_unwritable(folder)
    altered = alterations(run)
    html, pdf = made_report(run, keep=out is None)
    for file, content in ((HTML, html), (PDF, pdf)):
        write_atomic(folder / file, content)
    paths = {"html": str(folder / HTML), "pdf": str(folder / PDF)}
    if as_json:
        sys.stdout.write(json.dumps({"run": run.id, **paths, "altered": altered}, ensure_ascii=False) + "\n")
    else:
        places = f"report  {paths['html']}\n        {paths['pdf']}"
        sys.stdout.write("\n".join([*alteration_lines(altered), places]) + "\n")
    if open_it:
        webbrowser.open((folder / HTML).resolve().as_uri())
    return EXIT_ALTERED if altered else 0


def _refuse_unwritable(folder: Path) -> None:
    """Refuse a folder that takes no file, before anything is made for it."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
