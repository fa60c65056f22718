"""`torque-ratio`: the line of published points as printed, of a loop by quadrant, and what is no such table."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import pytest
from printed_numbers import alike, reads

from analysis.torque_ratio.quadrants import QUADRANTS
from analysis.trace.errors import AnalysisError
from station.cli import command_line
from station.cli.errors import errors_of
from station.errors import StationError

PUBLISHED = Path(__file__).parents[2] / "data" / "torque_ratio_rv40e.csv"
HEAD = "torque_in_nm,torque_out_nm\n"


def command(*args: object) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert command_line("torque-ratio")(["torque-ratio", *map(str, args)], standalone_mode=False) in (0, None)
    return printed.getvalue()


def found(*args: object) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(command(*args, "--json"))
    return document


def table(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_published_points_give_the_published_line() -> None:
    """Check value 1."""
    document = found(PUBLISHED, "--target", "412 N·m", "--target", "0.5 kN·m")
    (line,) = document["lines"]
    assert (line["points"], line["quadrant"], document["run"]) == (22, None, None)
    for key, value, digits in (
        ("offset_nm", -13.889650, 5e-7),
        ("slope", 94.698870, 5e-7),
        ("residual_sd_nm", 8.878, 5e-4),
        ("u_offset_nm", 3.845, 5e-4),
        ("u_slope", 1.4158, 5e-5),
        ("correlation", -0.870, 5e-4),
        ("r_squared", 0.99555, 5e-6),
    ):
        assert line[key] == pytest.approx(value, abs=digits), key
    assert line["theil_sen"] == pytest.approx({"offset_nm": -13.471, "slope": 94.531}, abs=5e-4)
    assert line["without_flagged"] == pytest.approx({"offset_nm": -9.732, "slope": 93.603}, abs=5e-4)
    (flagged,) = line["flagged"]
    assert (flagged["row"], flagged["torque_out_nm"], flagged["torque_in_nm"]) == (4, 60.0, 1.113)
    assert flagged["studentised"] == pytest.approx(-6.48, abs=5e-3)
    rated, beyond = line["targets"]
    assert rated["torque_in_nm"] == pytest.approx(4.4973, abs=5e-5)
    covariance = line["correlation"] * line["u_offset_nm"] * line["u_slope"]
    variance = line["u_offset_nm"] ** 2 + (4.4973 * line["u_slope"]) ** 2 + 2 * 4.4973 * covariance
    assert rated["u_torque_out_nm"] == pytest.approx(variance**0.5, rel=1e-4)
    assert rated["u_torque_in_nm"] == pytest.approx(variance**0.5 / line["slope"], rel=1e-4)
    assert (rated["beyond_points"], beyond["beyond_points"], beyond["torque_out_nm"]) == (False, True, 500.0)


@pytest.mark.parametrize(
    "told",
    [
        "22 points",
        "−13.889650 94.698870",
        "standard uncertainty 3.845 1.4158",
        "s = 8.878 N·m, correlation of C and m −0.870, R² = 0.99555",
        "Theil–Sen −13.471 94.531",
        "row 4 1.113 60 −6.48",
        "412 4.4973 0.0376",
    ],
)
def test_a_person_reads_the_same_figures(told: str) -> None:
    assert reads(" ".join(command(PUBLISHED, "--target", "412 N·m").split()), told)


def test_parquet_is_read_as_the_table_it_came_from(tmp_path: Path) -> None:
    parquet = tmp_path / "points.parquet"
    pa_parquet.write_table(pa_csv.read_csv(PUBLISHED), parquet)
    assert alike(found(parquet)["lines"], found(PUBLISHED)["lines"])


def test_without_outliers_nothing_is_flagged_and_no_second_line_is_given(tmp_path: Path) -> None:
    path = table(tmp_path, HEAD + "1,80\n2,175.5\n3,270\n4,365.5\n")
    (line,) = found(path)["lines"]
    assert (line["flagged"], line["without_flagged"], line["targets"]) == ([], None, [])
    assert "no point flagged" in command(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("torque_in_nm,points\n1,2\n", "column torque_out_nm (torque at the output shaft) is missing"),
        ("torque_in,torque_out_nm\n1,2\n", "column 'torque_in' is named nearly as a column"),
        (HEAD + "1,100\nnan,200\n3,300\n", "row 2, column torque_in_nm: found 'nan'; expected a finite number"),
        (HEAD + "1,100\n2,much\n3,300\n", "row 2, column torque_out_nm: found 'much'; expected a number"),
        (HEAD + "1,100\n2,200\n", "points.csv: torque ratio: found 2 input and 2 output torques; expected 3"),
        (HEAD + "1,100\n1,200\n1,300\n", "points.csv: torque ratio: every input torque is 1 N·m"),
        (HEAD + "1,80\n2,175\n-1,-80\n-2,-175\n", "row 4, column torque_out_nm: found -175 N·m after 175 N·m in row 2"),
        (HEAD, "no rows below the header"),
        (
            "torque_in_nm,torque_out_nm,segment\n1,80,dwell +1 1\n2,175,dwell +1 1\n",
            "found dwell; expected calibrate or measure",
        ),
        ("torque_in_nm,torque_out_nm,segment\n1,80,measure +1 1\n2,175,measure +1 1\n", "fewer than 3 points in every"),
    ],
)
def test_what_is_no_table_of_one_line_is_told_with_its_place(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(AnalysisError) as refused:
        command(table(tmp_path, text))
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("target", "told"),
    [
        ("412", "412 without a unit"),
        ("412 arcmin", "which is an angle"),
        ("0 N·m", "other than zero"),
        ("-412 N·m", "same sign as the measured points"),
    ],
)
def test_a_target_that_no_line_reaches_is_refused(target: str, told: str) -> None:
    with pytest.raises(StationError, match=r"--target: found .*; allowed is") as refused:
        command(PUBLISHED, "--target", target)
    assert told in str(refused.value)
    assert errors_of(refused.value)[0].option == "--target"


def test_points_of_loading_and_unloading_in_one_table_are_told(tmp_path: Path) -> None:
    """Unloading, the same torque needs far less input: one line through both fits neither."""
    up, down = np.linspace(0.5, 4.5, 9), np.linspace(2.2, 0.2, 9)
    rows = [*zip(up, 94.7 * up - 13.9, strict=True), *zip(down, 168 * down + 24.8, strict=True)]
    document = found(table(tmp_path, HEAD + "".join(f"{x:.4f},{y:.4f}\n" for x, y in rows)))
    (note,) = document["notes"]
    assert "row 11: the output torque comes down to 352.4 N·m" in note
    assert found(PUBLISHED)["notes"] == []


@pytest.mark.parametrize("rows", ["80,1\n175,2\n270,3\n", "1,33\n2,33\n3,33\n", "1,-80\n2,-175\n3,-270\n"])
def test_torques_that_are_no_reducers_are_told(tmp_path: Path, rows: str) -> None:
    """Exchanged columns, a sensor that stands still, one that counts the other way."""
    (note,) = found(table(tmp_path, HEAD + rows))["notes"]
    assert "a reducer gives more torque than it takes" in note


def test_a_recording_is_no_table_of_points(tmp_path: Path) -> None:
    rows = "".join(f"{x:.5f},{94.7 * x - 13.9:.5f}\n" for x in np.linspace(0.2, 4.5, 1200))
    (note,) = found(table(tmp_path, HEAD + rows))["notes"]
    assert "1200 points: neighbours in a recording" in note


def test_the_row_of_a_flagged_point_is_that_of_the_file(tmp_path: Path) -> None:
    """Rows that are not used are left out of the fit, and counted all the same."""
    lines = PUBLISHED.read_text(encoding="utf-8").splitlines()
    text = "\n".join([f"{lines[0]},segment", "0,0,unused", *(f"{line},1" for line in lines[1:])])
    (line,) = found(table(tmp_path, text + "\n"))["lines"]
    assert (line["points"], line["flagged"][0]["row"], line["flagged"][0]["point"]) == (22, 5, 4)


def test_named_segments_have_a_line_per_quadrant(tmp_path: Path) -> None:
    up, down = np.linspace(0.3, 4.5, 40), np.linspace(2.3, 0.1, 40)
    rows = [f"{x:.5f},{94.7 * x - 13.9:.5f},calibrate +1 1" for x in up]
    rows += [f"{x:.5f},{168 * x + 24.8:.5f},calibrate -1 1" for x in down]
    path = table(tmp_path, "torque_in_nm,torque_out_nm,segment\n" + "\n".join(rows) + "\n")
    document = found(path, "--target", "100 N·m")
    assert [line["quadrant"] for line in document["lines"]] == ["load_positive", "unload_positive"]
    assert [line["slope"] for line in document["lines"]] == pytest.approx([94.7, 168.0], rel=1e-5)
    assert [line["targets"][0]["torque_in_nm"] for line in document["lines"]] == pytest.approx(
        [113.9 / 94.7, 75.2 / 168.0], rel=1e-4
    )
    assert "no line for load_negative, unload_negative" in document["notes"][0]


@pytest.mark.parametrize(
    ("sign", "begins"), [(1, "load_positive: fitted from 80"), (-1, "load_negative: fitted from −80")]
)
def test_a_line_of_a_file_begins_where_the_bounce_out_of_the_play_is_over(
    tmp_path: Path, sign: int, begins: str
) -> None:
    """As in the result of a run: of one run the file's offset read −0.3 where the result had −1.7 N·m."""
    torque_in = np.linspace(0.0, 4.4, 2000)
    torque_out = np.maximum(94.7 * torque_in - 13.9, 0.0)
    bounces = np.flatnonzero((torque_out > 16.0) & (torque_out < 56.0))
    torque_out[bounces] = np.maximum(torque_out[bounces], 32.0)
    torque_out[bounces[0]] = 56.0
    rows = (
        f"{sign * x:.5f},{sign * y:.5f},calibrate {sign:+d} 1\n" for x, y in zip(torque_in, torque_out, strict=True)
    )
    document = found(table(tmp_path, "torque_in_nm,torque_out_nm,segment\n" + "".join(rows)))
    (line,) = document["lines"]
    assert line["offset_nm"] == pytest.approx(-13.9 * sign, abs=1e-3)
    assert f"line {begins} N·m" in document["notes"][-1]


def test_a_run_has_its_own_lines(quick_run: Any, tmp_path: Path) -> None:
    data = quick_run.copy(tmp_path / "data").parent
    document = found("last", "--data", data, "--target", "412 N·m")
    (stored,) = (json.loads(path.read_text(encoding="utf-8")) for path in data.rglob("calibration.json"))
    assert [line["quadrant"] for line in document["lines"]] == list(QUADRANTS)
    for line in document["lines"]:
        kept = stored["quadrants"][line["quadrant"]]
        assert {key: line[key] for key in ("slope", "offset_nm", "u_slope", "points")} == {
            key: kept[key] for key in ("slope", "offset_nm", "u_slope", "points")
        }
        assert len(line["flagged"]) == kept["flagged"]
        assert line["theil_sen"] == {"offset_nm": kept["theil_sen_offset_nm"], "slope": kept["theil_sen_slope"]}
        assert len(line["targets"]) == (1 if line["quadrant"].endswith("positive") else 0)


def test_a_run_that_measured_none_is_refused(shipped_run: Any, tmp_path: Path) -> None:
    data = shipped_run("rv-40e-121-output").copy(tmp_path / "data").parent
    with pytest.raises(StationError, match="the run measured no torque ratio; expected"):
        command("last", "--data", data)
