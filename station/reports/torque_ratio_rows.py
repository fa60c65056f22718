"""The torque ratio of a run as rows of text: its lines, the points they were fitted to, and whose calibration it is."""

from __future__ import annotations

import csv
import io

from analysis.evaluation.pipeline import Result
from analysis.torque_ratio.line_fit import RatioFit
from analysis.torque_ratio.quadrants import QUADRANTS
from recipes import Bench, Calibration
from recipes.schema.calibration_schema import QuadrantLine
from station.documents.ratio import RatioRecord
from station.errors import RecordError
from station.records.run_record import CALIBRATION, RunRecord
from station.reports.result_text import minus

RATIO_CSV = "torque_ratio.csv"

LINE_HEADS = ("quadrant", "C [N·m]", "m", "u(C)", "u(m)", "correlation", "s [N·m]", "points", "flagged")

ASSUMED = "a line without uncertainties is assumed known to 0.5 % of its slope and 0.5 N·m"

Row = tuple[str, ...]


def line_rows(analysis: Result | None, stored: Calibration | None) -> tuple[Row, ...]:
    """Return the four lines as rows of `LINE_HEADS`: those that were fitted, or those of the stored calibration."""
    if analysis is None:
        return ()
    fits = {} if analysis.quadrants is None else analysis.quadrants.fits
    if stored is not None and not fits:
        return tuple(_row(name, getattr(stored, name), "–", "–") for name in QUADRANTS)
    return tuple(_row(name, fit, str(fit.points), str(fit.flagged.size)) for name, fit in fits.items())


def _row(name: str, line: QuadrantLine | RatioFit, points: str, flagged: str) -> Row:
    formats = {
        "offset_nm": ".6f", "slope": ".6f", "u_offset_nm": ".2g", "u_slope": ".2g", "correlation": ".4f",
        "residual_sd_nm": ".3g",
    }  # fmt: skip
    values = ((getattr(line, key), how) for key, how in formats.items())
    figures = ("–" if value is None else minus(f"{value:{how}}") for value, how in values)
    return (name.replace("_", " "), *figures, points, flagged)


def ratio_csv(analysis: Result | None) -> bytes:
    """Return as CSV the points that the lines of this run were fitted to; empty where none was."""
    if analysis is None or analysis.quadrants is None or not analysis.quadrants.fits:
        return b""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("quadrant", "torque_in_nm", "torque_out_nm"))
    for name, fit in analysis.quadrants.fits.items():
        pairs = zip(fit.inputs_nm.tolist(), fit.outputs_nm.tolist(), strict=True)
        writer.writerows((name, x, y) for x, y in pairs)  # every digit: the line can be fitted again
    return stream.getvalue().encode()


def lines_title(record: RunRecord, stored: Calibration | None) -> str:
    """Return what stands above the lines: whose they are."""
    if stored is not None:
        return f"stored calibration {stored.id}"
    made = _measured(record)
    return f"calibration {made.id} of this run" if made is not None else "measured by this run"


def calibration_rows(record: RunRecord, stored: Calibration | None, bench: Bench) -> tuple[Row, ...]:
    """Return the calibrations that the run measured or used: id and text."""
    rows: list[Row] = []
    if stored is not None:
        rows.append((stored.id, _stored_text(stored, bench)))
    made = _measured(record)
    if made is not None:
        on = f" on bench {made.bench.name} revision {made.bench.revision}" if made.bench.name else ""
        rows.append((made.id, f"torque ratio of {made.model}{on}, measured by this run on {made.made[:10]}"))
    elif record.has(CALIBRATION):
        rows.append((CALIBRATION, "is damaged"))
    return tuple(rows)


def _stored_text(stored: Calibration, bench: Bench) -> str:
    parts = [
        f"torque ratio of {stored.model}, stored in bench {bench.bench.name} revision {bench.bench.revision}",
        f"made {stored.made}, due {stored.due}",
    ]
    if stored.units:
        serials = ", ".join(unit.serial for unit in stored.units)
        parts.append(f"mean of {len(stored.units)} units ({serials}), the fitted line of each is in bench.yaml")
    if stored.transition_rad is None:
        parts.append("samples after a reversal are left out, because no transition after a reversal was stored")
    else:
        parts.append(f"transition after a reversal {stored.transition_rad:.4g} rad at the input")
    lines = [getattr(stored, name) for name in QUADRANTS]
    if any(line.u_slope is None or line.u_offset_nm is None for line in lines):
        parts.append(ASSUMED)
    return "; ".join(parts)


def _measured(record: RunRecord) -> RatioRecord | None:
    """Return what calibration.json says; None where there is none, or it is damaged."""
    try:
        return record.read(RatioRecord, CALIBRATION)
    except RecordError:
        return None
