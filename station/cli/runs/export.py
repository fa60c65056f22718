"""`lostmotion export`: a stored run as a file of another program."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from station.atomic_file import write_atomic
from station.cli.out_file import refuse_records, writing
from station.counted import counted
from station.documents.entries import plain
from station.errors import StationError
from station.quality.dfq.write import Written, dfq_of_run
from station.records.data_folder import Store
from station.records.seal import EXIT_ALTERED, alteration_lines, alterations
from station.reports.export_of_run import export_run
from station.results.export import FORMATS, LOCALES, sidecar
from station.store.quality.lot import production
from station.version import version

DFQ = "dfq"
"""Format of values alone, without the samples."""


def export(name: str, data: Path, file_format: str, out: Path | None, *, locale: str = "en", as_json: bool) -> int:
    """Export a run; return 0, or 3 for an altered record, which the file and the command both say.

    AQDEF has no place where a file could say it: of an altered record none is written.

    Raises:
        StationError: there is no such run or format, the run has no records, they are damaged, or the file cannot be
            written.

    """
    if file_format not in (*FORMATS, DFQ):
        raise StationError(f"--format: found {file_format!r}; allowed are {', '.join(FORMATS)}, {DFQ}")
    if locale not in LOCALES:
        raise StationError(f"--locale: found {locale!r}; allowed are {', '.join(LOCALES)}")
    if locale != "en" and file_format != "csv":
        raise StationError("--locale is for --format csv; the other formats are the same everywhere. Leave it out")
    run = Store(data).find(name)
    path = Path(f"{run.id}.{file_format}") if out is None else out
    if path.is_dir():
        path = path / f"{run.id}.{file_format}"
    refuse_records(path)
    refuse_records(sidecar(path))
    if file_format == DFQ:
        altered = alterations(run)
        if altered:
            return _refused(path, altered, as_json=as_json)
        with production(run.folder.parent) as look:
            return write_dfq(path, dfq_of_run(look, run.id, program_name()), as_json=as_json)
    with writing(path):
        found = export_run(run, file_format, path, locale)
    if as_json:
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
    else:
        told = f"{path}: {found.scans} scans, {found.columns} columns, {found.bytes} bytes"
        sys.stdout.write("\n".join([*alteration_lines(found.altered), told]) + "\n")
    return EXIT_ALTERED if found.altered else 0


def _refused(path: Path, altered: tuple[str, ...], *, as_json: bool) -> int:
    """Tell that an altered record is in no file, as a file of this format cannot say that it is one; return 3."""
    why = f"{path}: was not written: an AQDEF file has no place to say that a record was altered. See 'lostmotion show'"
    if as_json:
        sys.stdout.write(json.dumps({"file": None, "format": DFQ, "altered": altered}) + "\n")
    sys.stderr.write("\n".join([*alteration_lines(altered), why]) + "\n")
    return EXIT_ALTERED


def program_name() -> str:
    """Return what wrote a file, for the file."""
    return f"lostmotion {version()}"


def write_dfq(path: Path, found: Written, *, as_json: bool) -> int:
    """Write an AQDEF file, completely or not at all, and tell what is in it; return 0.

    Raises:
        StationError: it cannot be written.

    """
    with writing(path):
        write_atomic(path, found.content)
    if as_json:
        document = {"file": str(path), "format": DFQ, "runs": found.runs, "characteristics": found.characteristics}
        sys.stdout.write(json.dumps({**document, "left_out": found.left_out}) + "\n")
    else:
        rest = f"; {counted(found.left_out, 'run')} without these metrics" if found.left_out else ""
        sys.stdout.write(
            f"{path}: {counted(found.runs, 'run')}, {counted(found.characteristics, 'characteristic')}{rest}\n"
        )
    return 0
