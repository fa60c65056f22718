"""What each row of a file is: the names of segments, written to files and read from them.

The column `segment` (or `branch`) holds "forward" or "return" (the cycle counts up whenever forward or return comes
again), or "role direction cycle" as `segment_name` writes it, for example "measure -1 2", or "unused": a row that is no
sample of the loop, and is left out. Whole numbers say only that the load profile is not known, and turning points are
then found on the curve.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.errors import AnalysisError
from analysis.trace import ROLES, SegmentInfo, first_bad_row
from analysis.units import BoolArray, IntArray

SEGMENT_COLUMNS = ("segment", "branch")
"""Columns that name the segment of a row; the first one found is read."""

BRANCH_NAMES = {"forward": 1, "return": -1}
"""Branch names of published loops, and the direction of torque."""

UNUSED = "unused"
"""Name of a segment whose rows are left out: the bench did something else then, or had no new sample."""


def segment_name(info: SegmentInfo) -> str:
    """Write a segment as text for a file: "role direction cycle"."""
    return f"{info.role} {info.direction:+d} {info.cycle}"


def read_segments(column: Any, file: Path, name: str) -> tuple[BoolArray, IntArray | None, dict[int, SegmentInfo]]:
    """Return which rows are used, the segment id of each of these, and the table of ids.

    Neither ids nor table where the column holds whole numbers. `file` and `name` say in messages which column it is.

    Raises:
        AnalysisError: an empty cell or a name that is not known, with its row; no row that is used.

    """
    try:
        if pa.types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if not pa.types.is_string(column.type) and not pa.types.is_large_string(column.type):
            column = column.cast(pa.string())
        codes = column.combine_chunks().dictionary_encode()
        if isinstance(codes, pa.ChunkedArray):
            codes = codes.combine_chunks()
        texts = [str(text).strip() for text in codes.dictionary.to_pylist()]
        indices = codes.indices.to_numpy(zero_copy_only=False)
    except (pa.ArrowException, ValueError, UnicodeError) as error:
        raise AnalysisError(f"{file}: column {name}: {error}; needed are segment names or whole numbers") from error
    if np.isnan(indices.astype(np.float64)).any():
        row = first_bad_row(np.isnan(indices.astype(np.float64)))
        raise AnalysisError(f"{file}: row {row}, column {name}: found nothing; needed is a segment name or a number")
    left_out = [code for code, text in enumerate(texts) if text == UNUSED]
    used = ~np.isin(indices, left_out)
    if not used.any():
        raise AnalysisError(f"{file}: column {name}: every row is {UNUSED}; needed are rows of a loop: measure one")
    if all(_is_whole(text) for text in texts if text != UNUSED):
        return used, None, {}
    rows = np.flatnonzero(used)
    indices = indices[rows]
    starts = np.concatenate(([0], np.flatnonzero(np.diff(indices)) + 1))
    table: dict[int, SegmentInfo] = {}
    counts = dict.fromkeys(BRANCH_NAMES, 0)
    for number, start in enumerate(starts.tolist()):
        text = texts[int(indices[start])]
        if text in BRANCH_NAMES:
            counts[text] += 1
            table[number] = SegmentInfo("measure", BRANCH_NAMES[text], counts[text])
        else:
            table[number] = _parse(text, f"{file}: row {rows[start] + 1}, column {name}")
    lengths = np.diff(np.append(starts, indices.size))
    return used, np.repeat(np.arange(starts.size, dtype=np.int64), lengths), table


def _parse(text: str, where: str) -> SegmentInfo:
    role, *numbers = text.split() or [""]
    if role in ROLES and len(numbers) <= 2 and all(_is_whole(number) for number in numbers):
        direction, cycle = (*(int(number) for number in numbers), 0, 0)[:2]
        if direction in (-1, 0, 1):
            return SegmentInfo(role, direction, cycle)
    raise AnalysisError(
        f"{where}: found '{text}'; allowed are {', '.join(BRANCH_NAMES)}, {UNUSED}, whole numbers, or a role "
        f"({', '.join(ROLES)}) with direction (-1, 0, 1) and cycle, as in 'measure -1 2'"
    )


def _is_whole(text: str) -> bool:
    digits = text[1:] if text[:1] in ("+", "-") else text
    return digits.isascii() and digits.isdigit() and len(digits) < 10
