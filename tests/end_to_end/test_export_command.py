"""`lostmotion export` of a run in virtual time."""

from __future__ import annotations

import json

import pyarrow.parquet as pq
import pytest

from station.record.check import read_table
from station.record.scan_record import RECORD_BYTES


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
