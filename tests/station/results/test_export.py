"""Each format read back by its own library: every value, unit and meaning, and the run that they belong to."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from nptdms import TdmsFile
from scipy.io import loadmat
from station_samples import IMAGE, ORDERS, SETUP

from analysis.trace.runs import commanded_runs
from analysis.trace.trace import CHANNELS, SegmentInfo
from analysis.trace.trace_files import read_trace
from definitions.faults import FAULTS
from definitions.image import IMAGE_FIELDS, ORDERS_FIELDS, State
from recipes import find_bench, load_bench
from station.documents.entries import plain
from station.documents.exported import ExportedRun
from station.records.program_file import SegmentRow
from station.records.samples.scan_record import HEADER_FIELDS, pack
from station.records.samples.table import Table, table_of
from station.records.samples.value_names import CODED
from station.results.evaluation import trace_of
from station.results.export import FORMATS, Column, columns_of, sidecar, trace_columns
from station.results.export_origin import fingerprint_of

RUN = ExportedRun(
    id="20260101T000000.000Z-S1",
    serial="S1 ±°",
    attempt=2,
    state="complete",
    started="2026-01-01T00:00:00.000+00:00",
    clock="real",
    period_ns=1_000_000,
    recipe=SETUP.recipe,
    bench=SETUP.bench,
    software=SETUP.software,
    unit="RV",
    verdict="PASS",
)
SCANS = 50
AWKWARD = (0.1, -0.0, 1e-300, 1 / 3, 123456789.123456789)


BENCH = load_bench(find_bench("virtual"))
SEGMENTS = [
    SegmentRow(index=0, role="none", direction=0, cycle=0),
    SegmentRow(index=1, role="calibrate", direction=1, cycle=0),
    SegmentRow(index=2, role="measure", direction=-1, cycle=3),
]


def table(*, missed: bool = True) -> Table:
    """Records with a new sample in two of three scans; the first are of the lock's proof, the last of unloading."""
    return table_of(b"".join(_packed(n, n // 7 * missed) for n in range(SCANS)))


def _packed(n: int, missed: int) -> bytes:
    image = IMAGE._replace(torque_in_nm=AWKWARD[n % 5], command=n % 5, sample_counter=n - n // 3)
    state = State.LOCK if n < 4 else State.UNLOAD if n > 45 else State.RAMP_NEG
    orders = ORDERS._replace(state=state, segment=0 if n < 2 else 99 if n < 4 else 1 + n // 10 % 2)
    return pack((n, n + missed, -5 * n, n), image, orders)


def columns(*, missed: bool = True) -> list[Column]:
    found = table(missed=missed)
    return columns_of(found, 1_000_000, trace_columns(found, SEGMENTS, BENCH))


Read = tuple[dict[str, np.ndarray], dict[str, str], dict[str, str], dict[str, Any]]


def read_parquet(path: Path) -> Read:
    table = pq.read_table(path)
    fields = {field.name: field.metadata for field in table.schema}
    values = {name: table[name].to_numpy() for name in table.column_names}
    units = {name: data[b"unit"].decode() for name, data in fields.items()}
    meanings = {name: data[b"meaning"].decode() for name, data in fields.items()}
    return values, units, meanings, json.loads(table.schema.metadata[b"lostmotion"])


def read_csv(path: Path) -> Read:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    texts = {name: [row[index] for row in rows] for index, name in enumerate(header)}
    values = {name: np.array(found if name == "segment" else list(map(float, found))) for name, found in texts.items()}
    beside = json.loads(sidecar(path).read_text(encoding="utf-8"))
    units = {one["name"]: one["unit"] for one in beside["columns"]}
    return values, units, {one["name"]: one["meaning"] for one in beside["columns"]}, beside["run"]


def read_mat(path: Path) -> Read:
    found = loadmat(path, simplify_cells=True)
    text = {name: {key: str(value) if len(value) else "" for key, value in found[name].items()} for name in
            ("unit", "meaning")}  # fmt: skip
    # A matrix of characters has rows of one length.
    values = {name: np.char.rstrip(one) if one.dtype.kind == "U" else one for name, one in found["data"].items()}
    return values, text["unit"], text["meaning"], json.loads(found["run"])


def read_tdms(path: Path) -> Read:
    file = TdmsFile.read(path)
    channels = [channel for group in file.groups() for channel in group.channels()]
    values = {channel.name: channel[:] for channel in channels}
    units = {channel.name: channel.properties["unit_string"] for channel in channels}
    meanings = {channel.name: channel.properties["description"] for channel in channels}
    assert file.properties["serial"] == RUN.serial
    return values, units, meanings, json.loads(file.properties["lostmotion"])


READERS: dict[str, Callable[[Path], Read]] = {
    "parquet": read_parquet,
    "csv": read_csv,
    "mat": read_mat,
    "tdms": read_tdms,
}


def test_every_format_has_a_reader_here() -> None:
    assert set(READERS) == set(FORMATS)


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_round_trip_is_exact(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{name}"
    written = columns()
    FORMATS[name](path, written, RUN)
    values, units, meanings, run = READERS[name](path)
    assert run == plain(RUN)
    assert set(values) == {one.name for one in written}
    for one in written:
        assert np.array_equal(np.asarray(values[one.name], dtype=one.values.dtype), one.values), one.name
        assert units[one.name] == one.unit
        assert meanings[one.name] == one.meaning
    assert (
        np.signbit(values["image_torque_in_nm"]).tolist() == np.signbit([AWKWARD[n % 5] for n in range(SCANS)]).tolist()
    )


def kinds_of(name: str, path: Path) -> dict[str, dict[str, dict[str, str]]]:
    """Read back what the numbers of each column stand for: column, `values` or `bits`, number and name."""
    if name == "csv":
        found = json.loads(sidecar(path).read_text(encoding="utf-8"))["columns"]
        return {one["name"]: {kind: one[kind] for kind in KINDS if kind in one} for one in found}
    if name == "parquet":
        schema = pq.read_schema(path)
        return {
            field.name: {
                kind: json.loads(field.metadata[kind.encode()]) for kind in KINDS if kind.encode() in field.metadata
            }
            for field in schema
        }
    if name == "tdms":
        channels = [channel for group in TdmsFile.read(path).groups() for channel in group.channels()]
        return {
            one.name: {kind: json.loads(one.properties[kind]) for kind in KINDS if kind in one.properties}
            for one in channels
        }
    read = loadmat(path, simplify_cells=True)
    named: dict[str, dict[str, dict[str, str]]] = {column: {} for column in read["data"]}
    for kind in KINDS:
        for column, both in read[kind].items():
            numbers = [f"{number:.0f}" for number in both["number"]]
            named[column][kind] = dict(zip(numbers, both["name"], strict=True))
    return named


KINDS = ("values", "bits")


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_numbers_that_stand_for_something_have_their_names_in_every_format(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{name}"
    FORMATS[name](path, columns(), RUN)
    found = kinds_of(name, path)
    assert found["order_state"]["values"]["0"] == "idle"
    assert found["order_state"]["values"]["11"] == "fault"
    assert found["drive_state"]["values"]["5"] == "operation_enabled"
    assert found["drive_nmt_state"]["values"]["127"] == "pre_operational"
    assert found["order_fault"]["values"]["0"] == "none"
    for fault in FAULTS:
        assert found["order_fault"]["values"][str(fault.number)] == fault.id
        assert found["order_alarms"]["bits"][str(fault.number)] == fault.id
    assert found["sample_status"]["bits"] == {"0": "torque_in_saturated", "1": "torque_out_saturated", "2": "not_ready"}
    assert found["links_lost"]["bits"]["3"] == "remote_io"
    assert found["drive_statusword"]["bits"]["6"] == "switch_on_disabled"
    assert found["torque_in_nm"] == {}


def test_every_field_that_is_written_in_an_enumeration_has_names() -> None:
    words = ("Command", "DriveState", "NmtState", "SampleStatus", "Link bits", "DriveCommand", "State ", "Reaction")
    coded = {(one.group, one.name.removeprefix("order_")) for one in columns() if one.names()}
    assert coded == set(CODED)
    for group, fields in (("image", IMAGE_FIELDS), ("orders", ORDERS_FIELDS)):
        told = {(group, field.name) for field in fields if field.meaning.startswith(words)}
        assert told <= coded


def test_a_tdms_channel_is_a_waveform_where_no_period_was_missed(tmp_path: Path) -> None:
    path = tmp_path / "run.tdms"
    FORMATS["tdms"](path, columns(missed=False), RUN)
    channel = TdmsFile.read(path)["trace"]["torque_in_nm"]
    assert channel.properties["wf_increment"] == 0.001
    assert channel.time_track() == pytest.approx(np.arange(SCANS) * 0.001)
    FORMATS["tdms"](path, columns(), RUN)
    assert "wf_increment" not in TdmsFile.read(path)["trace"]["torque_in_nm"].properties


def test_no_field_of_the_record_is_left_out_and_no_two_share_a_name() -> None:
    names = [one.name for one in columns_of(table(), 1_000_000)]
    assert len({one.name for one in columns()}) == len(columns())
    assert len(names) == len(set(names)) == 1 + len(HEADER_FIELDS) + len(IMAGE_FIELDS) + len(ORDERS_FIELDS)


@pytest.mark.parametrize("name", ["csv", "parquet", "tdms"])
def test_the_analysis_reads_the_file_as_the_trace_of_the_run(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{name}"
    FORMATS[name](path, columns(), RUN)
    trace, own = read_trace(path), trace_of(table(), SEGMENTS, BENCH, 1_000_000, "run")
    for channel in CHANNELS:
        found, measured = getattr(trace, channel), getattr(own, channel)
        assert (found is None) == (measured is None), channel
        assert found is None or found.tolist() == measured.tolist(), channel
    assert trace.torque_in_nm is not None
    assert trace.segment is not None
    assert own.segment is not None
    assert 0 < trace.samples < SCANS - 8
    rows = [n for n in range(4, 46) if n % 3 or n == 0]
    assert trace.torque_in_nm.tolist() == [AWKWARD[n % 5] - ORDERS.torque_in_tare_nm for n in rows]
    infos = [trace.segments[key] for key in trace.segment.tolist()]
    assert infos == [own.segments[key] for key in own.segment.tolist()]
    assert set(infos) == {SegmentInfo("calibrate", 1, 0), SegmentInfo("measure", -1, 3)}
    assert fingerprint_of(trace) == fingerprint_of(own)


STEPS = [
    SegmentRow(index=1, role="measure", direction=1, cycle=1),
    SegmentRow(index=2, role="measure", direction=1, cycle=1),
]


@pytest.mark.parametrize("name", ["csv", "parquet", "tdms"])
def test_every_step_of_a_branch_is_a_piece_of_it_in_the_file_as_in_the_run(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{name}"
    FORMATS[name](path, columns_of(table(), 1_000_000, trace_columns(table(), STEPS, BENCH)), RUN)
    trace, own = read_trace(path), trace_of(table(), STEPS, BENCH, 1_000_000, "run")
    (found,), (measured,) = commanded_runs(trace), commanded_runs(own)
    assert found == measured
    assert len(found.pieces) == 5
    assert fingerprint_of(trace) == fingerprint_of(own)
    one_piece = replace(own, segment=np.ones(own.samples, dtype=np.int64))
    assert fingerprint_of(one_piece) != fingerprint_of(own)


def test_a_channel_that_the_bench_does_not_have_is_no_channel_of_the_trace(tmp_path: Path) -> None:
    without = BENCH.model_copy(update={"sensors": BENCH.sensors.model_copy(update={"torque_out": None})})
    FORMATS["csv"](tmp_path / "run.csv", columns_of(table(), 1_000_000, trace_columns(table(), SEGMENTS, without)), RUN)
    trace = read_trace(tmp_path / "run.csv")
    assert trace.torque_out_nm is None
    assert trace.torque_in_nm is not None
