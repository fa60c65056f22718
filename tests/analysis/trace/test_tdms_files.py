"""TDMS traces: columns, segments and time are read, every fault is named, damaged files never crash."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from reference_unit import ARC

from analysis.trace.errors import AnalysisError
from analysis.trace.trace import SegmentInfo, Trace
from analysis.trace.trace_files import read_trace

TORQUE = np.linspace(-400.0, 400.0, 21)


def written(path: Path, *channels: ChannelObject) -> Path:
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(list(channels))
    return path


def channel(name: str, values: object = TORQUE, group: str = "loop", **properties: object) -> ChannelObject:
    return ChannelObject(group, name, values, properties=properties)


def test_channels_are_columns(tmp_path: Path) -> None:
    trace = read_trace(
        written(
            tmp_path / "run.tdms",
            channel("torque_out_nm"),
            channel("angle_out_arcmin", TORQUE / 100),
            channel("segment", ["forward"] * 10 + ["return"] * 11),
            channel("operator", ["a"] * 21),
            ChannelObject("settings", "gain", np.ones(3)),
        )
    )
    assert trace.torque_out_nm == pytest.approx(TORQUE)
    assert trace.angle_out_rad == pytest.approx(TORQUE / 100 * ARC)
    assert trace.segments == {0: SegmentInfo("measure", 1, 1), 1: SegmentInfo("measure", -1, 1)}
    assert trace.t_s is None


def test_a_waveform_brings_its_time(tmp_path: Path) -> None:
    path = written(
        tmp_path / "run.tdms",
        channel("torque_out_nm", wf_increment=0.001),
        channel("angle_out_rad", TORQUE, wf_increment=0.001),
    )
    assert read_trace(path).t_s == pytest.approx(0.001 * np.arange(21))


def test_time_stamps_count_from_the_first(tmp_path: Path) -> None:
    stamps = np.datetime64("2024-03-01T12:00:00", "us") + np.arange(21) * np.timedelta64(500, "us")
    path = written(tmp_path / "run.tdms", channel("t_s", stamps), channel("torque_out_nm", wf_increment=9.0))
    assert read_trace(path).t_s == pytest.approx(0.0005 * np.arange(21))


def test_waveforms_that_begin_together_and_say_the_units_of_their_names(tmp_path: Path) -> None:
    stamp = np.datetime64("2024-03-01T12:00:00")
    path = written(
        tmp_path / "run.tdms",
        channel("torque_out_nm", wf_increment=0.001, wf_start_time=stamp, wf_start_offset=1.0, unit_string="Nm"),
        channel("angle_out_rad", wf_increment=0.001, wf_start_time=stamp + 1, unit_string=""),
        channel("motor_current", wf_increment=0.001, wf_start_offset=1.0, unit_string="A"),
    )
    assert read_trace(path).t_s == pytest.approx(0.001 * np.arange(21))


@pytest.mark.parametrize("kind", [np.int16, np.uint8, np.float32, np.int64])
def test_kinds_of_numbers(tmp_path: Path, kind: type) -> None:
    path = written(tmp_path / "run.tdms", channel("torque_out_nm", np.arange(5).astype(kind)))
    assert read_trace(path).torque_out_nm == pytest.approx(np.arange(5.0))


def test_several_segments_of_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.tdms"
    with TdmsWriter(str(path)) as writer:
        for part in np.split(TORQUE, [5, 12]):
            writer.write_segment([channel("torque_out_nm", part), channel("angle_out_rad", part)])
    assert read_trace(path).torque_out_nm == pytest.approx(TORQUE)


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        ((channel("torque"), channel("angle")), "group loop: torque, angle; expected a group with some of angle_in"),
        ((channel("torque_out_nm"), channel("angle_out_rad", TORQUE[:5])), "torque_out_nm has 21, angle_out_rad has 5"),
        ((channel("torque_out_nm"), channel("angle_out_rad", group="other")), "known channels in groups loop, other"),
        (
            (channel("torque_out_nm", wf_increment=0.1), channel("angle_out_rad", wf_increment=0.2)),
            "torque_out_nm has 0.1 s, angle_out_rad has 0.2 s; record all channels at one rate",
        ),
        (
            (channel("torque_out_nm", unit_string="lbf·ft"), channel("angle_out_rad", unit_string="rad")),
            "column torque_out_nm: found the unit 'lbf·ft'; expected N·m; convert the column to that unit",
        ),
        (
            (
                channel("torque_out_nm", wf_increment=0.001, wf_start_offset=0.06),
                channel("angle_out_rad", wf_increment=0.001, wf_start_offset=0.0),
            ),
            "channel torque_out_nm begins 0.06 s after channel angle_out_rad",
        ),
        (
            (
                channel("torque_out_nm", wf_increment=0.001, wf_start_time=np.datetime64("2024-03-01T12:00:00.000")),
                channel("angle_out_rad", wf_increment=0.001, wf_start_time=np.datetime64("2024-03-01T12:00:00.020")),
            ),
            "channel angle_out_rad begins 0.02 s after channel torque_out_nm",
        ),
        ((channel("torque_out_nm", np.array([1.0, np.nan, 2.0])),), "row 2, column torque_out_nm: found nan"),
        ((channel("torque_out_nm", ["1", "two"]),), "row 2, column torque_out_nm: found 'two'"),
        ((channel("torque_out_nm"), channel("torque_out_nm ")), "torque_out_nm is there twice"),
        ((channel("torque_out_nm", TORQUE * 1j),), "expected numbers, times or text"),
        ((channel("segment", ["sideways"]), channel("torque_out_nm", [1.0])), "found 'sideways'"),
        ((channel("torque_out_nm", np.empty(0)),), "no rows"),
    ],
)
def test_faults_are_named(tmp_path: Path, channels: tuple[ChannelObject, ...], said: str) -> None:
    with pytest.raises(AnalysisError, match=said) as caught:
        read_trace(written(tmp_path / "run.tdms", *channels))
    assert "run.tdms" in str(caught.value)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("tdms") / "sound.tdms"
    names = ["forward"] * 10 + ["return"] * 11
    return written(path, channel("torque_out_nm", wf_increment=0.001), channel("segment", names)).read_bytes()


@settings(max_examples=300, deadline=2000)
@given(data=st.data())
def test_no_damaged_file_raises_anything_else(
    sound: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = bytearray(sound)
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(4, len(content) - 8))
        patch = data.draw(st.binary(min_size=1, max_size=8) | st.sampled_from([b"\xff" * 8, b"\x00" * 8, b"\xff" * 4]))
        content[place : place + len(patch)] = patch
    path = tmp_path_factory.getbasetemp() / "damaged.tdms"
    path.write_bytes(content[: data.draw(st.integers(4, len(content)))])
    try:
        assert isinstance(read_trace(path), Trace)
    except AnalysisError as error:
        assert "damaged.tdms" in str(error)  # noqa: PT017 - anything else would get through


@settings(max_examples=100)
@given(st.binary(max_size=200))
def test_nothing_but_the_first_word(tmp_path_factory: pytest.TempPathFactory, tail: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "word.tdms"
    path.write_bytes(b"TDSm" + tail)
    with pytest.raises(AnalysisError, match=r"word\.tdms"):
        read_trace(path)


@pytest.mark.parametrize("missing", [1, 100])
def test_a_file_that_was_cut_off(tmp_path: Path, missing: int, capfd: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "cut.tdms", channel("torque_out_nm"), channel("angle_out_rad"))
    path.write_bytes(path.read_bytes()[:-missing])
    with pytest.raises(AnalysisError, match="the recording ends within its last segment"):
        read_trace(path)
    assert capfd.readouterr().err == ""


def test_a_claim_of_more_values_than_bytes_takes_no_memory(tmp_path: Path, sound: bytes) -> None:
    # the number of values of the first channel, 21 as a 64 bit number, becomes 2^40
    place = sound.index((21).to_bytes(8, "little"))
    path = tmp_path / "claim.tdms"
    path.write_bytes(sound[:place] + (1 << 40).to_bytes(8, "little") + sound[place + 8 :])
    with pytest.raises(AnalysisError, match=r"claim\.tdms"):
        read_trace(path)
