"""Ordinary files of people are read right, or refused with the place; none is misread, none crashes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from spreadsheets import ANGLE, REFUSED, ROWS, TIME, TORQUE, Style, readable

from analysis.trace.errors import AnalysisError, TableError
from analysis.trace.trace_files import read_trace
from definitions.units import RAD_PER_ARCMIN

READABLE = dict(readable())


def test_there_are_as_many_as_people_have() -> None:
    assert len(READABLE) + len(REFUSED) >= 70


@pytest.mark.parametrize("name", list(READABLE))
def test_what_it_says_is_read(tmp_path: Path, name: str) -> None:
    style, path = READABLE[name], tmp_path / "trace.csv"
    path.write_bytes(style.content())
    trace = read_trace(path)
    assert trace.samples == ROWS
    for found, true in ((trace.t_s, TIME), (trace.torque_out_nm, TORQUE), (trace.angle_in_rad, ANGLE * RAD_PER_ARCMIN)):
        assert found == pytest.approx(true, abs=1e-9, rel=1e-6)
    plain = style.separator == "," and style.decimal == "." and not (style.before or style.comments or style.thousands)
    if plain and not style.encoding.startswith(("utf-16", "cp")):
        assert trace.reading == ""
    if style.separator == ";":
        assert "semicolons" in trace.reading
    if style.decimal == ",":
        assert "decimal commas" in trace.reading


@pytest.mark.parametrize("name", list(REFUSED))
def test_what_says_nothing_certain_is_refused_with_the_place(tmp_path: Path, name: str) -> None:
    content, place, found = REFUSED[name]
    path = tmp_path / "trace.csv"
    path.write_bytes(content)
    with pytest.raises(AnalysisError) as refused:
        read_trace(path)
    assert place in str(refused.value)
    assert found in str(refused.value)
    if isinstance(refused.value, TableError):
        (problem,) = refused.value.problems
        assert problem.path == str(path)
        assert problem.allowed
        assert problem.hint
        assert not place.startswith("row ") or problem.row == int(place.partition(" ")[2])


@pytest.mark.parametrize("style", [Style(";", ","), Style(";", ",", "."), Style(";"), Style("\t", ",")])
@pytest.mark.parametrize("value", [0.5, 1.234, 12.345, 123.456, 1234.5, 1234567.0, 1000.0, 0.001])
def test_no_value_is_ever_read_as_another(tmp_path: Path, style: Style, value: float) -> None:
    """Whatever single number stands in a file: its own value, or a refusal where it could be two."""
    path, alone = tmp_path / "one.csv", {"t_s": np.array([value]), "torque_out_nm": np.array([value])}
    path.write_bytes(replace(style, columns=alone).content())
    try:
        assert read_trace(path).torque_out_nm == pytest.approx(np.array([value]))
    except AnalysisError:
        assert value >= 1.0
