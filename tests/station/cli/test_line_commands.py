"""Capability, units, gage and master part: from stored runs and from CSV files, and what they refuse."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stored_runs import metric, store_lot, store_run

from analysis.trace.errors import AnalysisError
from station.cli.csv_columns import read_csv_columns
from station.cli.errors import errors_of
from station.cli.line import gage as command_gage
from station.cli.line import line_statistics as line
from station.cli.line.line_statistics import Asked
from station.cli.line.stored_metric import Ask
from station.errors import StationError

DATA = Path(__file__).parents[2] / "data"
ASK = Ask("lost_motion")


def csv(folder: Path, text: str) -> Path:
    path = folder / "values.csv"
    path.write_text(text, encoding="utf-8")
    return path


def of_file(path: Path, column: str = "value") -> Asked:
    return Asked(path, column, path.parent, None)


def printed(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return store_lot(tmp_path)


def test_runs_of_several_recipes_are_pooled_only_when_one_is_named(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in (
        lambda asked: line.capability_of(asked, (None, None), 1, 0.95, as_json=False),
        lambda asked: line.units_of(asked, 0.95, as_json=False),
    ):
        with pytest.raises(StationError, match=r"6 runs of recipe inverse, 1 run of recipe other; .* --recipe NAME"):
            command(Asked(None, "value", runs, ASK))
        assert command(Asked(None, "value", runs, Ask("lost_motion", recipe="inverse"))) == 0
        assert "MIXED" not in capsys.readouterr().out


def test_a_list_of_runs_may_stand_beside_runs_of_other_recipes(tmp_path: Path) -> None:
    data, rows = tmp_path / "runs", []
    for part in range(3):
        for who, trial in (("A", 0), ("A", 1), ("B", 2), ("B", 3)):
            run = store_run(data, f"P{part}", [metric(0.4 + 0.1 * part + 0.001 * trial)], day=part + 0.1 * trial)
            rows.append(f"{who},P{part},{run.id}")
    store_run(data, "P0", [metric(9.0)], recipe="other")
    listed = csv(tmp_path, "\n".join(["operator,part,run", *rows]))
    assert command_gage.gage(listed, ASK, data, "day", (None, 0.95), as_json=True) == 0
    with pytest.raises(StationError, match="1 run of recipe other"):
        command_gage.gage(None, ASK, data, "day", (None, 0.95), as_json=True)


def test_capability_against_the_limit_of_the_recipe(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = Asked(None, "value", runs, Ask("lost_motion", recipe="inverse", attempts="first"))
    assert line.capability_of(asked, (None, None), 1, 0.95, as_json=True) == 0
    found = printed(capsys)
    assert (found["upper"], found["lower"], found["values"]) == (1.0, None, 5)
    assert found["mean"] == pytest.approx(0.40)
    assert found["within"]["both"] is None
    # one limit: (1 - 0.40) / (3 · mean moving range / 1.128)
    assert found["within"]["nearest"] == pytest.approx(0.6 / (3 * 0.0275 / 1.1284), rel=1e-3)
    line.capability_of(asked, (None, None), 1, 0.95, as_json=False)
    text = capsys.readouterr().out
    assert "≤ 1 arcmin" in text
    assert re.search(r"^Cpk [\d.]+ … [\d.]+, Ppk [\d.]+ … [\d.]+ with 95% confidence$", text, re.MULTILINE)
    assert "left out: 1 that are not the first of their unit" in text


def test_capability_of_a_file_needs_a_limit(tmp_path: Path) -> None:
    path = csv(tmp_path, "value\n9.9\n10.1\n10\n")
    with pytest.raises(StationError, match=r"a file has no limits. Give --min X, --max X or both"):
        line.capability_of(of_file(path), (None, None), 1, 0.95, as_json=False)
    assert line.capability_of(of_file(path), (9.0, 11.0), 1, 0.95, as_json=False) == 0


def test_capability_says_how_to_give_a_limit_that_the_recipe_lacks(tmp_path: Path) -> None:
    for number in range(3):
        store_run(tmp_path, f"U{number}", [metric(0.4 + 0.01 * number, limits={"min": None, "max": None})])
    asked = Asked(None, "value", tmp_path, Ask("lost_motion"))
    with pytest.raises(
        StationError, match=r"newest run, .* has no limit for this metric.*--min X, .* or .*--recipe NAME"
    ):
        line.capability_of(asked, (None, None), 1, 0.95, as_json=False)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ("12", "less than 0.0001 %"),
        ("10.2", "2.3 %"),
        ("9.76", "99 %"),
        ("9.73", "99.7 %"),
        ("9", "100 %"),
    ],
)
def test_a_share_beyond_the_limits_that_nobody_can_know_is_not_told_as_a_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], limit: str, said: str
) -> None:
    path = csv(tmp_path, "value\n9.9\n10\n10.1\n")  # mean 10, standard deviation 0.1
    line.capability_of(of_file(path), (None, float(limit)), 1, 0.95, as_json=False)
    assert f"expected beyond limits: {said} of the units" in capsys.readouterr().out


def test_of_two_sides_the_worse_one_judges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The side that stands first may be the better one; the other is named beside the result."""
    for day in range(12):
        plus, minus = 0.5 + 0.01 * (day % 3), 0.8 + 0.03 * (day % 3) + 0.04 * (day // 4) + 0.02 * (day % 4)
        sides = {side: {"value": value, "uncertainty": None} for side, value in (("+", plus), ("-", minus))}
        store_run(tmp_path, f"S{day % 4}", [metric(plus, sides=sides)], day=day)

    def asked(side: str | None = None) -> Asked:
        return Asked(None, "value", tmp_path, Ask("lost_motion", side=side))

    def judged(side: str | None, command: Callable[[Asked], int]) -> str:
        assert command(asked(side)) == 0
        return str(printed(capsys)["side"])

    commands: tuple[Callable[[Asked], int], ...] = (
        lambda one: line.capability_of(one, (None, None), 1, 0.95, as_json=True),
        lambda one: line.units_of(one, 0.95, as_json=True),
    )
    for command in commands:
        assert judged(None, command) == "-"
        assert judged("+", command) == "+"
    assert line.master_part_of(asked(), 8, None, 0.99, as_json=True) == line.OUT_OF_CONTROL
    assert printed(capsys)["side"] == "-"
    line.capability_of(asked(), (None, None), 1, 0.95, as_json=False)
    said = capsys.readouterr().out
    assert "lost_motion side −: 12 values" in said
    assert "lost_motion side +: Ppk" in said


def test_units_are_compared_apart_from_their_repeatability(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line.units_of(Asked(None, "value", runs, Ask("lost_motion", recipe="inverse")), 0.95, as_json=True)
    found = printed(capsys)
    assert (found["units"], found["measurements"]) == (5, 6)
    assert found["most"] == ["U0", pytest.approx(0.45)]
    assert found["sd_within"] == pytest.approx(0.1 / 2**0.5)


def test_the_published_gage_study(capsys: pytest.CaptureFixture[str]) -> None:
    command_gage.gage(DATA / "gage_study.csv", None, DATA, "day", (None, 0.95), as_json=True)
    found = printed(capsys)
    assert found["anova"]["part"]["sum_of_squares"] == pytest.approx(88.36193, abs=1e-5)
    assert found["anova"]["grr_pct"]["value"] == pytest.approx(27.86, abs=0.005)
    assert (found["anova"]["ndc"], found["average_range"]["ndc"]) == (4, 5)


@pytest.mark.parametrize(("tolerance", "words"), [(None, "good"), (0.2, "fit for some uses"), (0.05, "not fit")])
def test_a_gage_is_no_better_than_its_share_of_the_tolerance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tolerance: float | None, words: str
) -> None:
    values = [
        (part, who, part + 0.005 * (trial + (who == "B"))) for part in range(4) for who in "AB" for trial in (0, 1)
    ]
    rows = [f"{who},{part},{value}" for part, who, value in values]
    study = csv(tmp_path, "\n".join(["operator,part,value", *rows]))
    command_gage.gage(study, None, DATA, "day", (tolerance, 0.95), as_json=False)
    assert f"The gage is {words} by AIAG" in capsys.readouterr().out


def test_repeats_that_all_read_the_same_make_no_good_gage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{who},{part},{part}.5" for who in "AB" for part in (1, 2, 3) for _ in range(2)]
    command_gage.gage(
        csv(tmp_path, "\n".join(["operator,part,value", *rows])), None, DATA, "day", (None, 0.95), as_json=False
    )
    assert "The gage cannot be judged" in " ".join(capsys.readouterr().out.split())


def test_a_gage_study_of_stored_runs_by_day_and_by_a_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows, data = ["operator,part,run"], tmp_path / "data"
    for day in (0, 1):
        for part in range(3):
            for trial in (0, 1):
                value = 0.3 + 0.1 * part + 0.01 * day + 0.001 * trial
                run = store_run(data, f"P{part}", [metric(value)], day=day + 0.1 * trial)
                rows.append(f"{'AB'[day]},{part},{run.id}")
    command_gage.gage(None, ASK, data, "day", (2.0, 0.95), as_json=True)
    by_day = printed(capsys)
    assert (by_day["parts"], by_day["trials"]) == (["P0", "P1", "P2"], 2)
    command_gage.gage(csv(tmp_path, "\n".join(rows)), ASK, data, "day", (2.0, 0.95), as_json=True)
    assert printed(capsys)["anova"] == by_day["anova"]
    with pytest.raises(StationError, match="all runs have the same bench"):
        command_gage.gage(None, ASK, data, "bench", (None, 0.95), as_json=True)
    with pytest.raises(StationError, match="row 2, column run: found 'nothing'"):
        command_gage.gage(
            csv(tmp_path, f"{rows[0]}\n{rows[1]}\nA,1,nothing\n"), ASK, data, "day", (None, 0.95), as_json=True
        )
    with pytest.raises(StationError, match="more than once"):
        command_gage.gage(
            csv(tmp_path, f"{rows[0]}\n{rows[1]}\n{rows[1]}\n"), ASK, data, "day", (None, 0.95), as_json=True
        )


def test_a_gage_study_of_stored_runs_by_operator(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "data"
    for trial in (0, 1):
        for part in range(3):
            for number, who in enumerate(("Ada", "Bo")):
                value = 0.3 + 0.1 * part + 0.01 * number + 0.001 * trial
                store_run(data, f"P{part}", [metric(value)], day=0.01 * trial, operator=who)
    command_gage.gage(None, ASK, data, "operator", (2.0, 0.95), as_json=True)
    found = printed(capsys)
    assert (found["operators"], found["parts"], found["trials"]) == (["Ada", "Bo"], ["P0", "P1", "P2"], 2)
    store_run(data, "P0", [metric(0.3)])
    with pytest.raises(
        StationError, match=r"1 of 13 runs name no operator, for example run .*-P0. Measure with 'lostmotion run"
    ):
        command_gage.gage(None, ASK, data, "operator", (2.0, 0.95), as_json=True)


def test_a_bench_that_drifts_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steady = [5.0, 5.1, 4.9, 5.05, 4.95, 5.02, 4.97, 5.08, 4.93, 5.0]
    rows = [f"2026-01-{day:02d}T08:00:00,{value}" for day, value in enumerate(steady, start=1)]
    path = csv(tmp_path, "\n".join(["started,value", *rows]))
    assert line.master_part_of(of_file(path), 6, (5.0, 0.01), 0.99, as_json=False) == 0
    assert "in control" in capsys.readouterr().out
    path = csv(tmp_path, "\n".join(["started,value", *rows, "2026-02-01,9"]))
    assert line.master_part_of(of_file(path), 6, None, 0.99, as_json=True) == 1
    found = printed(capsys)
    assert not found["in_control"]
    assert found["signals"][0]["measurement"] == 11


def test_a_master_part_of_stored_runs(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line.master_part_of(Asked(None, "value", runs, Ask("lost_motion", recipe="inverse")), 5, None, 0.99, as_json=True)
    assert printed(capsys)["measurements"] == 6


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("value\n1\n2\nx\n", r"values.csv: row 3, column value: found 'x'; expected a number"),
        ("value\n1\nnan\n", "row 2, column value: found 'nan'"),
        ("value\n1\n1e999\n", "row 2, column value: found '1e999'"),
        ("value\n1\n1_0\n", "row 2, column value: found '1_0'"),
        ("value,b\n1,\n", None),
        ("value,b\n,1\n", "row 1, column value: found an empty cell"),
        ("other\n1\n", "column value: found columns other"),
        ("value\n1,2\n", "row 1: found 2 cells"),
        ("value,value\n1,2\n", "more than once"),
        ("value\n", "found 0 rows"),
        ("", "found 0 rows"),
        ('value\n"1\n', "row 1: found a quote that is not closed"),
        ("value\n\x00\n", "binary data"),
    ],
)
def test_a_bad_file_is_told_by_row_and_column(tmp_path: Path, text: str, said: str | None) -> None:
    path = csv(tmp_path, text)
    if said is None:
        assert read_csv_columns(path).numbers("value") == [1.0]
        return
    with pytest.raises(AnalysisError, match=said):
        read_csv_columns(path).numbers("value")


def test_files_that_are_no_text_are_told(tmp_path: Path) -> None:
    path = tmp_path / "values.csv"
    path.write_bytes(b"\xff\xfe\x00")
    for bad in (path, tmp_path, tmp_path / "none.csv"):
        with pytest.raises(AnalysisError, match=r"cannot be read|not UTF-16"):
            read_csv_columns(bad)


def test_a_german_spreadsheet_is_read_and_its_errors_are_fields_for_programs(tmp_path: Path) -> None:
    path = tmp_path / "values.csv"
    path.write_bytes("Größe;value\nA;0,125\nB;1,5\n".encode("cp1252"))
    table = read_csv_columns(path)
    assert (table.numbers("value"), table.texts("Größe")) == ([0.125, 1.5], ["A", "B"])
    assert table.numeric() == ["value"]
    path.write_text("part;value\nA;0,125\n\nB;soon\n", encoding="utf-8")
    with pytest.raises(AnalysisError) as refused:
        read_csv_columns(path).numbers("value")
    (problem,) = errors_of(refused.value)
    assert (problem.file, problem.row, problem.line, problem.column) == (str(path), 2, 4, "value")
    assert (problem.found, problem.allowed) == ("'soon'", "a number")
    assert problem.hint


def test_few_or_equal_values_are_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError, match="expected 3 or more"):
        line.capability_of(of_file(csv(tmp_path, "value\n1\n2\n")), (0.0, 1.0), 1, 0.95, as_json=False)
    with pytest.raises(AnalysisError, match="standard deviation"):
        line.capability_of(of_file(csv(tmp_path, "value\n1\n1\n1\n")), (0.0, 1.0), 1, 0.95, as_json=False)
    with pytest.raises(StationError, match="either a CSV FILE, or --metric"):
        line.units_of(Asked(None, "value", tmp_path, None), 0.95, as_json=False)
    with pytest.raises(StationError, match="row 2, column time: found 'soon'"):
        line.master_part_of(of_file(csv(tmp_path, "time,value\n2026-01-01,1\nsoon,2\n")), 5, None, 0.99, as_json=False)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found 0 rows below the header"),
        ("operator,part\nA,1\n", "expected operator, part and value"),
        ("operator,part,value\nA,1,0.1\nA,1,x\n", "row 2, column value: found 'x'"),
        ("operator,part,value\nA,1,0.1\nA,1,\n", "row 2, column value: found an empty cell"),
        ("operator,part,value\nA,1,0.1\nA,1\n", "row 2"),
        ("operator,part,value\nA,1,0.1\nA,2,0.1\nB,1,0.1\n", "part 2 was measured 0 times by operator B"),
        ("operator,part,value\nA,1,0.1\nA,2,0.1\n", "expected 2 or more of each"),
        ("operator,part,value\n" + "\n".join(f"{o},{p},nan" for o in "ABAB" for p in "12"), "found 'nan'"),
    ],
)
def test_faults_of_a_gage_study_are_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises((StationError, AnalysisError), match=said):
        command_gage.gage(csv(tmp_path, text), None, tmp_path, "day", (None, 0.95), as_json=False)


@settings(max_examples=60)
@given(st.binary(max_size=80) | st.binary(max_size=50).map(lambda tail: b"operator,part,value\n" + tail))
def test_no_gage_study_raises_anything_else(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "gage.csv"
    path.write_bytes(content)
    try:
        command_gage.gage(path, None, path.parent, "day", (None, 0.95), as_json=False)
    except (StationError, AnalysisError) as error:
        assert str(error)  # noqa: PT017 - anything else would get through
