"""Numbers as spreadsheets write them: with a decimal point or comma, and with signs between thousands.

One file has one decimal sign, and its own cells tell which: `0,5` and `1234,5` can only have a comma, `0.5` a point.
`1,234` alone may be both. A file in which nothing tells it is refused, and so is one whose cells contradict each other.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from analysis.trace.errors import TableError
from analysis.trace.units import BoolArray, FloatArray

Fail = Callable[[int, str, str, str, str], TableError]
"""Makes the error for a row (from 1), a column, what was found, what is expected, and a hint."""

NO_NUMBERS = r"^[+-]?(?:[nN][aA][nN]|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?)$"
"""What reads as a number and is none; it is named where values must be finite."""

BETWEEN_THOUSANDS = r"['’\x{00A0}\x{2009}\x{202F}]"
"""Signs that stand between thousands and nowhere else; a plain space may as well part two numbers."""

WITH_THOUSANDS = rf"^[+-]?[1-9][0-9]{{0,2}}(?:{BETWEEN_THOUSANDS}[0-9]{{3}})+(?:[.,][0-9]*)?$"

NAMES = {".": "point", ",": "comma"}
OTHER = {".": ",", ",": "."}


class Numbers(NamedTuple):
    """Columns as numbers (NaN and infinity included), and the decimal sign that was taken where it is no point."""

    columns: dict[str, FloatArray]
    reading: tuple[str, ...]


def read_numbers(columns: Mapping[str, Any], fail: Fail, *, by_comma: bool) -> Numbers:
    """Convert columns of text (pyarrow) to numbers, all with the same decimal sign.

    by_comma: commas separate the columns of the file, so that a point is the decimal sign unless quoted cells have
    commas. Raises what `fail` makes for the first cell that is no number or whose decimal sign cannot be told.
    """
    trimmed = {name: pc.utf8_trim_whitespace(column.cast(pa.string())) for name, column in columns.items()}
    plain = _all_plain(trimmed)
    if plain is not None and (by_comma or not _may_be_thousands(trimmed)):
        return Numbers(plain, ())
    texts = {name: _one_spelling(column) for name, column in trimmed.items()}
    fits = {sign: {name: _matches(one, _pattern(sign)) for name, one in texts.items()} for sign in OTHER}
    for name, one in texts.items():
        bad = ~(fits["."][name] | fits[","][name] | _matches(one, NO_NUMBERS))
        if bad.any():
            raise _no_number(columns[name], name, int(np.argmax(bad)) + 1, fail)
    sign = _decimal_sign(texts, fits, fail, by_comma=by_comma)
    grouped = _check_thousands(texts, OTHER[sign], sign, fail)
    found = {
        name: pc.cast(pc.replace_substring(pc.replace_substring(one, OTHER[sign], ""), sign, "."), pa.float64())
        for name, one in texts.items()
    }
    reading = [f"decimal {NAMES[sign]}s"] if sign == "," else []
    reading += [f"{NAMES[OTHER[sign]]}s between thousands"] if grouped else []
    return Numbers({name: values.to_numpy() for name, values in found.items()}, tuple(reading))


def looks_like_number(text: str) -> bool:
    """Say whether one text may be a number, whichever decimal sign the file has."""
    return any(re.match(_pattern(sign), text.strip()) for sign in OTHER)


def _all_plain(columns: Mapping[str, Any]) -> dict[str, FloatArray] | None:
    """Return numbers with points, as programs write them; None where a cell has another form."""
    try:
        return {name: pc.cast(column, pa.float64()).to_numpy() for name, column in columns.items()}
    except (pa.ArrowException, ValueError):
        return None


def _may_be_thousands(columns: Mapping[str, Any]) -> bool:
    """Whether every point in the cells may as well stand between thousands."""
    pointed = {name: _matches(column, r"\.") for name, column in columns.items()}
    if not any(one.any() for one in pointed.values()):
        return False
    by_comma = _pattern(",")
    return all(not (one & ~_matches(columns[name], by_comma)).any() for name, one in pointed.items())


def _pattern(sign: str) -> str:
    """Return what a number looks like with this decimal sign and perhaps the other one between thousands."""
    decimal, between = re.escape(sign), re.escape(OTHER[sign])
    whole = rf"(?:[0-9]+|[1-9][0-9]{{0,2}}(?:{between}[0-9]{{3}})+)"
    return rf"^[+-]?(?:{whole}(?:{decimal}[0-9]*)?|{decimal}[0-9]+)(?:[eE][+-]?[0-9]+)?$"


def _one_spelling(column: Any) -> Any:
    """Return cells with a hyphen as the minus sign, and without signs that can only stand between thousands."""
    column = pc.replace_substring(column, "−", "-")
    grouped = pc.match_substring_regex(column, WITH_THOUSANDS)
    return pc.if_else(grouped, pc.replace_substring_regex(column, BETWEEN_THOUSANDS, ""), column)


def _matches(column: Any, pattern: str) -> BoolArray:
    found: BoolArray = pc.fill_null(pc.match_substring_regex(column, pattern), fill_value=False).to_numpy()
    return found.astype(np.bool_)


def _decimal_sign(
    texts: Mapping[str, Any], fits: Mapping[str, Mapping[str, BoolArray]], fail: Fail, *, by_comma: bool
) -> str:
    """Return the decimal sign that the cells show."""
    shown = {
        sign: _first(texts, {name: fits[sign][name] & ~fits[OTHER[sign]][name] for name in texts}) for sign in OTHER
    }
    point, comma = shown["."], shown[","]
    if point and comma:
        row, name, text = max(point, comma)
        other = min(point, comma)
        raise fail(
            row, name, f"'{text}'",
            f"the same decimal sign in the whole file, but row {other[0]}, column {other[1]} has '{other[2]}'",
            "write all numbers with the same decimal sign",
        )  # fmt: skip
    if point or comma:
        return "." if point else ","
    unsure = _first(texts, {name: _matches(one, "[.,]") for name, one in texts.items()})
    if unsure is None or (by_comma and not any(_matches(one, ",").any() for one in texts.values())):
        return "."
    row, name, text = unsure
    raise fail(
        row, name, f"'{text}', where the point or comma may be a decimal sign or a thousands separator",
        "a number with a point",
        "write no thousands separators, or add a decimal place to one number",
    )  # fmt: skip


def _check_thousands(texts: Mapping[str, Any], between: str, sign: str, fail: Fail) -> bool:
    """Return whether signs stand between thousands; refuse those of which nothing else tells that they do."""
    mark, decimal = re.escape(between), re.escape(sign)
    some = _first(texts, {name: _matches(one, mark) for name, one in texts.items()})
    if some is None:
        return False
    # A number with both signs, or with two of one kind, can be read in one way only.
    sure = rf"{mark}.*(?:{mark}|{decimal})"
    if any(_matches(one, sure).any() for one in texts.values()):
        return True
    row, name, text = some
    raise fail(
        row, name, f"'{text}', where other numbers have a decimal {NAMES[sign]}", "one decimal sign in the whole file",
        "write no thousands separators",
    )  # fmt: skip


def _first(texts: Mapping[str, Any], where: Mapping[str, BoolArray]) -> tuple[int, str, str] | None:
    """Return row (from 1), column and text of the first cell that is marked."""
    found = [(int(np.argmax(marked)) + 1, name) for name, marked in where.items() if marked.any()]
    if not found:
        return None
    row, name = min(found)
    return row, name, _text_of(texts[name][row - 1])


def _no_number(column: Any, name: str, row: int, fail: Fail) -> TableError:
    return fail(row, name, f"'{_text_of(column[row - 1])}'", "a number", "repair or remove the row")


def _text_of(cell: Any) -> str:
    """Return a cell of text for a person; Parquet may hold bytes there that are none."""
    try:
        return str(cell.as_py())
    except UnicodeDecodeError as error:
        return bytes(error.object).decode("utf-8", "replace")
