"""CSV files as people have them: of spreadsheets in any language, and of recorders.

Commas, semicolons, tabs or bars part the columns; the text is UTF-8, UTF-16 or Windows-1252. Before the header may
stand `sep=;` and what a recorder says of itself, beside it a row of units; blank rows, and those that begin with a
comment sign, count nowhere else. What of this a file has is told in `reading`. All cells come back as text.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.csv as pa_csv

from analysis.trace.errors import TableError
from analysis.trace.unit_rows import UnitRow, is_below_header, is_row_of_units

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "upright bars"}
"""What parts the columns, and its name."""

COMMENTS = ("#", "//", "%")
"""What a comment begins with."""

DECLARED = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
"""First line by which a spreadsheet says what parts its columns."""

MOST_BEFORE = 200
"""Lines before the header that are looked at."""

BYTE_ORDER_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
ENCODING_NAMES = {"utf-16-le": "UTF-16", "utf-16-be": "UTF-16", "cp1252": "Windows-1252"}
LOOKED_AT = 4096
"""Bytes by which text in UTF-16 without a mark is told from binary data."""

CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
DIRECTION = re.compile("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Characters that make a text look other than it is."""

TABLE = "a table with a header row"
UNQUOTED = "check the separators and quotes of this line"
COMMAS = "export with semicolons or tabs between the columns, or with points as decimal signs"


class CsvTable(NamedTuple):
    """The cells of a file as text (pyarrow), the rows that stand before the data, and how the file was read."""

    file: Path
    names: tuple[str, ...]
    cells: Any
    separator: str
    reading: tuple[str, ...]
    units: tuple[UnitRow, ...]
    """Rows of units, in their order."""
    body: Body

    def column(self, name: str) -> Any:
        """Return the cells of a column as text (pyarrow)."""
        return self.cells.column(self.names.index(name))

    def line_of(self, row: int) -> int:
        """Return the line of the file in which a row (from 1) stands."""
        return self.body.line_of(row)


class Body(NamedTuple):
    """Lines of a file from the first one behind the header on; `first` is its number in the file, from 1."""

    lines: list[str]
    first: int

    def rows(self) -> Iterator[tuple[int, str]]:
        """Yield number in the file and text of each line that is neither blank nor a comment."""
        for number, line in enumerate(self.lines, start=self.first):
            if line.strip() and not line.startswith(COMMENTS):
                yield number, line

    def line_of(self, row: int) -> int:
        """Return the number in the file of a row, from 1; that of the last line where there is no such row."""
        last = self.first
        for count, (number, _) in enumerate(self.rows(), start=1):
            last = number
            if count == row:
                break
        return last


class Header(NamedTuple):
    """The line with the names: its number in the file, the names, what parts them, and what stands before it."""

    line: int
    names: list[str]
    separator: str
    before: int


def read_csv_table(file: Path, known: Collection[str] = (), content: bytes | None = None) -> CsvTable:
    """Read a CSV file; the header is the first line that has one of the known names, or the first line of all.

    content: that of the file, where it was read already.

    Raises:
        TableError: text in no known encoding, no separator that can be told, rows of different length.
        OSError: the file cannot be read.

    """
    text, encoding = _text(file, file.read_bytes() if content is None else content)
    lines = text.split("\n")
    header = _header(lines, known, file)
    body, reading = Body(lines[header.line :], header.line + 1), []
    separator, names = header.separator, list(header.names)
    rows = list(body.rows())
    blanks = separator + ' "'
    while rows and not rows[-1][1].strip(blanks):  # what a spreadsheet writes of cells that were emptied
        rows.pop()
    units = _rows_of_units(lines, header, rows) if known else []
    if rows and any(row.line == rows[0][0] for row in units):
        line, _ = rows.pop(0)
        body = Body(body.lines[line - body.first + 1 :], line + 1)
    if rows and len(_cells(rows[0][1], separator)) == len(names) + 1 and rows[0][1].rstrip(" ").endswith(separator):
        names.append("")
    if separator != ",":
        reading.append(f"{SEPARATORS.get(separator, repr(separator))} between the columns")
    reading += [ENCODING_NAMES[encoding]] if encoding in ENCODING_NAMES else []
    at = [row.line for row in units]
    before = header.before - sum(1 for line in at if line < header.line and not lines[line - 1].startswith(COMMENTS))
    reading += [f"{before} lines before the header left out"] if before else []
    comments = sum(
        1 for number, line in enumerate(body.lines, body.first) if line.startswith(COMMENTS) and number not in at
    )
    reading += [f"{comments} comments left out"] if comments else []
    reading += [f"line {line} has the units" for line in at]
    cells = _parsed([line for _, line in rows], names, separator, body, file)
    return CsvTable(file, tuple(names), cells, separator, tuple(reading), tuple(units), body)


def _text(file: Path, raw: bytes) -> tuple[str, str]:
    """Return the text of a file with plain ends of lines, and its encoding."""
    encoding = next((name for mark, name in BYTE_ORDER_MARKS if raw.startswith(mark)), "")
    if not encoding and b"\0" in raw[:LOOKED_AT]:
        encoding = _without_mark(raw[:LOOKED_AT])
    try:
        text = raw.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding:
            raise TableError(
                file, f"bytes that are not {encoding.upper()} at {error.start}", TABLE, "save it again"
            ) from None
        encoding, text = "cp1252", _windows_text(raw, file)
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    control = CONTROL.search(text[:LOOKED_AT])
    if control:
        raise TableError(file, "binary data", TABLE, "export the table as CSV or Parquet")
    turned = DIRECTION.search(text)
    if turned:
        found = f"the character U+{ord(turned[0]):04X}, which turns the direction of writing"
        line = text.count("\n", 0, turned.start()) + 1
        raise TableError(file, found, "text without such characters", "delete it", line=line)
    return text, encoding or "utf-8"


def _without_mark(start: bytes) -> str:
    """Return which UTF-16 a text without a mark is: every second byte of its plain letters is zero."""
    for name, zeros in (("utf-16-le", start[1::2]), ("utf-16-be", start[0::2])):
        if zeros.count(0) > 0.9 * len(zeros):
            return name
    return ""


def _windows_text(raw: bytes, file: Path) -> str:
    try:
        return raw.decode("cp1252")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        found = f"the byte 0x{raw[error.start]:02X}, which is neither UTF-8 nor Windows-1252"
        raise TableError(file, found, "text in UTF-8", "cannot be read: save it as CSV in UTF-8", line=line) from None


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return [line.strip()]


def _is_whole(line: str, separator: str) -> bool:
    try:
        next(csv.reader([line], delimiter=separator, strict=True), None)
    except csv.Error:
        return False
    return True


def _header(lines: list[str], known: Collection[str], file: Path) -> Header:
    """Find the line with the names, which may be a comment where no other line has them."""
    declared, start = None, 0
    match = DECLARED.fullmatch(lines[0].strip()) if lines else None
    if match or (lines and lines[0].strip("\r\n ").lower() == "sep="):
        declared, start = (match[1] if match else "\t"), 1
    tried = [declared] if declared else list(SEPARATORS)
    candidates = [
        (number, line) for number, line in enumerate(lines[start : start + MOST_BEFORE], start + 1) if line.strip()
    ]
    plain = [(number, line) for number, line in candidates if not line.startswith(COMMENTS)]
    comments = [(number, line.lstrip("#/% ")) for number, line in reversed(candidates) if line.startswith(COMMENTS)]
    for number, line in [*plain, *comments]:
        found = [(len(set(cells) & set(known)), sign, cells) for sign in tried for cells in [_cells(line, sign)]]
        count, sign, cells = max(found, key=lambda one: one[0])
        if count:
            return Header(number, cells, sign, sum(1 for before, _ in plain if before < number))
    if not plain:
        return Header(len(lines), [], ",", 0)
    number, line = plain[0]
    sign = declared or _separator_of(line, plain[1][1] if len(plain) > 1 else "", file, number)
    return Header(number, _cells(line, sign), sign, 0)


def _separator_of(header: str, first: str, file: Path, number: int) -> str:
    """Tell by the header and the line behind it what parts the columns; a comma where there is one column only."""
    counts = {sign: (len(_cells(header, sign)), len(_cells(first, sign))) for sign in SEPARATORS}
    there = [sign for sign, (names, _) in counts.items() if names > 1]
    alike = [sign for sign in there if counts[sign][0] == counts[sign][1]]
    chosen = alike or there or [","]
    if len(chosen) > 1:
        found = " and ".join(SEPARATORS[sign] for sign in chosen)
        raise TableError(
            file, f"{found} in the header", "one separator", "write 'sep=;' as the first line", line=number
        )
    return chosen[0]


def _rows_of_units(lines: list[str], header: Header, rows: list[tuple[int, str]]) -> list[UnitRow]:
    """Return the rows of units above the header, behind it, and in comments that stand before the first data."""
    names, separator = header.names, header.separator
    first, second = [*(_cells(line, separator) for _, line in rows[:2]), [], []][:2]
    below = rows[0][0] if is_below_header(first, second, names) else 0
    data = next((number for number, _ in rows if number != below), len(lines) + 1)
    found = []
    for number, line in enumerate(lines[: data - 1], 1):
        comment = line.startswith(COMMENTS)
        cells = _cells(line.lstrip("#/% ") if comment else line, separator)
        beside = number < header.line or (comment and number > header.line)
        if number == below or (beside and is_row_of_units(cells, names)):
            found.append(UnitRow(number, tuple(cells)))
    return found


def _parsed(rows: list[str], names: list[str], separator: str, body: Body, file: Path) -> Any:
    """Return the cells of the rows as text, one column for each name, in order."""
    if not rows or not names:
        return pa.table({f"f{index}": pa.array([], pa.string()) for index in range(len(names))})
    for row, line in enumerate(rows, start=1):
        if line.count('"') % 2 and not _is_whole(line, separator):
            found = "a quote that is not closed"
            raise TableError(file, found, "pairs of quotes", UNQUOTED, row=row, line=body.line_of(row))
    wrong: list[Any] = []

    def refuse(row: Any) -> str:
        wrong.append(row)
        return "error"

    content = pa.BufferReader("\n".join(rows).encode("utf-8", "replace") + b"\n")
    try:
        return pa_csv.read_csv(
            content,
            read_options=pa_csv.ReadOptions(
                use_threads=False, column_names=[f"f{index}" for index in range(len(names))]
            ),
            parse_options=pa_csv.ParseOptions(
                delimiter=separator, invalid_row_handler=refuse, ignore_empty_lines=False
            ),
            convert_options=pa_csv.ConvertOptions(
                column_types={f"f{index}": pa.string() for index in range(len(names))}, strings_can_be_null=False
            ),
        )
    except (pa.ArrowException, ValueError) as error:
        if not wrong:
            raise
        row = wrong[0].number or 1
        cells = int(wrong[0].actual_columns)
        commas = separator == "," and row == 1 and cells > len(names) > 1 and "." not in rows[0]
        found = f"{cells} cells" + (", as if the numbers had decimal commas" if commas else "")
        hint = COMMAS if commas else UNQUOTED
        raise TableError(
            file, found, f"{len(names)}, as the header has", hint, row=row, line=body.line_of(row)
        ) from error
