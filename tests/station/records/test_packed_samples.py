"""Samples as Parquet: bit for bit what was recorded, readable by anybody, and never without the raw file too soon."""

from __future__ import annotations

import hashlib
import io
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from run_copies import alone, begun_here
from run_samples import as_recorded, flip, recorded
from stored_runs import store_run

import station.records.samples.packed
import station.records.samples.samples
from station.documents.manifest import PackedSamples
from station.errors import RecordError
from station.records.run_record import PACKED, SAMPLES, RunRecord
from station.records.samples.layout import CURRENT
from station.records.samples.packed import column_name, packed, unpacked, unpacked_parts
from station.records.samples.samples import channel_values, check_samples, pack_samples, read_samples
from station.records.samples.table import AbsentChannelError, table_of
from station.records.seal import alterations, fingerprint, seal
from station.reports.stored_result import stored_result

PLACE = Path("samples.parquet")
AWKWARD = (0.0, -0.0, np.nan, -np.nan, np.inf, -np.inf, 5e-324, 0.1, -1e308)
NAN_WITH_PAYLOAD = np.uint64(0xFFF0_0000_DEAD_BEEF)


def records(count: int, seed: int = 0) -> bytes:
    """Sound records whose channels hold any bits at all, not-a-numbers with their payloads among them."""
    random = np.random.default_rng(seed)
    table = np.frombuffer(random.bytes(count * CURRENT.record_bytes), CURRENT.dtype).copy()
    table["sequence"] = np.arange(count)
    for n in range(min(count, len(AWKWARD))):
        table["image"]["torque_in_nm"][n] = AWKWARD[n]
    if count:
        table["orders"]["reference_torque_nm"].view()[0] = NAN_WITH_PAYLOAD.view(np.float64)
    rows = [row.tobytes()[: CURRENT.body_bytes] for row in table]
    return b"".join(row + zlib.crc32(row).to_bytes(4, "little") for row in rows)


@settings(deadline=None, max_examples=25)
@given(count=st.integers(min_value=0, max_value=40), seed=st.integers(min_value=0, max_value=1 << 32))
def test_any_sound_records_come_back_bit_for_bit(count: int, seed: int) -> None:
    content = records(count, seed)
    assert unpacked(packed(table_of(content)), CURRENT, PLACE) == content


def test_long_runs_are_packed_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    content = records(50)
    monkeypatch.setattr(station.records.samples.packed, "GROUP_ROWS", 16)
    file = packed(table_of(content))
    parts = list(unpacked_parts(file, CURRENT, PLACE))
    assert [len(part) // CURRENT.record_bytes for part in parts] == [16, 16, 16, 2]
    assert b"".join(parts) == unpacked(file, CURRENT, PLACE) == content


def test_any_program_reads_the_columns_with_their_units() -> None:
    content = records(30)
    table, file = table_of(content), pq.ParquetFile(io.BytesIO(packed(table_of(content))))
    found = file.read()
    assert found.column_names == [column_name(one) for one in CURRENT.channels[:-1]]
    for one in CURRENT.channels[:-1]:
        values = table.rows[one.name] if one.group == "record" else table.rows[one.group][one.name]
        assert found[column_name(one)].to_numpy().tobytes() == np.ascontiguousarray(values).tobytes()
        said = found.schema.field(column_name(one)).metadata
        assert [said[key].decode() for key in (b"unit", b"group", b"name")] == [one.unit, one.group, one.name]
    assert json.loads(found.schema.field("order_state").metadata[b"values"])["0"] == "idle"
    encodings = {
        name for n in range(len(found.column_names)) for name in file.metadata.row_group(0).column(n).encodings
    }
    assert encodings <= {"PLAIN", "RLE", "RLE_DICTIONARY", "BYTE_STREAM_SPLIT", "DELTA_BINARY_PACKED"}


@pytest.mark.parametrize(
    "content",
    [b"", b"PAR1", b"x" * 500, packed(table_of(records(5)))[:-20]],
    ids=["empty", "magic only", "junk", "cut off"],
)
def test_a_file_that_is_no_parquet_is_told_with_its_place(content: bytes) -> None:
    with pytest.raises(RecordError, match=r"samples\.parquet: is damaged"):
        unpacked(content, CURRENT, PLACE)


@pytest.mark.parametrize("change", ["missing", "other type", "null"])
def test_columns_that_are_not_those_of_the_description_are_told(change: str) -> None:
    table = pq.read_table(io.BytesIO(packed(table_of(records(5)))))
    at = table.column_names.index("torque_in_nm")
    column = {"other type": pa.array([1.0] * 5, pa.float32()), "null": pa.array([1.0, None, 1.0, 1.0, 1.0])}
    table = table.remove_column(at)
    if change in column:
        table = table.add_column(at, "torque_in_nm", column[change])
    stream = io.BytesIO()
    pq.write_table(table, stream)
    with pytest.raises(RecordError, match="torque_in_nm"):
        unpacked(stream.getvalue(), CURRENT, PLACE)


@pytest.fixture
def run(tmp_path: Path) -> RunRecord:
    """A run that is recorded and was not concluded."""
    run = begun_here(alone(store_run(tmp_path / "runs", "S", [])))
    run.samples.write_bytes(records(50))
    return run


def sealed(run: RunRecord) -> RunRecord:
    content = run.samples.read_bytes()
    seal(run, records=50, samples=pack_samples(run, content, sound=True))
    return run


def test_a_sealed_run_has_the_packed_file_alone_and_the_hash_of_what_was_recorded(run: RunRecord) -> None:
    content = run.samples.read_bytes()
    sealed(run)
    manifest = run.manifest()
    digest = hashlib.sha256(content).hexdigest()
    assert manifest.samples == PackedSamples(file=PACKED, sha256=digest, bytes=len(content))
    assert (run.has(SAMPLES), SAMPLES in manifest.files, PACKED in manifest.files) == (False, False, True)
    assert recorded(run.folder) == content
    assert (check_samples(run, 50).sound, run.records()) == (True, 50)


def test_the_raw_file_stays_until_the_line_is_in_the_chain(run: RunRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any, **__: Any) -> None:
        raise RecordError("no line")

    content = run.samples.read_bytes()
    monkeypatch.setattr("station.records.chain.writing.ChainWriter.append", refused)
    with pytest.raises(RecordError, match="no line"):
        seal(run, records=50, samples=pack_samples(run, content, sound=True))
    assert run.samples.read_bytes() == content


@pytest.mark.parametrize("how", ["refused", "other bytes", "not sound"])
def test_samples_stay_raw_where_the_packed_file_is_not_the_same(
    run: RunRecord, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    def refuse(*_: Any) -> None:
        raise RecordError("full")

    content = run.samples.read_bytes()
    if how == "refused":
        monkeypatch.setattr(station.records.samples.samples, "write_atomic", refuse)
    elif how == "other bytes":
        monkeypatch.setattr(station.records.samples.samples, "packed", lambda _: packed(table_of(records(50, seed=9))))
    assert pack_samples(run, content, sound=how != "not sound") is None
    assert (run.has(PACKED), run.samples.read_bytes() == content) == (False, True)


def test_other_samples_in_the_packed_file_are_found_twice(run: RunRecord) -> None:
    sealed(run)
    flip(run, 5 * CURRENT.record_bytes + 40)
    assert any(one.startswith(PACKED) for one in alterations(run))
    run.update(files={**run.manifest().files, PACKED: fingerprint(run.folder / PACKED)})
    assert not any(one.startswith(PACKED) for one in alterations(run))
    assert "holds other records than those recorded" in check_samples(run, 50).problems[0]
    assert stored_result(run).verdict == "NOT DECIDABLE"


def test_a_raw_file_that_somebody_puts_beside_is_no_evidence(run: RunRecord) -> None:
    content = recorded(sealed(run).folder)
    run.samples.write_bytes(records(50, seed=4))
    assert recorded(run.folder) == content
    assert any(one.startswith(SAMPLES) for one in alterations(run))


def test_a_few_channels_are_read_without_the_others(run: RunRecord) -> None:
    wanted = [("image", "torque_out_nm"), ("orders", "state"), ("record", "scan")]
    raw = channel_values(run, wanted)
    table = read_samples(run)
    sealed(run)
    for (group, name), before, after in zip(wanted, raw, channel_values(run, wanted), strict=True):
        expected = table.rows[name] if group == "record" else table.rows[group][name]
        assert before.tobytes() == after.tobytes() == np.ascontiguousarray(expected).tobytes()
    with pytest.raises(AbsentChannelError, match=r"image\.nothing"):
        channel_values(run, [("image", "nothing")])


def test_what_was_packed_can_be_put_back(run: RunRecord) -> None:
    content = run.samples.read_bytes()
    assert as_recorded(sealed(run)) == content == run.samples.read_bytes()
