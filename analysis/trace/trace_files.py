"""Traces measured elsewhere: CSV, Parquet and NI TDMS files with known column names.

Columns: t_s, torque_in_nm, torque_out_nm, angle_in_rad or angle_in_arcmin, angle_out_rad or angle_out_arcmin,
temperature_c, drive_torque_nm, segment. The unit is read from the name. Other columns are left alone, but for those
that are nearly one of these: what is dropped there would be missed by the evaluation. What stands in the column
`segment` (or `branch`) is described in `segment_names`. What is no table at all is told by its first bytes, so that the
message is not a parser's complaint.
"""

from __future__ import annotations

import re
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from analysis.trace.errors import AnalysisError
from analysis.trace.segment_names import SEGMENT_COLUMNS, read_segments
from analysis.trace.trace import SegmentInfo, Trace, first_bad_row
from analysis.trace.units import BoolArray, FloatArray, IntArray
from definitions.units import RAD_PER_ARCMIN

COLUMNS: dict[str, tuple[str, float]] = {
    "t_s": ("t_s", 1.0),
    "torque_in_nm": ("torque_in_nm", 1.0),
    "torque_out_nm": ("torque_out_nm", 1.0),
    "angle_in_rad": ("angle_in_rad", 1.0),
    "angle_in_arcmin": ("angle_in_rad", RAD_PER_ARCMIN),
    "angle_out_rad": ("angle_out_rad", 1.0),
    "angle_out_arcmin": ("angle_out_rad", RAD_PER_ARCMIN),
    "temperature_c": ("temperature_c", 1.0),
    "drive_torque_nm": ("drive_torque_nm", 1.0),
}
"""Column of a file: channel of the trace and factor to its unit."""

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of Parquet's durations, which bring their own: seconds of one count."""

QUANTITIES = ("angle", "torque", "temperature", "temp", "time", "t", "segment", "branch")
"""First words of a column's name that say it is meant as one of ours, whatever unit or shaft comes after."""

MISSPELT = 0.85
"""Likeness (of difflib) from which a name is taken for one of ours with a wrong letter."""

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
    names = [str(name).strip() for name in table.column_names]
    channels: dict[str, tuple[str, FloatArray]] = {}
    for index, name in enumerate(names):
        if name not in COLUMNS:
            continue
        channel, factor = COLUMNS[name]
        if channel in channels:
            raise AnalysisError(
                f"{file}: columns {channels[channel][0]} and {name} both are {channel}; keep one of them"
            )
        column = table.column(index)
        if channel == "t_s" and pa.types.is_duration(column.type):
            column, factor = column.cast(pa.int64()), SECONDS[column.type.unit]
        channels[channel] = (name, factor * _numbers(column, file, name))
    if not channels:
        raise AnalysisError(
            f"{file}: found columns {', '.join(names) or 'none'}; expected some of {', '.join(COLUMNS)}; "
            "name the columns in the first row, separated by commas"
        )
    _refuse_near_misses(names, file)
    if table.num_rows == 0:
        raise AnalysisError(f"{file}: the header is followed by no rows; record a loop")
    segment: IntArray | None = None
    segments: dict[int, SegmentInfo] = {}
    used: BoolArray = np.ones(table.num_rows, dtype=np.bool_)
    for name in SEGMENT_COLUMNS:
        if name in names:
            used, segment, segments = read_segments(table.column(names.index(name)), file, name)
            break
    arrays: dict[str, Any] = {channel: values for channel, (_, values) in channels.items()}
    whole = Trace(**arrays, source=str(file))  # all rows are checked, so that a bad one is named by its number
    rows = np.flatnonzero(used).astype(np.int64) + 1
    if used.all():
        return replace(whole, segment=segment, segments=segments), rows
    kept: dict[str, Any] = {channel: values[used] for channel, values in arrays.items()}
    return Trace(**kept, segment=segment, segments=segments, source=str(file)), rows


def _refuse_near_misses(names: list[str], file: Path) -> None:
    """Refuse a column that is meant as one of ours and is named otherwise: dropped, it would change what is judged."""
    allowed = (*COLUMNS, *SEGMENT_COLUMNS)
    for name in names:
        if name in allowed:
            continue
        plain = "_".join(re.findall("[^\\W_]+", name.lower()))
        if plain.split("_")[0] in QUANTITIES or get_close_matches(plain, allowed, n=1, cutoff=MISSPELT):
            raise AnalysisError(
                f"{file}: column '{name}' is named nearly as a column of a trace and would be left out; allowed are "
                f"{', '.join(allowed)}; convert it to that unit and name it so, or begin its name with another word, "
                "as in motor_torque_nm, when it is something else"
            )


def _read_table(file: Path) -> Any:
    try:
        with file.open("rb") as stream:
            start = stream.read(4)
        if start == TDMS_MAGIC:
            from analysis.trace.tdms_files import read_tdms_table  # noqa: PLC0415 - half a second for one kind of file

            return read_tdms_table(file, frozenset([*COLUMNS, *SEGMENT_COLUMNS]))
        wrong = "" if start == PARQUET_MAGIC else not_a_table(file)
        if wrong:
            raise AnalysisError(f"{file}: cannot be read as CSV, Parquet or TDMS: {wrong}")
        table = pa_parquet.read_table(file) if start == PARQUET_MAGIC else _read_csv(file)
        _ = table.column_names  # Arrow checks names when they are asked for: UnicodeDecodeError here, not later
    except (OSError, pa.ArrowException, ValueError, UnicodeError, MemoryError, NotImplementedError) as error:
        reason = printable(str(error))
        raise AnalysisError(
            f"{file}: cannot be read as CSV, Parquet or TDMS: {reason}; expected a table with a header row, "
            "commas between columns and points in numbers"
        ) from error
    return table


def _read_csv(file: Path) -> Any:
    return pa_csv.read_csv(
        file,
        read_options=pa_csv.ReadOptions(use_threads=False),
        parse_options=pa_csv.ParseOptions(invalid_row_handler=None),
        convert_options=pa_csv.ConvertOptions(column_types=_as_text(file), strings_can_be_null=False),
    )


def _as_text(file: Path) -> dict[str, Any]:
    """Read every column as text: numbers are converted here, so that a bad one is named by row and column."""
    with file.open("rb") as stream:
        header = stream.readline(1_000_000).decode("utf-8-sig")
    names = header.strip("\r\n").split(",")
    return {name.strip('"'): pa.string() for name in names}


def _numbers(column: Any, file: Path, name: str) -> FloatArray:
    """Convert a column to numbers; AnalysisError with row and what was found there."""
    kind = column.type
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind):
        numbers = column.cast(pa.float64(), safe=False)
    else:
        try:
            text = column.cast(pa.string())
            numbers = pc.cast(pc.utf8_trim_whitespace(text), pa.float64())
        except (pa.ArrowException, ValueError) as error:
            row, found = _first_not_a_number(column)
            raise AnalysisError(
                f"{file}: row {row}, column {name}: found '{found}'; expected a number; repair or remove the row"
            ) from error
    values: FloatArray = numbers.to_numpy().astype(np.float64)
    bad = ~np.isfinite(values)
    if bad.any():
        row = first_bad_row(bad)
        raise AnalysisError(
            f"{file}: row {row}, column {name}: found {column[row - 1].as_py()!r}; expected a finite number; repair "
            "or remove the row"
        )
    return values


def _first_not_a_number(column: Any) -> tuple[int, str]:
    """Row and text of the first value that Arrow takes for no number: Python's float() takes more than it does."""
    for row, scalar in enumerate(column, start=1):
        try:
            value = scalar.as_py()
        except UnicodeDecodeError as error:
            return row, bytes(error.object).decode("utf-8", "replace")
        try:
            pc.cast(pc.utf8_trim_whitespace(pa.scalar(value, pa.string())), pa.float64())
        except (pa.ArrowException, TypeError, ValueError):
            return row, str(value)
    return 1, f"{column.type}, which holds no numbers"


NO_TABLES: tuple[tuple[bytes, str, str], ...] = (
    (b"%PDF", "a PDF document", "name the table that it was made from"),
    (b"PK\x03\x04", "a ZIP archive or an Excel workbook", "save the sheet as CSV with commas between columns"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook of the old kind", "save the sheet as CSV with commas between columns"),
    (b"\x1f\x8b", "a file packed by gzip", "unpack it first"),
    (b"\xff\xfe", "text in UTF-16", "save it as CSV in UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it as CSV in UTF-8"),
    (b"\x89PNG", "a picture", "name the table that it was made from"),
    (b"\x89HDF", "an HDF5 or MATLAB file", "export its arrays as CSV or Parquet"),
    (b"MATLAB", "a MATLAB file", "export its arrays as CSV or Parquet"),
    (b"<!DOCTYPE", "a web page", "name the table that it was made from"),
    (b"<html", "a web page", "name the table that it was made from"),
)
"""First bytes, what such a file is, and what to do."""

OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "upright bars"}
LOOKED_AT = 4096
"""Bytes from the start that are looked at."""


def not_a_table(file: Path) -> str:
    """Return in words why a file cannot be a CSV table, and what to do; '' when nothing speaks against it.

    Raises OSError for a file that cannot be read.
    """
    with file.open("rb") as stream:
        start = stream.read(LOOKED_AT)
    for magic, what, then in NO_TABLES:
        if start.startswith(magic):
            return f"it is {what}: {then}"
    if b"\0" in start:
        return "it holds binary data: export the table as CSV or Parquet"
    header = start.split(b"\n", 1)[0].decode("utf-8", "replace")
    for sign, name in OTHER_SEPARATORS.items():
        if sign in header and "," not in header:
            return (
                f"found {name} between the columns: write commas between columns and points in numbers (a spreadsheet "
                "does so in English settings)"
            )
    return ""


def printable(text: str, longest: int = 160) -> str:
    """Return a parser's words in one line, without what a terminal cannot show, cut where they are long."""
    plain = "".join(sign if sign.isprintable() and sign.isascii() else "?" for sign in " ".join(text.split()))
    return plain if len(plain) <= longest else plain[: longest - 3] + "..."
