"""Time by the clock of a computer: read from its first row where nothing is lost, refused where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from analysis.trace.errors import AnalysisError, TableError
from analysis.trace.trace_files import read_trace

STEPS = np.arange(20) * 0.001
BEGIN = 1_764_308_400.25
LAST_RECORDED = 4_294_967_200.0


def table(folder: Path, time: list[str]) -> Path:
    path = folder / "trace.csv"
    path.write_text("\n".join(["t_s,torque_out_nm", *(f"{one},{row}" for row, one in enumerate(time)), ""]))
    return path


@pytest.mark.parametrize("begin", [1.0e9, BEGIN, LAST_RECORDED])
def test_unix_time_in_seconds_counts_from_the_first_row(tmp_path: Path, begin: float) -> None:
    trace = read_trace(table(tmp_path, [f"{begin + step:.6f}" for step in STEPS]))
    assert trace.t_s == pytest.approx(STEPS, abs=1e-6)
    assert "UNIX time" in trace.reading
    assert f"{begin:.6f}" in trace.reading


def test_unix_time_in_parquet_says_how_it_was_read(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    pq.write_table(pa.table({"t_s": BEGIN + STEPS, "torque_out_nm": STEPS}), path)
    trace = read_trace(path)
    assert trace.t_s == pytest.approx(STEPS, abs=1e-6)
    assert "UNIX time" in trace.reading
    assert "CSV" not in trace.reading


@pytest.mark.parametrize("begin", [0.0, -5.0, 86_400.0 * 365, 9.9e8])
def test_any_other_time_stays_as_it_is(tmp_path: Path, begin: float) -> None:
    trace = read_trace(table(tmp_path, [f"{begin + step:.6f}" for step in STEPS]))
    assert trace.t_s == pytest.approx(begin + STEPS, abs=1e-6)
    assert trace.reading == ""


@pytest.mark.parametrize(("counts", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_unix_time_in_other_counts_is_refused_by_its_name(tmp_path: Path, counts: float, name: str) -> None:
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, [f"{(BEGIN + step) * counts:.0f}" for step in STEPS]))
    (problem,) = refused.value.problems
    assert (problem.row, problem.column) == (1, "t_s")
    assert f"UNIX time in {name}" in problem.found
    assert "first row" in problem.hint


def test_unix_time_in_single_precision_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    pq.write_table(pa.table({"t_s": (BEGIN + STEPS).astype(np.float32), "torque_out_nm": STEPS}), path)
    for file in (path, table(tmp_path, ["1.76E+09"] * STEPS.size)):
        with pytest.raises(TableError) as refused:
            read_trace(file)
        (problem,) = refused.value.problems
        assert (problem.row, problem.column) == (1, "t_s")
        assert "too few digits" in problem.found


def test_a_clock_that_is_set_within_the_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError, match="row 2, column t_s"):
        read_trace(table(tmp_path, ["0.5", f"{BEGIN}", f"{BEGIN + 1}"]))


@pytest.mark.parametrize("begin", [0.0, BEGIN])
@pytest.mark.parametrize("every_s", [1.0, 0.02, 1e4])
def test_time_that_most_rows_share_is_refused(tmp_path: Path, begin: float, every_s: float) -> None:
    step_s = min(every_s, 1.0) / 8.0
    time = [begin + every_s * (row * step_s // every_s) for row in range(40)]
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, [f"{one:.6f}" for one in time]))
    (problem,) = refused.value.problems
    assert (problem.row, problem.column) == (2, "t_s")
    assert "of 40 rows" in problem.found
    assert "decimal places" in problem.hint


def test_time_that_is_rounded_finely_or_seldom_the_same_is_read(tmp_path: Path) -> None:
    for time in ([0.001 * (row // 5) for row in range(40)], [float(row // 2) for row in range(40)], [3.0]):
        assert read_trace(table(tmp_path, [f"{one:.6f}" for one in time])).samples == len(time)


@pytest.mark.parametrize("begin", [0.0, 3.0, 0.01, 999.37, BEGIN])
@pytest.mark.parametrize("shared", [3, 4, 8, 10])
@pytest.mark.parametrize("ticks", [5, 40, 301, 2000])
def test_time_that_is_rounded_to_a_hundredth_is_refused(tmp_path: Path, begin: float, shared: int, ticks: int) -> None:
    """Ten milliseconds have no exact number: the difference of two times may be a little less."""
    time = [f"{begin + 0.01 * tick:.2f}" for tick in range(ticks) for _ in range(shared)]
    with pytest.raises(TableError) as refused:
        read_trace(table(tmp_path, time))
    (problem,) = refused.value.problems
    assert (problem.row, problem.column) == (2, "t_s")
    assert f"of {len(time)} rows" in problem.found


@pytest.mark.parametrize("begin", [0.0, 3.0, BEGIN])
@pytest.mark.parametrize("rows", [40, 301, 2000])
def test_samples_every_ten_milliseconds_are_read(tmp_path: Path, begin: float, rows: int) -> None:
    trace = read_trace(table(tmp_path, [f"{begin + 0.01 * row:.2f}" for row in range(rows)]))
    assert trace.samples == rows
    assert trace.step_s == pytest.approx(0.01, rel=1e-3)


def test_samples_that_share_nine_milliseconds_are_read(tmp_path: Path) -> None:
    time = [f"{0.009 * tick:.3f}" for tick in range(100) for _ in range(4)]
    assert read_trace(table(tmp_path, time)).samples == len(time)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "time",
    [["-1.7e308", "1.7e308", "0"], ["-1.7e308"] * 5 + ["1.7e308"] * 5, ["0"] * 9 + ["1e308", "1.7e308", "-1.7e308"]],
)
def test_times_near_the_largest_number_are_refused_without_a_warning(tmp_path: Path, time: list[str]) -> None:
    with pytest.raises(AnalysisError, match="column t_s: found"):
        read_trace(table(tmp_path, time))
