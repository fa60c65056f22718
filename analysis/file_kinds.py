"""What a file is when it is no trace: told by its first bytes, so that the message is not a parser's complaint."""

from __future__ import annotations

from pathlib import Path

KINDS: tuple[tuple[bytes, str, str], ...] = (
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
    for magic, what, then in KINDS:
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
