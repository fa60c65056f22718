"""CSV and Parquet traces: what is read, and how each fault is named."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published import DATA
from reference_unit import ARC

from analysis.trace.errors import AnalysisError
from analysis.trace.segment_names import segment_name, segment_names
from analysis.trace.trace import SegmentInfo, Trace
from analysis.trace.trace_files import read_trace


def written(folder: Path, content: bytes | str) -> Path:
    path = folder / "trace.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_published_loop() -> None:
    trace = read_trace(DATA / "loop_published_curve.csv")
    assert trace.samples == 4002
    assert trace.torque_in_nm is None
    assert trace.torque_out_nm is not None
    assert trace.angle_out_rad is not None
    assert trace.torque_out_nm[0] == -420.0
    assert trace.angle_out_rad[0] == pytest.approx(-12.680542800 * ARC)
    assert trace.segments == {0: SegmentInfo("measure", 1, 1), 1: SegmentInfo("measure", -1, 1)}


def test_units_are_read_from_the_names(tmp_path: Path) -> None:
    trace = read_trace(written(tmp_path, "t_s,angle_in_arcmin,angle_out_rad,note\n0,1, 2 ,a\n1,-1e1,3,b\n"))
    assert trace.angle_in_rad == pytest.approx(np.array([1, -10]) * ARC)
    assert trace.angle_out_rad == pytest.approx(np.array([2, 3]))
    assert trace.segment is None


@pytest.mark.parametrize(
    "name",
    [
        "angle_in_deg", "angle_in", "Angle_In_rad", "angle_input_rad", "Angle out (arcmin)", "angel_in_rad", "T_s",
        "t_ms", "time", "torque_in", "torque-out-nm", "TORQUE_OUT_NM", "temperature_C", "temperature_k", "temp_c",
        "Segment", "segments", "Branch",
    ],
)  # fmt: skip
def test_a_column_that_is_nearly_one_of_ours_is_not_dropped(tmp_path: Path, name: str) -> None:
    with pytest.raises(AnalysisError, match="would be left out; allowed are t_s") as caught:
        read_trace(written(tmp_path, f"torque_out_nm,{name}\n0,1\n1,2\n"))
    assert f"column '{name}'" in str(caught.value)


@pytest.mark.parametrize("name", ["note", "sample_counter", "housing_temp_c", "drive_torque_nm", "order_segment", ""])
def test_a_column_of_something_else_is_left_alone(tmp_path: Path, name: str) -> None:
    assert read_trace(written(tmp_path, f"torque_out_nm,{name}\n0,1\n1,2\n")).samples == 2


def test_byte_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    trace = read_trace(written(tmp_path, "\ufefft_s,torque_out_nm\r\n0,1\r\n1,2\r\n"))
    assert trace.t_s == pytest.approx(np.array([0, 1]))


def test_segments_survive_a_file(tmp_path: Path) -> None:
    infos = [SegmentInfo("virgin", 1, 0), SegmentInfo("dwell"), SegmentInfo("measure", -1, 2)]
    rows = "\n".join(f"{number},{segment_name(info)}" for number, info in enumerate(infos))
    trace = read_trace(written(tmp_path, f"t_s,segment\n{rows}\n"))
    assert [trace.segments[key] for key in range(3)] == infos


def test_ramps_and_holds_of_a_branch_in_steps_are_numbered_where_they_meet(tmp_path: Path) -> None:
    down, up = SegmentInfo("measure", -1, 1), SegmentInfo("measure", 1, 1)
    table = {1: down, 2: down, 3: down, 4: SegmentInfo("dwell"), 5: up, 7: down}
    names = segment_names([1, 2, 3, 4, 5, 7], table)
    steps = [f"measure -1 1 {number}" for number in (1, 2, 3)]
    assert list(names.values()) == [*steps, "dwell +0 0", "measure +1 1", "measure -1 1"]
    assert segment_names([1, 3, 5], table)[3] == "measure -1 1 2"
    rows = "\n".join(f"{number},{name}" for number, name in enumerate(names.values()))
    trace = read_trace(written(tmp_path, f"t_s,segment\n{rows}\n"))
    assert list(trace.segments.values()) == [table[key] for key in names]
    assert trace.segment is not None
    assert len(set(trace.segment.tolist())) == len(names)


def test_rows_that_are_no_samples_of_the_loop_are_left_out(tmp_path: Path) -> None:
    rows = ["0,9,unused", "1,1,measure +1 1", "2,9,unused", "3,2,measure +1 1", "4,3,measure -1 1", "5,9,unused"]
    trace = read_trace(written(tmp_path, "\n".join(["t_s,drive_torque_nm,segment", *rows, ""])))
    assert trace.t_s == pytest.approx(np.array([1, 3, 4]))
    assert trace.drive_torque_nm == pytest.approx(np.array([1, 2, 3]))
    assert trace.segment is not None
    assert trace.segment.tolist() == [0, 0, 1]
    assert trace.segments == {0: SegmentInfo("measure", 1, 1), 1: SegmentInfo("measure", -1, 1)}
    numbered = read_trace(written(tmp_path, "t_s,segment\n0,unused\n1,1\n2,2\n"))
    assert (numbered.samples, numbered.segment) == (2, None)
    loops = "segment,torque_out_nm\nforward,1\nunused,5\nforward,2\nreturn,3\n"
    assert [info.cycle for info in read_trace(written(tmp_path, loops)).segments.values()] == [1, 1]


def test_returning_branches_count_the_cycles(tmp_path: Path) -> None:
    trace = read_trace(written(tmp_path, "branch,torque_out_nm\nforward,1\nreturn,2\nforward,3\nreturn,4\n"))
    assert [info.cycle for info in trace.segments.values()] == [1, 1, 2, 2]


def test_numbered_segments_mean_that_the_profile_is_not_known(tmp_path: Path) -> None:
    trace = read_trace(written(tmp_path, "segment,torque_out_nm\n1,1\n2,2\n"))
    assert (trace.segment, trace.segments) == (None, {})


def test_parquet(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    names = pa.array(["forward", "forward", "return"]).dictionary_encode()
    pq.write_table(pa.table({"torque_out_nm": [1, 2, 3], "angle_out_arcmin": [0.5, 1.0, 1.5], "branch": names}), path)
    trace = read_trace(path)
    assert trace.torque_out_nm == pytest.approx(np.array([1, 2, 3]))
    assert trace.angle_out_rad == pytest.approx(np.array([0.5, 1, 1.5]) * ARC)
    assert [info.direction for info in trace.segments.values()] == [1, -1]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "Empty"),
        ("torque_out_nm,angle_out_rad\n", "no rows"),
        ("torque,angle\n1,2\n", "found columns torque, angle; expected some of t_s"),
        ("t_s,torque_out_nm\n0,1\n1,abc\n", "row 2, column torque_out_nm: found 'abc'"),
        ("t_s,torque_out_nm\n0,1\n1,\n", "row 2, column torque_out_nm: found ''"),
        ("t_s,torque_out_nm\n0,nan\n", "row 1, column torque_out_nm: found 'nan'; expected a finite"),
        ("t_s,torque_out_nm\n0,1\n1,-inf\n", "row 2, column torque_out_nm: found '-inf'"),
        ("t_s,torque_out_nm\n0,1\n1,1e10\n", "row 2, column torque_out_nm: found 10000000000.0"),
        ("t_s,torque_out_nm\n0,1\n-1,1\n", "row 2, column t_s: found -1.0 after 0.0"),
        ("t_s,torque_out_nm\n0,1\n1,1,7\n", "row 2: found 3 cells; expected 2"),
        ("t_s,torque_out_nm\n0,1\n1,1_000\n", "row 2, column torque_out_nm: found '1_000'"),
        ("t_s,torque_out_nm\n0,1\n1,\u0661\n", "row 2, column torque_out_nm: found '\u0661'"),
        ("angle_in_rad,angle_in_arcmin\n1,2\n", "angle_in_rad and angle_in_arcmin, which both mean angle_in_rad"),
        ("branch,torque_out_nm\nforward,1\nbackwards,1\n", "row 2, column branch: found 'backwards'"),
        ("segment,torque_out_nm\nmeasure 2 1,1\n", "found 'measure 2 1'; allowed are forward, return"),
        ("segment,t_s\nunused,1\nmeasure -1 1,2\nramp,3\n", "row 3, column segment: found 'ramp'"),
        ("segment,t_s\nmeasure -1 1,1\nunused,2\nmeasure -1 1,1\n", "row 3, column t_s: found 1.0 after 2.0"),
        ("segment,t_s\nunused,1\nunused,2\n", "every row is unused"),
        (b"t_s,torque_out_nm\n0,\xff\xfe\n", "cannot be read|row 1, column torque_out_nm"),
        (b"%PDF-1.7\n\xff\x00,\n", "the file is a PDF document: name the table"),
        (b"PK\x03\x04rest", "Excel workbook: save the sheet as CSV"),
        ("t_s,torque_out_nm\n".encode("utf-16"), "no rows below the header"),
        ("<!DOCTYPE html>\n<p>a, b</p>\n", "the file is a web page"),
        (b"a,b\n\x00\x01\x02\n", "binary data"),
        (b"PAR1 and nothing else", "cannot be read as CSV, Parquet or TDMS"),
    ],
)
def test_faults_are_named(tmp_path: Path, content: bytes | str, said: str) -> None:
    with pytest.raises(AnalysisError, match=said) as caught:
        read_trace(written(tmp_path, content))
    assert "trace.csv" in str(caught.value)


def test_what_a_parser_complains_of_is_shown_as_text(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError) as caught:
        read_trace(written(tmp_path, b"a,b\n1,2\n\xea\x1b[31m\x07" + b"x" * 1000 + b",2,3\n"))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500


def test_no_such_file_and_a_folder(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.csv", tmp_path):
        with pytest.raises(AnalysisError, match="cannot be read"):
            read_trace(path)


@pytest.mark.parametrize(("unit", "refused"), [("N·m", False), ("Nm", False), ("", False), ("lbf·ft", True)])
def test_the_unit_that_a_parquet_column_states_is_that_of_its_name(
    tmp_path: Path,
    unit: str,
    refused: bool,  # noqa: FBT001 - a row of a table
) -> None:
    path = tmp_path / "trace.parquet"
    fields = [pa.field("torque_out_nm", pa.float64(), metadata={"unit": unit}), pa.field("note", pa.string())]
    pq.write_table(pa.table([pa.array([1.0, 2.0]), pa.array(["a", "b"])], schema=pa.schema(fields)), path)
    if not refused:
        assert read_trace(path).samples == 2
        return
    with pytest.raises(AnalysisError, match="column torque_out_nm: found the unit 'lbf·ft'; expected N·m"):
        read_trace(path)


def test_parquet_with_a_missing_value(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    pq.write_table(pa.table({"torque_out_nm": [1.0, None, 3.0]}), path)
    with pytest.raises(AnalysisError, match="row 2, column torque_out_nm"):
        read_trace(path)


def test_parquet_with_nested_values(tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    pq.write_table(pa.table({"torque_out_nm": [[1.0], [2.0]]}), path)
    with pytest.raises(AnalysisError, match="column torque_out_nm"):
        read_trace(path)


@settings(max_examples=150, deadline=None)
@given(
    st.one_of(
        st.binary(max_size=200),
        st.binary(max_size=60).map(lambda tail: b"torque_out_nm,segment\n1,2\n" + tail),
        st.binary(max_size=60).map(lambda tail: b"PAR1" + tail),
        st.text(alphabet="0123456789.,-eE\n \"';", max_size=80).map(lambda tail: f"t_s,branch\n{tail}".encode()),
    )
)
def test_no_file_raises_anything_else(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = written(tmp_path_factory.getbasetemp(), content)
    try:
        assert isinstance(read_trace(path), Trace)
    except AnalysisError as error:
        assert str(path) in str(error)  # noqa: PT017 - anything else would get through


def test_trace_refuses_columns_of_different_length() -> None:
    with pytest.raises(AnalysisError, match="t_s has 2, torque_out_nm has 3 samples"):
        Trace(t_s=np.arange(2.0), torque_out_nm=np.arange(3.0))


def test_trace_refuses_a_segment_that_is_not_in_the_table() -> None:
    with pytest.raises(AnalysisError, match="row 2, column segment: id 7 is not in the segment table"):
        Trace(t_s=np.arange(2.0), segment=np.array([0, 7]), segments={0: SegmentInfo("measure", 1, 1)})


def test_trace_refuses_an_unknown_role() -> None:
    with pytest.raises(AnalysisError, match="role 'ramp'"):
        Trace(t_s=np.arange(2.0), segment=np.array([0, 0]), segments={0: SegmentInfo("ramp", 1, 1)})


@pytest.mark.parametrize(
    ("honest", "bent", "words"),
    [
        (b"torque_in_nm", b"torque_\xffn_nm", "cannot be read"),
        (b"0.25", b"0.\x805", "row 2, column torque_in_nm: found '0.\ufffd5'"),
    ],
)
def test_parquet_with_text_that_is_no_text(tmp_path: Path, honest: bytes, bent: bytes, words: str) -> None:
    path = tmp_path / "trace.parquet"
    table = pa.table({"torque_in_nm": ["0.50", "0.25"], "torque_out_nm": [1.0, 2.0], "angle_in_rad": [0.0, 0.1]})
    pq.write_table(table, path, compression="none", write_statistics=False)
    path.write_bytes(path.read_bytes().replace(honest, bent))
    with pytest.raises(AnalysisError, match=words):
        read_trace(path)


@pytest.mark.parametrize(("unit", "counts"), [("s", 1), ("ms", 1000), ("us", 1_000_000), ("ns", 1_000_000_000)])
def test_durations_of_parquet_bring_their_unit(tmp_path: Path, unit: str, counts: int) -> None:
    path = tmp_path / "trace.parquet"
    time = pa.array([0, counts, 2 * counts], pa.int64()).cast(pa.duration(unit))
    pq.write_table(pa.table({"t_s": time, "torque_out_nm": [1.0, 2.0, 3.0]}), path)
    assert read_trace(path).t_s == pytest.approx(np.array([0.0, 1.0, 2.0]))
