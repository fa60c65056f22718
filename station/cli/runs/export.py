"""`lostmotion export`: a stored run as a file of another program."""

from __future__ import annotations

import contextlib
import json
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from station.cli.out_file import refuse_records, writing
from station.cli.runs.show import stored_result
from station.documents.exported import ExportedRun
from station.documents.reading import plain
from station.errors import RecordError, StationError
from station.records.data_folder import Store
from station.records.run_record import RunRecord
from station.records.samples.check import check_bytes
from station.records.samples.samples import samples_bytes
from station.records.samples.table import table_of
from station.records.seal import EXIT_ALTERED, alteration_lines, alterations
from station.results.export import FORMATS, LOCALES, Column, Writer, columns_of, sidecar, write_csv
from station.results.export_origin import TraceNote, for_analysis


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """What was written: the run, its file, and how much stands in it."""

    run: str
    file: str
    format: str
    scans: int
    columns: int
    bytes: int
    altered: tuple[str, ...]


def described(run: RunRecord, note: TraceNote | None) -> ExportedRun:
    """Return what a file must say of its run to stand alone.

    A unit that was not real, and a scenario whose faults were injected, are part of its identity.
    """
    manifest, result = run.manifest(), stored_result(run)
    return ExportedRun(
        id=manifest.id,
        serial=manifest.serial,
        attempt=manifest.attempt,
        state=manifest.state,
        started=manifest.started,
        ended=manifest.ended,
        clock=manifest.clock,
        period_ns=manifest.period_ns,
        recipe=manifest.recipe,
        bench=manifest.bench,
        software=manifest.software,
        scenario=manifest.scenario,
        operator=manifest.operator,
        unit=manifest.unit.model,
        virtual_unit=manifest.unit.virtual or None,
        noise_seed=manifest.unit.noise_seed,
        # Of an altered record the result decides nothing, and the file says so wherever it goes.
        verdict=result.verdict,
        reasons=result.reasons,
        metrics=result.metrics,
        timing=result.timing,
        altered=result.altered,
        trace=None if note is None else note.fingerprint,
        recorded=None if note is None else note.recorded,
    )


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
    writer = FORMATS[file_format] if locale == "en" else partial(write_csv, style=LOCALES[locale])
    run = Store(data).find(name)
    altered = alterations(run)
    path = Path(f"{run.id}.{file_format}") if out is None else out
    if path.is_dir():
        path = path / f"{run.id}.{file_format}"
    refuse_records(path)
    content, layout = samples_bytes(run), run.layout()
    read_back = check_bytes(content, None, layout)
    # A run that was cut off has half a record at its end; anything else is damage and must not leave as a measurement.
    damage = [problem for problem in read_back.problems if "after the last complete record" not in problem]
    if damage:
        raise RecordError(f"{run.id}: {damage[0]}; a damaged record is not exported")
    if not read_back.records:
        raise StationError(f"{run.id}: the run has no records: nothing was measured")
    table = table_of(content, layout)
    measured, note = for_analysis(run, table)
    columns = columns_of(table, run.manifest().period_ns, measured)
    _write(path, writer, columns, described(run, note))
    found = Exported(
        run=run.id,
        file=str(path),
        format=file_format,
        scans=read_back.records,
        columns=len(columns),
        bytes=path.stat().st_size,
        altered=altered,
    )
    if as_json:
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
    else:
        told = f"{path}: {read_back.records} scans, {len(columns)} columns, {found.bytes} bytes"
        sys.stdout.write("\n".join([*alteration_lines(altered), told]) + "\n")
    return EXIT_ALTERED if altered else 0


def _write(path: Path, write: Writer, columns: list[Column], run: ExportedRun) -> None:
    """Write the file, and what stands beside it, completely or not at all; nothing is left of what failed.

    Raises:
        StationError: the folder is not there or read-only, or the disk is full.

    """
    part = path.with_name(f".{path.name}.part")
    finals = {part: path, sidecar(part): sidecar(path)}
    try:
        with writing(path):
            write(part, columns, run)
            for written, final in finals.items():
                if written.exists():
                    written.replace(final)
    finally:
        for written in finals:
            with contextlib.suppress(OSError):  # where nothing can be written, nothing can be taken away either
                written.unlink(missing_ok=True)
