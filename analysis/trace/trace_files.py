"""Traces measured elsewhere: CSV, Parquet and NI TDMS files with known column names.

Columns: t_s, torque_in_nm, torque_out_nm, angle_in_rad or angle_in_arcmin, angle_out_rad or angle_out_arcmin,
windup_rad or windup_arcmin, temperature_c, drive_torque_nm, drive_angle_rad, segment. The unit is read from the name.
Other columns are left alone, but for those that are nearly one of these: what is dropped there would be missed by the
evaluation. What stands in the column `segment` (or `branch`) is described in `segment_names`. What is no table at all
is told by its first bytes, so that the message is not a parser's complaint.
"""

from __future__ import annotations

import re
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet

from analysis.trace.csv_table import CsvTable, read_csv_table
from analysis.trace.errors import AnalysisError, TableError
from analysis.trace.number_text import read_numbers
from analysis.trace.segment_names import SEGMENT_COLUMNS, read_segments
from analysis.trace.time_column import TIME, read_time
from analysis.trace.trace import SegmentInfo, Trace, first_bad_row
from analysis.trace.unit_rows import UnitRow, check_agree, check_units
from analysis.trace.units import BoolArray, FloatArray, IntArray
from definitions.image import IMAGE_FIELDS
from definitions.units import RAD_PER_ARCMIN

COLUMNS: dict[str, tuple[str, float]] = {
    "t_s": ("t_s", 1.0),
    "torque_in_nm": ("torque_in_nm", 1.0),
    "torque_out_nm": ("torque_out_nm", 1.0),
    "angle_in_rad": ("angle_in_rad", 1.0),
    "angle_in_arcmin": ("angle_in_rad", RAD_PER_ARCMIN),
    "angle_out_rad": ("angle_out_rad", 1.0),
    "angle_out_arcmin": ("angle_out_rad", RAD_PER_ARCMIN),
    "windup_rad": ("angle_out_rad", 1.0),
    "windup_arcmin": ("angle_out_rad", RAD_PER_ARCMIN),
    "temperature_c": ("temperature_c", 1.0),
    "drive_torque_nm": ("drive_torque_nm", 1.0),
    "drive_angle_rad": ("drive_angle_rad", 1.0),
}
"""Column of a file: channel of the trace and factor to its unit."""

WINDUPS = ("windup_rad", "windup_arcmin")
"""Columns that hold a wind-up made elsewhere: nothing is to be taken out of it any more."""

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of Parquet's durations, which bring their own: seconds of one count."""

QUANTITIES = ("angle", "windup", "torque", "temperature", "temp", "time", "t", "segment", "branch")
"""First words of a column's name that say it is meant as one of ours, whatever unit or shaft comes after."""

MISSPELT = 0.85
"""Likeness (of difflib) from which a name is taken for one of ours with a wrong letter."""

UNIT_OF_FIELD = b"unit"
"""Metadata of a Parquet column, or of one made of a TDMS channel, that says its unit."""

TDMS_MAGIC = b"TDSm"
PARQUET_MAGIC = b"PAR1"


def read_trace(path: Path | str) -> Trace:
    """Read a CSV, Parquet or TDMS file (told apart by content) to a trace.

    Raises AnalysisError for anything that is wrong with the file: not there, empty, not a table, no known column, two
    columns for one channel, a value that is no number (with row and column), a segment name that is not known, no row
    that is used. Rows count from 1 after the header.
    """
    return read_rows(path)[0]


def read_rows(path: Path | str) -> tuple[Trace, IntArray]:
    """Read a file as `read_trace` does; return also the row of each sample, for rows that are not used are left out."""
    file = Path(path)
    table = _read_table(file)
    names = list(table.names)
    chosen: dict[str, int] = {}
    for index, name in enumerate(names):
        if name in COLUMNS:
            channel = COLUMNS[name][0]
            if channel in chosen:
                raise TableError(
                    file, f"columns {names[chosen[channel]]} and {name}, which both mean {channel}", "one of them",
                    "keep one of them", column=name,
                )  # fmt: skip
            chosen[channel] = index
    if not chosen:
        raise TableError(
            file, f"columns {', '.join(names) or 'none'}", f"some of {', '.join(COLUMNS)}",
            "name the columns in the first row",
        )  # fmt: skip
    _refuse_near_misses(names, file)
    check_agree(file, names, table.units)
    check_units(file, names, table.units)
    if table.rows == 0:
        raise TableError(file, "no rows below the header", "the samples of a loop", "record a loop")
    channels, decimals = _channels(table, chosen)
    segment: IntArray | None = None
    segments: dict[int, SegmentInfo] = {}
    used: BoolArray = np.ones(table.rows, dtype=np.bool_)
    for name in SEGMENT_COLUMNS:
        if name in names:
            used, segment, segments = read_segments(table.columns[names.index(name)], file, name)
            break
    arrays: dict[str, Any] = dict(channels)
    # all rows are checked, so that a bad one is named by its number
    made = any(name in WINDUPS for name in names)
    whole = Trace(**arrays, source=str(file), reading=_told(table, decimals), windup_made=made)
    rows = np.flatnonzero(used).astype(np.int64) + 1
    if used.all():
        return replace(whole, segment=segment, segments=segments), rows
    kept: dict[str, Any] = {channel: values[used] for channel, values in arrays.items()}
    return replace(whole, **kept, segment=segment, segments=segments), rows


class _Table(NamedTuple):
    """Names and columns of a file of any kind, and what it says of their units; `csv` where it is text."""

    file: Path
    names: tuple[str, ...]
    columns: tuple[Any, ...]
    units: tuple[UnitRow, ...] = ()
    csv: CsvTable | None = None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0]) if self.columns else 0

    def fail(self, row: int, column: str, found: str, allowed: str, hint: str) -> TableError:
        """Make the error for one cell."""
        line = None if self.csv is None else self.csv.line_of(row)
        return TableError(self.file, found, allowed, hint, row=row, line=line, column=column)


def _channels(table: _Table, chosen: dict[str, int]) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return the channels in their units, and how their numbers were read."""
    texts = {table.names[index]: table.columns[index] for index in chosen.values() if is_text(table.columns[index])}
    by_comma = table.csv is None or table.csv.separator == ","
    read = read_numbers(texts, table.fail, by_comma=by_comma)
    channels: dict[str, FloatArray] = {}
    for channel, index in chosen.items():
        name, column = table.names[index], table.columns[index]
        factor = COLUMNS[name][1]
        if channel == "t_s" and pa.types.is_duration(column.type):
            column, factor = column.cast(pa.int64()), SECONDS[column.type.unit]
        values = read.columns[name] if name in texts else _numbers(column, table, name)
        bad = ~np.isfinite(values)
        if bad.any():
            row = first_bad_row(bad)
            cell = table.columns[index][row - 1].as_py()
            raise table.fail(row, name, repr(cell), "a finite number", "repair or remove the row")
        channels[channel] = factor * values
    if TIME not in channels:
        return channels, read.reading
    time = read_time(channels[TIME], table.fail)
    return {**channels, TIME: time.seconds}, (*read.reading, *([time.reading] if time.reading else ()))


def is_text(column: Any) -> bool:
    """Whether a column (pyarrow) holds text, plain or by a dictionary."""
    kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _numbers(column: Any, table: _Table, name: str) -> FloatArray:
    """Convert a column of numbers; TableError for one that holds none."""
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
        raise table.fail(1, name, f"{kind}, which holds no numbers", "numbers", "convert the column to numbers")
    values: FloatArray = column.cast(pa.float64(), safe=False).to_numpy().astype(np.float64)
    return values


def _told(table: _Table, decimals: tuple[str, ...]) -> str:
    """Return in words how a file was read that is not plain CSV; '' for one that is."""
    parts = [*(() if table.csv is None else table.csv.reading), *decimals]
    kind = "a table" if table.csv is None else "CSV"
    return f"read as {kind} with {', '.join(parts)}" if parts else ""


RECORDED = frozenset(field.name for field in IMAGE_FIELDS)
"""Columns of an exported run: of those that are no quantity of a trace each has its own meaning."""


def _refuse_near_misses(names: list[str], file: Path) -> None:
    """Refuse a column that is meant as one of ours and is named otherwise: dropped, it would change what is judged."""
    allowed = (*COLUMNS, *SEGMENT_COLUMNS)
    for name in names:
        if name in allowed or name in RECORDED:
            continue
        plain = "_".join(re.findall("[^\\W_]+", name.lower()))
        if plain.split("_")[0] in QUANTITIES or get_close_matches(plain, allowed, n=1, cutoff=MISSPELT):
            raise AnalysisError(
                f"{file}: column '{name}' is named nearly as a column of a trace and would be left out; allowed are "
                f"{', '.join(allowed)}; convert it to that unit and name it so, or begin its name with another word, "
                "as in motor_torque_nm, when it is something else"
            )


def _read_table(file: Path) -> _Table:
    try:
        with file.open("rb") as stream:
            start = stream.read(4)
        if start == TDMS_MAGIC:
            from analysis.trace.tdms_files import read_tdms_table  # noqa: PLC0415 - half a second for one kind of file

            return _of_arrow(file, read_tdms_table(file, frozenset([*COLUMNS, *SEGMENT_COLUMNS])))
        if start == PARQUET_MAGIC:
            return _of_arrow(file, pa_parquet.read_table(file))
        wrong = not_a_table(file)
        if wrong:
            raise AnalysisError(f"{file}: cannot be read as CSV, Parquet or TDMS: {wrong}")
        read = read_csv_table(file, (*COLUMNS, *SEGMENT_COLUMNS))
        return _Table(file, read.names, tuple(read.cells.columns), read.units, read)
    except (OSError, pa.ArrowException, ValueError, UnicodeError, MemoryError, NotImplementedError) as error:
        reason = printable(str(error))
        raise TableError(
            file, f"a file that cannot be read as CSV, Parquet or TDMS: {reason}", "a table with a header row",
            "save it as CSV",
        ) from error  # fmt: skip


def _of_arrow(file: Path, table: Any) -> _Table:
    # Arrow checks names when they are asked for: UnicodeDecodeError here, not later
    names = tuple(str(name).strip() for name in table.column_names)
    units = tuple((field.metadata or {}).get(UNIT_OF_FIELD, b"").decode() for field in table.schema)
    return _Table(file, names, tuple(table.columns), (UnitRow(0, units),))


NO_TABLES: tuple[tuple[bytes, str, str], ...] = (
    (b"%PDF", "a PDF document", "name the table that it was made from"),
    (b"PK\x03\x04", "a ZIP archive or an Excel workbook", "save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook of the old kind", "save the sheet as CSV"),
    (b"\x1f\x8b", "a file packed by gzip", "unpack it first"),
    (b"\x89PNG", "a picture", "name the table that it was made from"),
    (b"\x89HDF", "an HDF5 or MATLAB file", "export its arrays as CSV or Parquet"),
    (b"MATLAB", "a MATLAB file", "export its arrays as CSV or Parquet"),
    (b"<!DOCTYPE", "a web page", "name the table that it was made from"),
    (b"<html", "a web page", "name the table that it was made from"),
)
"""First bytes, what such a file is, and what to do."""

LOOKED_AT = 16
"""Bytes from the start that are looked at."""


def not_a_table(file: Path) -> str:
    """Return in words why a file cannot be a CSV table, and what to do; '' when nothing speaks against it.

    Raises OSError for a file that cannot be read.
    """
    with file.open("rb") as stream:
        start = stream.read(LOOKED_AT)
    for magic, what, then in NO_TABLES:
        if start.startswith(magic):
            return f"the file is {what}: {then}"
    return ""


def printable(text: str, longest: int = 160) -> str:
    """Return a parser's words in one line, without what a terminal cannot show, cut where they are long."""
    plain = "".join(sign if sign.isprintable() and sign.isascii() else "?" for sign in " ".join(text.split()))
    return plain if len(plain) <= longest else plain[: longest - 3] + "..."
