"""`lostmotion export`: a stored run as a file of another program."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.cli.out_file import refuse_records, writing
from station.documents.entries import plain
from station.errors import StationError
from station.records.data_folder import Store
from station.records.seal import EXIT_ALTERED, alteration_lines
from station.reports.export_of_run import export_run
from station.results.export import FORMATS, LOCALES


def export(name: str, data: Path, file_format: str, out: Path | None, *, locale: str = "en", as_json: bool) -> int:
    """Export a run; return 0, or 3 for an altered record, which the file and the command both say.

    Raises:
        StationError: there is no such run or format, the run has no records, they are damaged, or the file cannot be
            written.

    """
    if file_format not in FORMATS:
        raise StationError(f"--format: found {file_format!r}; allowed are {', '.join(FORMATS)}")
    if locale not in LOCALES:
        raise StationError(f"--locale: found {locale!r}; allowed are {', '.join(LOCALES)}")
    if locale != "en" and file_format != "csv":
        raise StationError("--locale is for --format csv; the other formats are the same everywhere. Leave it out")
    run = Store(data).find(name)
    path = Path(f"{run.id}.{file_format}") if out is None else out
    if path.is_dir():
        path = path / f"{run.id}.{file_format}"
    refuse_records(path)
    with writing(path):
        found = export_run(run, file_format, path, locale)
    if as_json:
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
    else:
        told = f"{path}: {found.scans} scans, {found.columns} columns, {found.bytes} bytes"
        sys.stdout.write("\n".join([*alteration_lines(found.altered), told]) + "\n")
    return EXIT_ALTERED if found.altered else 0
