"""A stored run as a file of another program, with all that the file must say of the run to stand alone."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from recipes import RecipeError
from station.bench.request import Source
from station.documents.exported import ExportedRun
from station.errors import RecordError, StationError
from station.records.run_record import RECIPE_COPY, RunRecord
from station.records.samples.check import check_bytes
from station.records.samples.samples import samples_bytes
from station.records.samples.table import table_of
from station.reports.stored_result import stored_result
from station.results.export import FORMATS, LOCALES, Column, Writer, columns_of, sidecar, write_csv
from station.results.export_origin import TraceNote, for_analysis
from station.results.trace_origin import measured_unit


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
    ratio, loading = None, None
    with contextlib.suppress(RecipeError):  # one that is no recipe any more: then the file says nothing of them
        _, loading, ratio = measured_unit(Source.read(run.folder / RECIPE_COPY).recipe())
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
        ratio=ratio,
        loading=loading,
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


def export_run(run: RunRecord, file_format: str, path: Path, locale: str = "en") -> Exported:
    """Write a run to a file, completely or not at all; of an altered record the file says so.

    Args:
        run: the run.
        file_format: one of `FORMATS`.
        path: the file.
        locale: one of `LOCALES`; another than `en` is for CSV.

    Raises:
        StationError: the run has no records, or they are damaged.
        OSError: the file cannot be written.

    """
    writer = FORMATS[file_format] if locale == "en" else partial(write_csv, style=LOCALES[locale])
    content, layout = samples_bytes(run), run.layout()
    read_back = check_bytes(content, None, layout)
    # A run that was cut off has half a record at its end; anything else is damage and must not leave as a measurement.
    damage = [problem for problem in read_back.problems if "after the last complete record" not in problem]
    if damage:
        raise RecordError(
            f"run {run.id} cannot be exported, because its record is damaged: {damage[0]}. Restore the run from a "
            "backup"
        )
    if not read_back.records:
        raise StationError(f"run {run.id} cannot be exported: it has no records. Choose another run")
    table = table_of(content, layout)
    measured, note = for_analysis(run, table)
    columns = columns_of(table, run.manifest().period_ns, measured)
    said = described(run, note)
    _write(path, writer, columns, said)
    return Exported(
        run=run.id,
        file=str(path),
        format=file_format,
        scans=read_back.records,
        columns=len(columns),
        bytes=path.stat().st_size,
        altered=said.altered or (),
    )


def _write(path: Path, write: Writer, columns: list[Column], run: ExportedRun) -> None:
    """Write the file, and what stands beside it, completely or not at all; nothing is left of what failed."""
    part = path.with_name(f".{path.name}.part")
    finals = {part: path, sidecar(part): sidecar(path)}
    try:
        write(part, columns, run)
        for written, final in finals.items():
            if written.exists():
                written.replace(final)
    finally:
        for written in finals:
            with contextlib.suppress(OSError):  # where nothing can be written, nothing can be taken away either
                written.unlink(missing_ok=True)
