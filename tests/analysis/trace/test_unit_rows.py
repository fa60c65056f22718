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
    "above a row of empty cells": ("{units}", ",,,", HEADER),
    "above a comment": ("{units}", "# by Meier", HEADER),
    "above a second row of names": ("{units}", "Zeit,Moment,Winkel,Text", HEADER),
    "below other comments": (HEADER, "# by Meier", "# {units}"),
}


def table(folder: Path, before: tuple[str, ...], units: str) -> Path:
    path = folder / "trace.csv"
    path.write_text("\n".join([*(line.format(units=units) for line in before), *ROWS, ""]), encoding="utf-8")
    return path


def line_of_units(before: tuple[str, ...]) -> int:
    return next(number for number, line in enumerate(before, 1) if "{units}" in line)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    "units",
    [UNITS, "[s],[N·m],['],[-]", "s,,,", "s,Nm,arcmin", "s,Nm,arcmin,,", "t/s,M/Nm,phi/arcmin", "units: s,Nm,arcmin"],
)
def test_units_of_the_names_are_read_and_told(tmp_path: Path, place: str, units: str) -> None:
    trace = read_trace(table(tmp_path, PLACES[place], units))
    assert trace.torque_out_nm == pytest.approx(np.array([1.0, 2.0]))
    assert f"line {line_of_units(PLACES[place])} has the units" in trace.reading
    left_out = sum(line not in ("", "{units}", HEADER) and not line.startswith("#") for line in PLACES[place])
    assert ("lines before" in trace.reading) == (left_out > 0)
    assert ("comments" in trace.reading) == (place == "below other comments")


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    ("units", "column", "wrong"),
    [
        *(("s,Nm,deg,", "windup_arcmin", "deg"), ("ms,,,", "t_s", "ms"), ("s,Nm,foo,", "windup_arcmin", "foo")),
        *(("[s],[kNm],[arcmin],", "torque_out_nm", "[kNm]"), ("[a],[Nm],[b],", "t_s", "[a]")),
        *(("s,Nm,deg,,", "windup_arcmin", "deg"), (",V,V,", "torque_out_nm", "V")),
        *(("s,Nm,10 deg,", "windup_arcmin", "10 deg"), (",,10 deg,", "windup_arcmin", "10 deg")),
    ],
)
def test_another_unit_is_refused_with_its_line(tmp_path: Path, place: str, units: str, column: str, wrong: str) -> None:
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, PLACES[place], units))
    (problem,) = refused.value.problems
    assert (problem.line, problem.column) == (line_of_units(PLACES[place]), column)
    assert f"'{wrong}'" in problem.found


OTHER_WORDS = (
    *("Company,Bench,Operator,Note", "one, two, three", "measured by s, Nm and deg", "1,2,3", "Date,2026-01-15,08:00"),
    *("Shift,A", "Shift,A,,", "Line,C", "Operator,h", "Version,V", "Rev,A,,", "Prüfer,s", "Unit,A", "Min,Max,Mean"),
    *("[Data]", "[Data],,,", "Torque,Nm", "Angle,,deg", "2,Angle,deg", "Rated torque,412 Nm,,", "Sampling,1 ms"),
    *("(left),(right),(top),(bottom)", "[Ch A],[Ch B],[Ch C],[Ch D]", "Channel,5 V,10 V,mV", "Load,%"),
    *("torque in Nm, angle in arcmin", "N/A,N/A,N/A", "A,B,C,D", "Motor,Nm/rad,", f"{'s ' * 60},A"),
)


@pytest.mark.parametrize("words", OTHER_WORDS)
@pytest.mark.parametrize("sign", ["", "# "])
def test_other_words_above_the_header_are_no_units(tmp_path: Path, words: str, sign: str) -> None:
    trace = read_trace(table(tmp_path, (sign + words, HEADER), ""))
    assert trace.samples == len(ROWS)
    assert "units" not in trace.reading


@pytest.mark.parametrize("words", ["Torque,Nm", "# recorded at 20 rpm,%", "Load,%"])
def test_beside_a_word_in_one_of_two_columns_a_unit_that_fits_shows_no_row_of_units(tmp_path: Path, words: str) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(f"{words}\nwindup_arcmin,torque_out_nm\n1,2\n2,3\n")
    assert "units" not in read_trace(path).reading


def test_a_line_that_is_taken_for_units_may_be_deleted(tmp_path: Path) -> None:
    """Half of the columns have a unit, and that is a wrong one: it is named, and not the word beside it."""
    path = tmp_path / "trace.csv"
    path.write_text("Angle,deg\ntorque_out_nm,windup_arcmin\n1,2\n")
    with pytest.raises(TableError) as refused:
        read_trace(path)
    (problem,) = refused.value.problems
    assert (problem.line, problem.column) == (1, "windup_arcmin")
    assert "delete this line" in problem.hint


@pytest.mark.parametrize("below", [UNITS, "[sec],N·m,',", "s,-,arcmin,", "# s,Nm,arcmin", "s,Nm,arcmin,other note"])
def test_rows_of_units_that_agree_are_read(tmp_path: Path, below: str) -> None:
    trace = read_trace(table(tmp_path, (UNITS, HEADER, below), ""))
    assert trace.samples == len(ROWS)
    assert "line 1 has the units, line 3 has the units" in trace.reading


@pytest.mark.parametrize(
    ("above", "below"), [(UNITS, "s,Nm,deg,"), ("s,Nm,deg,", UNITS), ("s,Nm,deg,", "s,Nm,rad,"), (UNITS, "s,Nm,word,")]
)
def test_rows_of_units_that_differ_are_refused(tmp_path: Path, above: str, below: str) -> None:
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, (above, HEADER, below), ""))
    (problem,) = refused.value.problems
    assert (problem.line, problem.column) == (3, "windup_arcmin")
    assert "line 1" in problem.found
    assert "lines 1 and 3" in problem.hint


def test_rows_of_units_that_agree_on_a_wrong_one_are_refused_for_it(tmp_path: Path) -> None:
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, ("s,Nm,deg,", HEADER, "[s],[Nm],[deg],"), ""))
    (problem,) = refused.value.problems
    assert (problem.line, problem.column, problem.allowed) == (1, "windup_arcmin", "arcmin")


def test_rows_in_which_each_number_has_its_unit_are_data(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(f"{HEADER}\n0 s,1 Nm,2 arcmin,a\n1 s,2 Nm,3 arcmin,b\n")
    with pytest.raises(TableError) as refused:
        read_trace(path)
    (problem,) = refused.value.problems
    assert (problem.row, problem.column) == (1, "t_s")
    assert "0 s" in problem.found
