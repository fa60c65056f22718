"""What each row of a file is: the names of segments, written to files and read from them.

The column `segment` (or `branch`) holds "forward" or "return" (the cycle counts up whenever forward or return comes
again), or "role direction cycle" as `segment_name` writes it, for example "measure -1 2", or "unused": a row that is no
sample of the loop, and is left out. A branch in steps has a fourth number, which counts its ramps and holds:
"measure -1 2 3"; without it they would be one unsteady ramp. Whole numbers say only that the load profile is not
known, and turning points are then found on the curve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import ROLES, SegmentInfo, first_bad_row
from analysis.trace.units import BoolArray, IntArray

SEGMENT_COLUMNS = ("segment", "branch")
"""Columns that name the segment of a row; the first one found is read."""

BRANCH_NAMES = {"forward": 1, "return": -1}
"""Branch names of published loops, and the direction of torque."""

UNUSED = "unused"
"""Name of a segment whose rows are left out: the bench did something else then, or had no new sample."""


def segment_name(info: SegmentInfo) -> str:
    """Write a segment as text for a file: "role direction cycle"."""
    return f"{info.role} {info.direction:+d} {info.cycle}"


def segment_names(order: Sequence[int], table: Mapping[int, SegmentInfo]) -> dict[int, str]:
    """Return the name of each segment id, by which a reader finds every change of segment again.

    Neighbours of one role, direction and cycle are numbered from 1: ramps and holds of a branch in steps.

    order: the ids as they follow each other in the rows.
    """
    names: dict[int, str] = {}
    for name, group in groupby(order, key=lambda key: segment_name(table[key])):
        alike = list(group)
        steps = [f" {number}" for number in range(1, len(alike) + 1)] if len(alike) > 1 else [""]
        names |= {key: name + step for key, step in zip(alike, steps, strict=True)}
    return names


def read_segments(column: Any, file: Path, name: str) -> tuple[BoolArray, IntArray | None, dict[int, SegmentInfo]]:
    """Return which rows are used, the segment id of each of these, and the table of ids.

    Neither ids nor table where the column holds whole numbers. `file` and `name` say in messages which column it is.

    Raises:
        AnalysisError: an empty cell or a name that is not known, with its row; no row that is used.

    """
    import pyarrow as pa  # noqa: PLC0415 - who writes names, or shows them, does without

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
        raise AnalysisError(f"{file}: column {name}: {error}; expected segment names or whole numbers") from error
    if np.isnan(indices.astype(np.float64)).any():
        row = first_bad_row(np.isnan(indices.astype(np.float64)))
        raise AnalysisError(f"{file}: row {row}, column {name}: found nothing; expected a segment name or a number")
    left_out = [code for code, text in enumerate(texts) if text == UNUSED]
    used = ~np.isin(indices, left_out)
    if not used.any():
        raise AnalysisError(f"{file}: column {name}: every row is {UNUSED}; expected rows of a loop: measure one")
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
    if role in ROLES and len(numbers) <= 3 and all(_is_whole(number) for number in numbers):
        direction, cycle = (*(int(number) for number in numbers), 0, 0)[:2]
        if direction in (-1, 0, 1):
            return SegmentInfo(role, direction, cycle)
    raise AnalysisError(
        f"{where}: found '{text}'; allowed are {', '.join(BRANCH_NAMES)}, {UNUSED}, whole numbers, or a role "
        f"({', '.join(ROLES)}) with direction (-1, 0, 1) and cycle, as in 'measure -1 2', "
        "and a number that counts the ramps and holds of a branch in steps"
    )


def _is_whole(text: str) -> bool:
    digits = text[1:] if text[:1] in ("+", "-") else text
    return digits.isascii() and digits.isdigit() and len(digits) < 10
