"""A row of units beside the header is held to the names of the columns, wherever it stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.trace.errors import TableError
from analysis.trace.trace_files import read_trace

HEADER = "t_s,torque_out_nm,windup_arcmin,note"
ROWS = ["0,1,2,a", "1,2,3,b"]
UNITS = "s,Nm,arcmin,"
PLACES = {
    "above": ("{units}", HEADER),
    "above, as a comment": ("# {units}", HEADER),
    "above, behind a recorder's words": ("Recorder X,Station 3,of,Monday", "", "{units}", "", HEADER),
    "below": (HEADER, "{units}"),
    "below, as a comment": (HEADER, "# {units}"),
    "below a header that is a comment": (f"# {HEADER}", "# {units}"),
}


def table(folder: Path, before: tuple[str, ...], units: str) -> Path:
    path = folder / "trace.csv"
    path.write_text("\n".join([*(line.format(units=units) for line in before), *ROWS, ""]), encoding="utf-8")
    return path


def line_of_units(before: tuple[str, ...]) -> int:
    return next(number for number, line in enumerate(before, 1) if "{units}" in line)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("units", [UNITS, "[s],[N·m],['],[-]", "s,,,", "s,Nm,arcmin"])
def test_units_of_the_names_are_read_and_told(tmp_path: Path, place: str, units: str) -> None:
    trace = read_trace(table(tmp_path, PLACES[place], units))
    assert trace.torque_out_nm == pytest.approx(np.array([1.0, 2.0]))
    assert f"line {line_of_units(PLACES[place])} has the units" in trace.reading
    assert "comments" not in trace.reading
    assert ("lines before" in trace.reading) == (PLACES[place][0].startswith("Recorder"))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("units", "column", "wrong"),
    [("s,Nm,deg,", "windup_arcmin", "deg"), ("ms,,,", "t_s", "ms"), ("[s],[kNm],[arcmin],", "torque_out_nm", "[kNm]")],
)
def test_another_unit_is_refused_with_its_line(tmp_path: Path, place: str, units: str, column: str, wrong: str) -> None:
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, PLACES[place], units))
    (problem,) = refused.value.problems
    assert (problem.line, problem.column) == (line_of_units(PLACES[place]), column)
    assert f"'{wrong}'" in problem.found


@pytest.mark.parametrize("words", ["Company,Bench,Operator,Note", "one, two, three", "measured by s, Nm and deg"])
def test_other_words_above_the_header_are_no_units(tmp_path: Path, words: str) -> None:
    trace = read_trace(table(tmp_path, (words, HEADER), ""))
    assert trace.samples == len(ROWS)
    assert "units" not in trace.reading


def test_two_rows_of_units_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, (UNITS, HEADER, UNITS), ""))
    (problem,) = refused.value.problems
    assert problem.line == 1
    assert "line 3" in problem.found
