"""`lostmotion export` of a run in virtual time."""

from __future__ import annotations

import errno
import json

import pyarrow.parquet as pq
import pytest

from station.record.check import read_table
from station.record.scan_record import RECORD_BYTES
from station.results.export import FORMATS, sidecar


def test_export_in_each_format_and_of_a_damaged_run(lostmotion, stored, tmp_path):
    scans = len(read_table(stored / "samples.bin"))
    for file_format in ("parquet", "csv", "mat", "tdms"):
        path = tmp_path / f"out.{file_format}"
        told = lostmotion("export", str(stored), "--format", file_format, "--out", str(path), "--json").json
        assert (told["scans"], told["bytes"]) == (scans, path.stat().st_size)
    assert not list(tmp_path.glob(".*.part*"))
    run = json.loads(pq.read_schema(tmp_path / "out.parquet").metadata[b"lostmotion"])
    verdict = json.loads((stored / "run.json").read_text(encoding="utf-8"))["verdict"]
    assert (run["serial"], run["state"], run["verdict"]) == ("R", "complete", verdict)
    assert [metric["id"] for metric in run["metrics"]] == ["torque_ratio_slope"]
    assert json.loads((tmp_path / "out.csv.json").read_text(encoding="utf-8"))["run"] == run

    refused = lostmotion("export", str(stored), "--format", "xlsx")
    assert refused.exit_code == 2
    assert "parquet, csv, mat, tdms" in refused.err
    with (stored / "samples.bin").open("r+b") as file:
        file.seek(100 * RECORD_BYTES + 60)
        file.write(b"\xff\x00\xff")
    damaged = lostmotion("export", str(stored), "--out", str(tmp_path / "no.parquet"))
    assert damaged.exit_code == 2
    assert "CRC" in damaged.err
    assert not (tmp_path / "no.parquet").exists()


@pytest.mark.parametrize("out", ["/proc/no/such/folder.parquet", "{file}/x.parquet", "{file}/x.csv"])
def test_a_place_that_cannot_be_written_is_told(lostmotion, stored, tmp_path, out):
    """Below a file nothing can be taken away either, as on a read-only disk."""
    (tmp_path / "file").touch()
    place = out.format(file=tmp_path / "file")
    told = lostmotion("export", str(stored), "--format", place.rpartition(".")[2], "--out", place)
    assert told.exit_code == 2
    assert "cannot be written" in told.err
    assert "Choose another --out" in told.err


@pytest.mark.parametrize("name", ["samples.bin", "profiles/new.csv", "../index.jsonl"])
def test_no_record_is_written_over(lostmotion, stored, name):
    place = stored / name
    before = place.read_bytes() if place.exists() else None
    for out in (place, stored / ".." / stored.name / name):
        refused = lostmotion("export", str(stored), "--format", "csv", "--out", str(out))
        assert refused.exit_code == 2
        assert "Choose another" in refused.err
    assert (place.read_bytes() if place.exists() else None) == before
    assert "altered" not in lostmotion("show", str(stored), "--json").json


def test_nothing_is_left_of_an_export_that_filled_the_disk(lostmotion, stored, tmp_path, monkeypatch):
    """The disk is full when the file beside the CSV is written, which is the smaller one and comes last."""

    def full(path, _columns, _run):
        path.write_bytes(b"x")
        sidecar(path).write_bytes(b"{")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setitem(FORMATS, "csv", full)
    (tmp_path / "out").mkdir()
    refused = lostmotion("export", str(stored), "--format", "csv", "--out", str(tmp_path / "out" / "a.csv"))
    assert refused.exit_code == 2
    assert "No space left on device. Choose another --out" in refused.err
    assert list((tmp_path / "out").iterdir()) == []


def test_a_name_with_brackets_is_a_name(lostmotion, stored, tmp_path):
    out = tmp_path / "run [a].csv"
    assert lostmotion("export", str(stored), "--format", "csv", "--out", str(out)).exit_code == 0
    assert sorted(path.name for path in tmp_path.glob("run*csv*")) == ["run [a].csv", "run [a].csv.json"]
    assert not list(tmp_path.glob(".*.part*"))


def test_an_altered_record_is_exported_as_one_that_decides_nothing(lostmotion, stored, tmp_path):
    timing = (stored / "timing.json").read_text(encoding="utf-8")
    (stored / "timing.json").write_text(timing.replace('"missed": 0', '"missed": 00'), encoding="utf-8")
    path = tmp_path / "altered.parquet"
    told = lostmotion("export", str(stored), "--out", str(path))
    assert told.exit_code == 3
    assert told.out.splitlines()[0].startswith("RECORD ALTERED")
    run = json.loads(pq.read_schema(path).metadata[b"lostmotion"])
    assert run["altered"][0].startswith("timing.json")
    assert run["verdict"] == "NOT DECIDABLE"
    assert run["reasons"][0].startswith("record altered: timing.json")
    again = lostmotion("export", str(stored), "--out", str(path), "--json")
    assert (again.exit_code, again.json["altered"]) == (3, run["altered"])
